"""How far a pile is from falling: tilted gravity and lowered friction.

The paper found its own check too optimistic, "especially for balls": forces that balance a pile exist as long
as every friction cone is open to its last degree, and a ball stands on a point. Two questions ask for more:

* :func:`check_margin`, the rule of the planner: does the pile also stand with less friction under gravity
  that is tilted by a few degrees, whichever way?
* :func:`measure_margin`, the figure for people: how far may gravity be tilted, and how low may friction be?
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from packenv.planning.stability.checker import StabilityChecker, StabilityResult
from packenv.planning.stability.equilibrium import GRAVITY, Equilibrium
from packenv.planning.stability.solvers import Solution, new_solver, pass_program, solve_highs
from packenv.types import Contacts, FloatArray, IntArray

N_DIRECTIONS = 8
"""Directions of tilt that a margin looks at."""

TILT_CAP_DEG = 45.0
"""Tilts beyond this are not told apart."""

_ENTERING = 16
"""Most columns that join a margin's linear program at once."""

_FEW_ROWS = 12
"""Up to so many rows all columns take part from the start."""

_ROUNDS = 400
"""Most times that columns join it before it is bisected instead."""


@dataclass(frozen=True)
class MarginRule:
    """What a pile must survive.

    The default is what told best, of tilts from 0 to 12° and friction from 0.25 to 0.7, which of 749
    candidates stay where they are dropped by 1 cm on a frozen pile (Bullet, μ = 0.7): of 269 items that are
    no balls it accepts 73 % of those that stay, and 1 in 100 of what it accepts moves; of 480 balls it
    accepts none. At 5° 5 in 100 move. Without less friction, balls that are wedged get through.

    Attributes:
        tilt_deg: gravity tilted by this much in each of eight directions, degrees, 0 to below 90.
        mu: friction coefficient that is counted on; where the surfaces have less, theirs is.

    Raises:
        ValueError: a value is out of range.
    """

    tilt_deg: float = 8.0
    mu: float = 0.25

    def __post_init__(self) -> None:
        """Check the values."""
        if not 0.0 <= self.tilt_deg < 90.0:
            raise ValueError(f"margin of {self.tilt_deg:g} degrees of tilt: give 0 or more, below 90")
        if not (np.isfinite(self.mu) and self.mu >= 0.0):
            raise ValueError(f"margin's friction coefficient {self.mu:g}: give a finite number, 0 or more")

    def weakened(self, checker: StabilityChecker) -> StabilityChecker:
        """The checker with no more friction than the rule counts on."""
        return replace(checker, most=min(self.mu, checker.most))

    def pulls(self, gravity: ArrayLike = GRAVITY) -> FloatArray:
        """(d, 3) horizontal pulls that tilt gravity, in units of gravity; one for each direction.

        Args:
            gravity: (3,) m/s².
        """
        pulls: FloatArray = np.tan(np.radians(self.tilt_deg)) * tilt_directions(gravity)
        return pulls

    def alone(
        self,
        checker: StabilityChecker,
        contacts: Contacts,
        masses: ArrayLike,
        coms: ArrayLike,
        new: int | None = None,
    ) -> tuple[Solution, ...]:
        """:meth:`StabilityChecker.balance_alone` with the rule's friction, under each of its tilts."""
        pulls = self.pulls(checker.gravity)
        return self.weakened(checker).balance_alone(contacts, masses, coms, pulls, new)


@dataclass(frozen=True, eq=False)
class Margin:
    """How far a pile is from falling.

    Attributes:
        tilt_deg: the pile survives gravity tilted by this much in each direction; 0 also where it does not
            stand at all, and never above the cap.
        stable: True where it stands without tilt.
        directions: (d, 3) unit, where the horizontal part of tilted gravity points.
        tilts_deg: (d,) tilt that the pile survives in each direction.
        mu: smallest friction coefficient at which the untilted pile stands, at each contact that has no less;
            None where not asked or unstable.
    """

    tilt_deg: float
    stable: bool
    directions: FloatArray
    tilts_deg: FloatArray
    mu: float | None = None


def tilt_directions(gravity: ArrayLike = GRAVITY, n: int = N_DIRECTIONS) -> FloatArray:
    """(n, 3) unit vectors across gravity, evenly spread; the first along x where gravity is vertical."""
    return _tilt_directions(tuple(np.asarray(gravity, dtype=np.float64).tolist()), n)


@lru_cache(maxsize=16)
def _tilt_directions(gravity: tuple[float, ...], n: int) -> FloatArray:
    pull = np.array(gravity)
    up = -pull / np.linalg.norm(pull)
    axis = np.zeros(3)
    # As in the pyramids, so that the tilts of a flat contact point along edges.
    axis[int(np.argmin(np.abs(up)))] = 1.0
    first = axis - (axis @ up) * up
    first /= np.linalg.norm(first)
    second = np.cross(up, first)
    angles = 2.0 * np.pi * np.arange(n) / n
    directions: FloatArray = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    directions.setflags(write=False)
    return directions


def check_margin(
    checker: StabilityChecker,
    contacts: Contacts,
    masses: ArrayLike,
    coms: ArrayLike,
    rule: MarginRule | None = None,
    *,
    new: int | None = None,
    previous: tuple[StabilityResult, ...] | None = None,
    alone: tuple[Solution, ...] | None = None,
) -> tuple[StabilityResult, ...]:
    """Does the pile stand with the rule's friction under gravity tilted as the rule says, whichever way?

    The pulls that a pile survives are a convex set and grow with friction, so what survives all eight tilts
    also stands without, with all its friction, and under any smaller tilt in their octagon.

    The new item alone, everything else held, is asked under all tilts before the pile is asked under any: it
    is cheap, and mostly it is what fails.

    Args:
        checker: solvers and true friction.
        contacts: of the whole pile.
        masses: (n,) kg.
        coms: (n, 3) m.
        rule: what is to be survived; the default one where None.
        new: the body whose placement is asked; the last one where None.
        previous: what this function returned, by the same rule, for the pile without ``new``.
        alone: what :meth:`MarginRule.alone` found for ``new``; found here where None.

    Returns:
        One result for each direction where the pile survives all of them; otherwise the last one says no.
    """
    rule = rule or MarginRule()
    weak = rule.weakened(checker)
    pulls = rule.pulls(checker.gravity)
    if not len(np.atleast_1d(masses)):
        return (weak.check(contacts, masses, coms),) * len(pulls)
    if alone is None:
        alone = rule.alone(checker, contacts, masses, coms, new)
    results: list[StabilityResult] = []
    for i, solution in enumerate(alone):
        before = previous[i] if previous is not None and i < len(previous) else None
        result = weak.check(contacts, masses, coms, new, before, pulls[i], solution)
        results.append(result)
        if not result.stable:
            break
    return tuple(results)


def upright_forces(results: tuple[StabilityResult, ...]) -> FloatArray:
    """(k, 3) N, forces that balance the pile without tilt.

    The tilts of a margin cancel, and friction cones are convex: the mean of their forces will do.

    Args:
        results: of :func:`check_margin`, or one result without tilt; all stable.

    Raises:
        ValueError: a result is not stable.
    """
    forces = [result.forces for result in results if result.forces is not None]
    if not forces or len(forces) < len(results):
        raise ValueError("forces of a pile that does not stand: ask stable results alone")
    mean: FloatArray = np.mean(forces, axis=0)
    return mean


def measure_margin(
    checker: StabilityChecker,
    contacts: Contacts,
    masses: ArrayLike,
    coms: ArrayLike,
    *,
    free: ArrayLike | None = None,
    cap_deg: float = TILT_CAP_DEG,
    with_mu: bool = False,
) -> Margin:
    """The tilt that the pile survives, exactly: one linear program for each direction.

    Tilted gravity is vertical gravity plus a horizontal pull t, up to a factor that equilibrium does not
    feel. So the largest t with A x = b + t d, x ≥ 0 is the tangent of the largest tilt.

    Args:
        checker: friction and solvers.
        contacts: of the whole pile.
        masses: (n,) kg.
        coms: (n, 3) m.
        free: items that may move, the others held; all where None.
        cap_deg: tilts are not followed beyond this, degrees below 90.
        with_mu: also find the smallest friction coefficient (a dozen solutions more).
    """
    directions = tilt_directions(checker.gravity)
    eq = checker.build(contacts, masses, coms, free)
    untilted = solve_highs(eq)
    tilts = np.zeros(len(directions))
    if untilted.status != "stable":
        return Margin(0.0, False, directions, tilts)
    if not eq.n_rows:
        tilts[:] = cap_deg
    else:
        most = np.tan(np.radians(cap_deg))
        # A few rows are solved faster than columns are picked.
        columns = np.arange(eq.n_columns) if eq.n_rows <= _FEW_ROWS else untilted.basis
        items, program = len(eq.free), LoadProgram(eq, columns)
        for i, direction in enumerate(directions):
            t = program.largest(level_load(items, range(items), direction), most)
            tilts[i] = cap_deg if t >= most else np.degrees(np.arctan(t))
    mu = _smallest_mu(checker, contacts, masses, coms, free) if with_mu else None
    return Margin(float(tilts.min()), True, directions, tilts, mu)


def _smallest_mu(
    checker: StabilityChecker,
    contacts: Contacts,
    masses: ArrayLike,
    coms: ArrayLike,
    free: ArrayLike | None,
) -> float:
    """Bisect: more friction never hurts. To a thousandth, from above."""
    low, high = -1e-3, float(np.max(checker.coefficients(contacts), initial=0.0))
    warm = None
    while high - low > 1e-3:
        middle = max((low + high) / 2.0, 0.0)
        answer = solve_highs(replace(checker, most=middle).build(contacts, masses, coms, free), warm)
        if answer.status == "stable":
            high, warm = middle, answer.basis
        else:
            low = middle
        if high == 0.0:
            break
    return high


def level_load(items: int, loaded: Sequence[int], direction: FloatArray) -> FloatArray:
    """(6 n,) a horizontal pull of its weight on each of some of n free items, in row units.

    Args:
        items: n.
        loaded: which of them, from 0.
        direction: (3,) unit.
    """
    load = np.zeros((items, 6))
    load[loaded, :3] = direction
    return load.ravel()


class LoadProgram:
    """How much of one load or another a pile that stands withstands: one linear program that knows its last answer.

    As in :func:`~packenv.planning.stability.solvers.solve_highs`, a program of few columns grows by those
    that its multipliers price below zero, until none is.
    """

    def __init__(self, eq: Equilibrium, columns: IntArray) -> None:
        """Begin without a load.

        Args:
            eq: the pile.
            columns: to begin with; those of :attr:`Solution.basis` of the pile without a load will do.
        """
        self._eq = eq
        self._highs = new_solver()
        self._used = np.zeros(eq.n_columns, dtype=bool)
        self._used[columns] = True
        pass_program(self._highs, eq, *eq.columns(columns))

    @property
    def columns(self) -> IntArray:
        """All that take part by now; a larger pile's program may begin with them."""
        return np.flatnonzero(self._used)

    def largest(self, load: FloatArray, most: float) -> float:
        """Largest t, up to ``most``, at which the pile stands with t · ``load`` on it.

        Args:
            load: (6 n,) forces and torques on the free items, in row units.
            most: t is not followed beyond this.
        """
        import highspy

        highs, eq = self._highs, self._eq
        rows = np.flatnonzero(load).astype(np.int32)
        t_column = highs.getNumCol()
        highs.addCol(-1.0, 0.0, most, len(rows), rows, load[rows])
        try:
            for _ in range(_ROUNDS):
                highs.run()
                if highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
                    break
                t = -float(highs.getObjectiveValue())
                if t >= most:
                    return most
                gain = eq.work(np.asarray(highs.getSolution().row_dual))
                gain[self._used] = 0.0
                entering = np.argsort(gain)[-_ENTERING:]
                entering = entering[gain[entering] > 1e-9]
                if not len(entering):
                    return t
                start, index, value = eq.columns(entering)
                n = len(entering)
                highs.addCols(
                    n, np.zeros(n), np.zeros(n), np.full(n, np.inf), len(value), start[:-1], index, value
                )
                self._used[entering] = True
            return _bisect_load(eq, load, most)
        finally:
            highs.changeColCost(t_column, 0.0)
            highs.changeColBounds(t_column, 0.0, 0.0)


def _bisect_load(eq: Equilibrium, load: FloatArray, most: float) -> float:
    """The same by asking whether the pile stands, where the linear program failed; from below."""

    def stands(t: float) -> bool:
        return solve_highs(eq.with_rhs(eq.rhs - t * load)).status == "stable"

    if stands(most):
        return most
    low, high = 0.0, most
    while high - low > 1e-4:
        middle = (low + high) / 2.0
        low, high = (middle, high) if stands(middle) else (low, middle)
    return low
