"""Whether a pile stands (paper Sec. III-A); how far it is from falling is :mod:`packenv.planning.stability.margins`'.

The checker asks in order of cost, and stops at the first answer that is certain:

1. *new item alone*, everything else held: if no forces can carry it, the pile falls;
2. *first order*: if the container alone carries the new item, or the items that it touches carry it while all
   other forces stay as they were, the pile stands. If it falls even though all items farther away are held,
   it falls;
3. *pile*: the same with the items that those touch, and so on, ring by ring, until it is certain or most of the
   pile is in it; then the whole pile, all forces free.

Steps 2 and 3 need the forces of the pile without the new item; without them the whole pile is asked. Every
"stable" is checked once more on the whole pile, force by force, so that a stale or foreign set of forces costs
time, never a wrong answer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from packenv.planning.stability.equilibrium import (
    GRAVITY,
    LENGTH,
    TOLERANCE,
    Equilibrium,
    build_equilibrium,
    falls_alone,
    residuals,
)
from packenv.planning.stability.solvers import Solution, solve_highs, solve_nnls
from packenv.types import BoolArray, Contacts, FloatArray, IntArray

DecidedBy = Literal["new-item", "first-order", "pile"]


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


@dataclass(frozen=True)
class StabilityChecker:
    """Checks piles.

    Attributes:
        mu: coefficient of static friction of contacts that have none of their own (paper: 0.7).
        most: what is counted on of any contact's coefficient.
        sides: edges of the inscribed friction pyramid.
        gravity: (3,) m/s², container frame.
        length: m, that torques are measured by.
        tolerance: largest residual over weight, and over weight × length, that counts as balanced.
    """

    mu: float = 0.7
    most: float = np.inf
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
        alone: Solution | None = None,
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
            alone: what :meth:`balance_alone` found for ``new`` under this tilt; found here where None.

        Returns:
            The answer, with forces where stable.

        Raises:
            ValueError: there is no item ``new``.
        """
        mass = np.asarray(masses, dtype=np.float64).reshape(-1)
        com = np.asarray(coms, dtype=np.float64).reshape(-1, 3)
        if not len(mass):
            return StabilityResult(True, "", "pile", contacts, np.empty((0, 3)))
        new = _existing(new, len(mass))
        pull = np.zeros(3) if tilt is None else np.asarray(tilt, dtype=np.float64)
        if alone is None:
            (alone,) = self.balance_alone(contacts, mass, com, pull[None], new)
        if alone.status == "unstable":
            return StabilityResult(False, _FALLS_ALONE, "new-item", contacts)
        return _Question(self, contacts, mass, com, new, pull).answer(alone, previous)

    def balance_alone(
        self,
        contacts: Contacts,
        masses: ArrayLike,
        coms: ArrayLike,
        tilts: FloatArray,
        new: int | None = None,
        aside: float = 0.0,
    ) -> tuple[Solution, ...]:
        """Can the new item be balanced under each tilt while everything else is held? A necessary condition.

        Args:
            contacts: of the whole pile.
            masses: (n,) kg, n at least 1.
            coms: (n, 3) m.
            tilts: (d, 3) horizontal pulls in units of gravity.
            new: as in :meth:`check`.
            aside: how far the item's centre of mass is off in the direction of each tilt, m.

        Returns:
            One solution for each tilt; one alone, which says unstable, where the item falls under any.

        Raises:
            ValueError: there is no item ``new``.
        """
        com = np.asarray(coms, dtype=np.float64).reshape(-1, 3)
        new = _existing(new, len(com))
        own = contacts.take((contacts.first == new) | (contacts.second == new))
        # What falls, falls mostly to the side where least of the support is.
        overhang = com[new - 1] - own.points.mean(axis=0) if len(own) else np.zeros(3)
        order = np.argsort(-(tilts @ overhang), kind="stable")
        motion = falls_alone(
            own,
            com[new - 1],
            new,
            tilts[order],
            aside=aside,
            mu=self.coefficients(own),
            sides=self.sides,
            gravity=self.gravity,
            length=self.length,
            tolerance=self.tolerance,
        )
        if motion is not None:
            return (Solution("unstable", "nnls", motion=motion),)
        eq = self.build(own, masses, com, np.array([new]))
        solutions: list[Solution] = []
        for tilt in tilts:
            solution = solve_nnls(eq.tilted(tilt, aside) if tilt.any() else eq)
            if solution.status == "unstable":
                return (solution,)
            solutions.append(solution)
        return tuple(solutions)

    def build(
        self,
        contacts: Contacts,
        masses: ArrayLike,
        coms: ArrayLike,
        free: ArrayLike | None,
    ) -> Equilibrium:
        """The equilibrium of some items with this checker's settings (see :func:`build_equilibrium`)."""
        return build_equilibrium(
            contacts,
            masses,
            coms,
            mu=self.coefficients(contacts),
            sides=self.sides,
            gravity=self.gravity,
            free=free,
            length=self.length,
            tolerance=self.tolerance,
        )

    def coefficients(self, contacts: Contacts) -> FloatArray | float:
        """The coefficient of friction that is counted on: (k,) at each contact, or the one of them all."""
        if contacts.mu is None:
            return min(self.mu, self.most)
        mu: FloatArray = np.minimum(np.where(np.isnan(contacts.mu), self.mu, contacts.mu), self.most)
        return mu


_FEW = 3
"""Up to so many free items least squares takes a quarter to half of what simplex takes."""

_GROWTH = 2.0
"""How many times as many items a ring holds as the one before, at least."""

_MOST_OF_IT = 0.7
"""Rings that hold more of the pile than this are left out: the whole pile is asked at once."""

_CARRIERS_FALL = "the items that carry the new item cannot be balanced"
_FALLS_ALONE = "the new item cannot be balanced, whatever holds the items around it"


def _existing(new: int | None, n: int) -> int:
    """The body that is asked for, the last one where None."""
    new = n if new is None else new
    if not 1 <= new <= n:
        raise ValueError(f"new item {new}: give a body from 1 to {n}")
    return new


@dataclass(frozen=True, eq=False)
class _Question:
    """One pile, one new item, one direction of gravity."""

    checker: StabilityChecker
    contacts: Contacts
    mass: FloatArray
    com: FloatArray
    new: int
    tilt: FloatArray

    def answer(self, alone: Solution, previous: StabilityResult | None) -> StabilityResult:
        """The last steps of this module; ``alone`` balances the new item while all others are held."""
        touching = (self.contacts.first == self.new) | (self.contacts.second == self.new)
        known = self._known_forces(previous, touching)
        if known is not None:
            result = self._on_container(touching, alone, known) or self._in_rings(touching, known)
            if result is not None:
                return result
        return self._whole(known)

    def _on_container(
        self, touching: BoolArray, alone: Solution, known: FloatArray
    ) -> StabilityResult | None:
        """The container alone carries the new item; None where it does not."""
        on_container = touching & ((self.contacts.first == 0) | (self.contacts.second == 0))
        if not on_container.any():
            return None
        # Where the step before used nothing else, its forces will do.
        if alone.forces is None or (np.abs(alone.forces[~on_container[touching]]) > 0.0).any():
            alone = self._solve_some(np.array([self.new]), on_container, None)
        else:
            alone = replace(alone, forces=alone.forces[on_container[touching]])
        return self._yes(alone, on_container, known, "first-order")

    def _in_rings(self, touching: BoolArray, known: FloatArray) -> StabilityResult | None:
        """Change forces around the new item only, farther and farther; None where that decides nothing."""
        first, second = self.contacts.first, self.contacts.second
        inside = np.zeros(len(self.mass) + 1, dtype=bool)
        may_change, near = touching, np.empty(0, dtype=np.int64)
        by: DecidedBy = "first-order"
        while True:
            least, grown = _GROWTH * len(near), True
            while grown and (len(near) < least or not len(near)):
                inside[first[may_change]] = inside[second[may_change]] = True
                inside[0] = False
                near = np.flatnonzero(inside)
                before, may_change = may_change, inside[first] | inside[second]
                grown = not np.array_equal(before, may_change)
            if inside[1:].all() or (by == "pile" and len(near) > _MOST_OF_IT * len(self.mass)):
                return None
            within = may_change & (inside[first] | (first == 0)) & (inside[second] | (second == 0))
            answer = self._solve_some(near, within, known)
            result = self._yes(answer, within, known, by)
            if result is not None:
                return result
            # Whatever those outside push with, and if nothing can move them.
            answer = self._solve_some(near, may_change, None, known)
            if answer.status == "unstable":
                return self._no(_CARRIERS_FALL if by == "first-order" else _who_falls(answer, near), by)
            if np.array_equal(may_change, within):
                return None
            by = "pile"

    def _whole(self, known: FloatArray | None) -> StabilityResult:
        """All forces free."""
        everything = np.ones(len(self.contacts), dtype=bool)
        answer = self._solve_some(np.arange(1, len(self.mass) + 1), everything, None, known)
        if answer.status == "stable":
            assert answer.forces is not None
            return StabilityResult(True, "", "pile", self.contacts, answer.forces)
        if answer.status == "undecided":
            return self._no("no solver could tell whether the pile stands", "pile")
        return self._no(_who_falls(answer, np.arange(1, len(self.mass) + 1)), "pile")

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
        some = self.contacts.take(which)
        eq = self.checker.build(some, self.mass, self.com, free)
        if fixed is not None:
            kept = np.where(which[:, None], 0.0, fixed)
            eq = eq.with_rhs(-self._residuals(kept)[free - 1].ravel())
        elif self.tilt.any():
            eq = eq.tilted(self.tilt)
        if len(free) <= _FEW:
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
        most = self.checker.coefficients(self.contacts) * push
        return bool((friction <= most * (1.0 + 1e-9) + 1e-12).all())

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
        now = _keys(self.contacts.take(kept))
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


def _who_falls(answer: Solution, free: IntArray) -> str:
    """Name the item that moves most in the motion that proves instability.

    Args:
        answer: of the balance of some items.
        free: their bodies.
    """
    if answer.motion is None:
        return "no forces balance the pile"
    moved = np.abs(answer.motion.reshape(-1, 6)).sum(axis=1)
    return f"no forces balance the pile: item {int(free[np.argmax(moved)])} would move most"
