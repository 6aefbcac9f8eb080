"""Whether a pile stands, and by how much (paper Sec. III-A).

The checker asks in order of cost, and stops at the first answer that is certain:

1. *new item alone*, everything else held: if no forces can carry it, the pile falls;
2. *first order*: if the container alone carries the new item, or the items that it touches carry it while all
   other forces stay as they were, the pile stands. If it falls even though all items farther away are held,
   it
   falls;
3. *whole pile*, all forces free.

Step 2 needs the forces of the pile without the new item. Every "stable" is checked once more on the whole
pile,
force by force, so that a stale or foreign set of forces costs time, never a wrong answer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from packenv.planning.equilibrium import (
    GRAVITY,
    LENGTH,
    TOLERANCE,
    Equilibrium,
    build_equilibrium,
    residuals,
    take,
)
from packenv.planning.equilibrium_solvers import (
    Solution,
    highs_solver,
    pass_program,
    solve_highs,
    solve_nnls,
)
from packenv.types import BoolArray, Contacts, FloatArray, IntArray

DecidedBy = Literal["new-item", "first-order", "pile"]
Rule = Literal["paper", "margin"]

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


@dataclass(frozen=True, eq=False)
class StabilityResult:
    """Whether a pile stands under one direction of gravity.

    Attributes:
        stable: True where forces were found.
        reason: one phrase for people; empty where stable.
        decided_by: the step that was certain first: ``new-item``, ``first-order`` or ``pile``.
        contacts: the contacts that were given.
        forces: (k, 3) N on the second body of each contact, balancing the whole pile; None unless stable.
    """

    stable: bool
    reason: str
    decided_by: DecidedBy
    contacts: Contacts
    forces: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Margin:
    """How far a pile is from falling.

    Attributes:
        tilt_deg: the pile survives gravity tilted by this much in each direction; 0 also where it does not
            stand at all, and never above the cap.
        stable: True where it stands without tilt.
        directions: (d, 3) unit, where the horizontal part of tilted gravity points.
        tilts_deg: (d,) tilt that the pile survives in each direction.
        mu: smallest friction coefficient at which the untilted pile stands; None where not asked or unstable.
    """

    tilt_deg: float
    stable: bool
    directions: FloatArray
    tilts_deg: FloatArray
    mu: float | None = None


def tilt_directions(gravity: ArrayLike = GRAVITY, n: int = N_DIRECTIONS) -> FloatArray:
    """(n, 3) unit vectors across gravity, evenly spread; the first along x where gravity is vertical."""
    pull = np.asarray(gravity, dtype=np.float64)
    up = -pull / np.linalg.norm(pull)
    axis = np.zeros(3)
    # As in the pyramids, so that the tilts of a flat contact point along edges.
    axis[int(np.argmin(np.abs(up)))] = 1.0
    first = axis - (axis @ up) * up
    first /= np.linalg.norm(first)
    second = np.cross(up, first)
    angles = 2.0 * np.pi * np.arange(n) / n
    directions: FloatArray = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    return directions


@dataclass(frozen=True)
class StabilityChecker:
    """Checks piles with one friction coefficient.

    Attributes:
        mu: coefficient of static friction (paper: 0.7).
        sides: edges of the inscribed friction pyramid.
        gravity: (3,) m/s², container frame.
        length: m, that torques are measured by.
        tolerance: largest residual over weight, and over weight × length, that counts as balanced.
    """

    mu: float = 0.7
    sides: int = 8
    gravity: tuple[float, float, float] = GRAVITY
    length: float = LENGTH
    tolerance: float = TOLERANCE

    def check(
        self,
        contacts: Contacts,
        masses: ArrayLike,
        coms: ArrayLike,
        new: int | None = None,
        previous: StabilityResult | None = None,
        tilt: ArrayLike | None = None,
    ) -> StabilityResult:
        """Does the whole pile stand?

        Args:
            contacts: of the whole pile.
            masses: (n,) kg.
            coms: (n, 3) m.
            new: the body whose placement is asked; the last one where None.
            previous: the stable result, under the same tilt, of the pile without ``new``. Contacts between
                its items must be among ``contacts``; otherwise it is not used.
            tilt: (3,) horizontal pull in units of gravity; none where None.

        Returns:
            The answer, with forces where stable.
        """
        mass = np.asarray(masses, dtype=np.float64).reshape(-1)
        com = np.asarray(coms, dtype=np.float64).reshape(-1, 3)
        if not len(mass):
            return StabilityResult(True, "", "pile", contacts, np.empty((0, 3)))
        new = len(mass) if new is None else new
        if not 1 <= new <= len(mass):
            raise ValueError(f"new item {new}: give a body from 1 to {len(mass)}")
        question = _Question(
            self, contacts, mass, com, new, np.zeros(3) if tilt is None else np.asarray(tilt)
        )
        return question.answer(previous)

    def check_margin(
        self,
        contacts: Contacts,
        masses: ArrayLike,
        coms: ArrayLike,
        new: int | None = None,
        previous: tuple[StabilityResult, ...] | None = None,
        tilt_deg: float = 5.0,
    ) -> tuple[StabilityResult, ...]:
        """Does the pile stand under gravity tilted by ``tilt_deg``, whichever way?

        The pulls that a pile survives are a convex set, so what survives all eight tilts also stands without,
        and under any smaller tilt in their octagon.

        Args:
            contacts: of the whole pile.
            masses: (n,) kg.
            coms: (n, 3) m.
            new: as in :meth:`check`.
            previous: what this method returned for the pile without ``new``.
            tilt_deg: degrees.

        Returns:
            One result for each direction while they are stable; the last one says no where the pile falls.
        """
        pulls = np.tan(np.radians(tilt_deg)) * tilt_directions(self.gravity)
        results: list[StabilityResult] = []
        for i, pull in enumerate(pulls):
            before = previous[i] if previous is not None and i < len(previous) else None
            result = self.check(contacts, masses, coms, new, before, pull)
            results.append(result)
            if not result.stable:
                break
        return tuple(results)

    def is_stable(
        self,
        contacts: Contacts,
        masses: ArrayLike,
        coms: ArrayLike,
        new: int | None = None,
        rule: Rule = "paper",
        tilt_deg: float = 5.0,
    ) -> bool:
        """One word: by the paper's rule (it stands), or by a margin (it stands tilted by ``tilt_deg``)."""
        if rule == "paper":
            return self.check(contacts, masses, coms, new).stable
        if rule == "margin":
            return self.check_margin(contacts, masses, coms, new, tilt_deg=tilt_deg)[-1].stable
        raise ValueError(f"stability rule {rule!r}: give 'paper' or 'margin'")

    def margin(
        self,
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
            contacts: of the whole pile.
            masses: (n,) kg.
            coms: (n, 3) m.
            free: items that may move, the others held; all where None.
            cap_deg: tilts are not followed beyond this, degrees below 90.
            with_mu: also find the smallest friction coefficient (a dozen solutions more).
        """
        directions = tilt_directions(self.gravity)
        eq = self.build(contacts, masses, coms, free)
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
            for i, direction in enumerate(directions):
                t, columns = _largest_pull(eq, direction, most, columns)
                tilts[i] = cap_deg if t >= most else np.degrees(np.arctan(t))
        mu = self._smallest_mu(contacts, masses, coms, free) if with_mu else None
        return Margin(float(tilts.min()), True, directions, tilts, mu)

    def build(
        self,
        contacts: Contacts,
        masses: ArrayLike,
        coms: ArrayLike,
        free: ArrayLike | None,
        mu: float | None = None,
    ) -> Equilibrium:
        """The equilibrium of some items with this checker's settings (see :func:`build_equilibrium`)."""
        return build_equilibrium(
            contacts,
            masses,
            coms,
            mu=self.mu if mu is None else mu,
            sides=self.sides,
            gravity=self.gravity,
            free=free,
            length=self.length,
            tolerance=self.tolerance,
        )

    def _smallest_mu(
        self, contacts: Contacts, masses: ArrayLike, coms: ArrayLike, free: ArrayLike | None
    ) -> float:
        """Bisect: more friction never hurts. To a thousandth, from above."""
        low, high = -1e-3, self.mu
        warm = None
        while high - low > 1e-3:
            middle = max((low + high) / 2.0, 0.0)
            answer = solve_highs(self.build(contacts, masses, coms, free, middle), warm)
            if answer.status == "stable":
                high, warm = middle, answer.basis
            else:
                low = middle
            if high == 0.0:
                break
        return high


@dataclass(frozen=True, eq=False)
class _Question:
    """One pile, one new item, one direction of gravity."""

    checker: StabilityChecker
    contacts: Contacts
    mass: FloatArray
    com: FloatArray
    new: int
    tilt: FloatArray

    def answer(self, previous: StabilityResult | None) -> StabilityResult:
        """The three steps of this module."""
        touching = (self.contacts.first == self.new) | (self.contacts.second == self.new)
        alone = self._solve_some(np.array([self.new]), touching, None)
        if alone.status == "unstable":
            return self._no("the new item cannot be balanced, whatever holds the items around it", "new-item")

        known = self._known_forces(previous, touching)
        if known is not None:
            result = self._first_order(touching, alone, known)
            if result is not None:
                return result
        return self._whole(known)

    def _first_order(self, touching: BoolArray, alone: Solution, known: FloatArray) -> StabilityResult | None:
        """Change forces around the new item only; None where that decides nothing."""
        first, second = self.contacts.first, self.contacts.second
        on_container = touching & ((first == 0) | (second == 0))
        if on_container.any():
            # Where the step before used nothing else, its forces will do.
            if alone.forces is None or (np.abs(alone.forces[~on_container[touching]]) > 0.0).any():
                alone = self._solve_some(np.array([self.new]), on_container, None)
            else:
                alone = replace(alone, forces=alone.forces[on_container[touching]])
            result = self._yes(alone, on_container, known, "first-order")
            if result is not None:
                return result
        near = np.union1d(first[touching], second[touching])
        near = near[near > 0]
        if len(near) == len(self.mass):
            return None
        inside = np.zeros(len(self.mass) + 1, dtype=bool)
        inside[near] = True
        may_change = inside[first] | inside[second]
        within = may_change & (inside[first] | (first == 0)) & (inside[second] | (second == 0))
        answer = self._solve_some(near, within, known)
        result = self._yes(answer, within, known, "first-order")
        if result is not None:
            return result
        if self._solve_some(near, may_change, None, known).status == "unstable":
            return self._no("the items that carry the new item cannot be balanced", "first-order")
        return None

    def _whole(self, known: FloatArray | None) -> StabilityResult:
        """All forces free."""
        everything = np.ones(len(self.contacts), dtype=bool)
        answer = self._solve_some(np.arange(1, len(self.mass) + 1), everything, None, known)
        if answer.status == "stable":
            assert answer.forces is not None
            return StabilityResult(True, "", "pile", self.contacts, answer.forces)
        if answer.status == "undecided":
            return self._no("no solver could tell whether the pile stands", "pile")
        return self._no(_who_falls(answer), "pile")

    def _solve_some(
        self, free: IntArray, which: BoolArray, fixed: FloatArray | None, seed: FloatArray | None = None
    ) -> Solution:
        """Balance the items ``free`` by forces at the contacts ``which``.

        Args:
            free: bodies.
            which: (k,) contacts whose forces are looked for.
            fixed: (k, 3) forces that all other contacts keep; they carry nothing where None.
            seed: (k, 3) forces near which to begin, ``fixed`` where None.
        """
        some = take(self.contacts, which)
        eq = self.checker.build(some, self.mass, self.com, free)
        if fixed is not None:
            kept = np.where(which[:, None], 0.0, fixed)
            eq = eq.with_rhs(-self._residuals(kept)[free - 1].ravel())
        elif self.tilt.any():
            eq = eq.tilted(self.tilt)
        if len(free) == 1:
            return solve_nnls(eq)
        seed = fixed if seed is None else seed
        if seed is None:
            return solve_highs(eq)
        loaded = (
            (np.abs(seed[which]) > 0.0).any(axis=1) | (some.first == self.new) | (some.second == self.new)
        )
        columns = np.flatnonzero(np.repeat(loaded, self.checker.sides))
        return solve_highs(eq, columns)

    def _residuals(self, forces: FloatArray) -> FloatArray:
        """(n, 6) of the whole pile, tilt included."""
        checker = self.checker
        left = residuals(
            self.contacts, forces, self.mass, self.com, gravity=checker.gravity, length=checker.length
        )
        left[:, :3] += self.tilt
        return left

    def _yes(
        self, answer: Solution, which: BoolArray, known: FloatArray, by: DecidedBy
    ) -> StabilityResult | None:
        """Join found forces with known ones, and believe them if the whole pile balances."""
        if answer.forces is None:
            return None
        forces = known.copy()
        forces[which] = answer.forces
        limit = self.checker.tolerance * (1.0 + 1e-2)
        if np.abs(self._residuals(forces)).max() > limit or not self._pushing(forces):
            return None
        return StabilityResult(True, "", by, self.contacts, forces)

    def _pushing(self, forces: FloatArray) -> bool:
        """True where every force is inside its friction cone."""
        normals = self.contacts.normals
        push = np.einsum("ij,ij->i", forces, normals)
        friction = np.linalg.norm(forces - push[:, None] * normals, axis=1)
        return bool((friction <= self.checker.mu * push * (1.0 + 1e-9) + 1e-12).all())

    def _known_forces(self, previous: StabilityResult | None, touching: BoolArray) -> FloatArray | None:
        """Forces of the pile before, at the contacts of now; zero at those of the new item."""
        if previous is None or previous.forces is None:
            return None
        old, old_forces = previous.contacts, previous.forces
        kept = np.flatnonzero(~touching)
        known = np.zeros((len(self.contacts), 3))
        if len(kept) == len(old) and np.array_equal(self.contacts.points[kept], old.points):
            known[kept] = old_forces
            return known
        where = {key: i for i, key in enumerate(_keys(old))}
        now = _keys(take(self.contacts, kept))
        if len(where) != len(old) or not set(where) <= set(now):
            return None
        for position, key in zip(kept, now, strict=True):
            if key in where:
                known[position] = old_forces[where[key]]
        return known

    def _no(self, reason: str, by: DecidedBy) -> StabilityResult:
        return StabilityResult(False, reason, by, self.contacts)


def _keys(contacts: Contacts) -> list[bytes]:
    """One name for each contact: its bodies and its point."""
    rows = np.column_stack([contacts.first, contacts.second, contacts.points])
    return [row.tobytes() for row in rows]


def _who_falls(answer: Solution) -> str:
    """Name the item that moves most in the motion that proves instability."""
    if answer.motion is None:
        return "no forces balance the pile"
    moved = np.abs(answer.motion.reshape(-1, 6)).sum(axis=1)
    return f"no forces balance the pile: item {int(np.argmax(moved)) + 1} would move most"


def _largest_pull(
    eq: Equilibrium, direction: FloatArray, most: float, columns: IntArray
) -> tuple[float, IntArray]:
    """Largest t, up to ``most``, at which the pile stands with the pull t · ``direction``.

    As in :func:`~packenv.planning.equilibrium_solvers.solve_highs`, a program of few columns grows by those
    that its multipliers price below zero, until none is.

    Returns:
        t, and all columns of the last program, with which the next direction may begin.
    """
    import highspy

    highs = highs_solver()
    chosen = columns
    start, index, value = eq.columns(chosen)
    pull = np.zeros((len(eq.free), 6))
    pull[:, :3] = direction
    rows = np.flatnonzero(pull.ravel()).astype(np.int32)
    start = np.append(start, start[-1] + len(rows)).astype(np.int32)
    index = np.append(index, rows).astype(np.int32)
    value = np.append(value, pull.ravel()[rows])
    t_column = len(chosen)
    pass_program(highs, eq, start, index, value, maximise=t_column)
    highs.changeColBounds(t_column, 0.0, most)
    positions = [chosen]
    for _ in range(_ROUNDS):
        highs.run()
        if highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            break
        solution = highs.getSolution()
        x = np.asarray(solution.col_value)
        used = np.concatenate(positions)
        t = float(x[t_column])
        if t >= most:
            return most, used
        gain = eq.work(np.asarray(solution.row_dual))
        gain[used] = 0.0
        entering = np.argsort(gain)[-_ENTERING:]
        entering = entering[gain[entering] > 1e-9]
        if not len(entering):
            return t, used
        start, index, value = eq.columns(entering)
        n = len(entering)
        highs.addCols(n, np.zeros(n), np.zeros(n), np.full(n, np.inf), len(value), start[:-1], index, value)
        positions.append(entering)
    return _bisect_pull(eq, direction, most), columns


def _bisect_pull(eq: Equilibrium, direction: FloatArray, most: float) -> float:
    """The same by asking whether the pile stands, where the linear program failed; from below."""
    low, high = 0.0, most
    while high - low > 1e-4:
        middle = (low + high) / 2.0
        if solve_highs(eq.tilted(middle * direction)).status == "stable":
            low = middle
        else:
            high = middle
    return low
