"""What rests on each item of a pile, and whether it bears it.

An item rests on another where that one can push it upwards, or, where nothing does, on all that it touches. Every
item that rests on a limited one, straight or by way of others, counts with its whole mass: no pile that is let go
puts more on it, unless something is squeezed in. Where this is too much, and some of them rest on others, too, a
linear programme over the contact forces of the force balance (paper Sec. III-A) tells the most that can be on it:
the largest downward push among all forces that balance the items above it, whatever holds them. Forces that only
press against each other can make that as large as one likes, so the lesser of the two bounds counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from packenv.geometry.distance_grids import SurfaceField
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.search.candidates import Candidates
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.planning.stability.barred_cells import on_barred, with_barred
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contact_finder import ContactFinder
from packenv.planning.stability.contacts import Body
from packenv.planning.stability.equilibrium import Equilibrium
from packenv.planning.stability.equilibrium_kernels import least_squares
from packenv.planning.stability.solvers import highs_solver, pass_program
from packenv.types import BoolArray, Contacts, Container, Float32Array, FloatArray, Item

OVERLOAD = "overload"
"""The word against a candidate with which an item would bear more than it may."""

CARRIES = 0.05
"""Least upward part of a contact's normal that carries: 3° off a wall. Steeper, friction alone would."""

SLACK = 1e-6
"""How much more than it may an item may bear, kg: rounding."""


@dataclass(frozen=True, eq=False)
class Balanced:
    """What the linear programme needs of a pile: all its contacts, some first bodies taken as the container.

    Attributes:
        checker: friction.
        contacts: of the pile.
        masses: (n,) kg.
        coms: (n, 3) m.
        ground: how many first bodies are none of the n.
    """

    checker: StabilityChecker
    contacts: Contacts
    masses: FloatArray
    coms: FloatArray
    ground: int = 0


@dataclass(frozen=True, eq=False)
class Loads:
    """A pile as far as it matters for what rests on what.

    Attributes:
        items: in packing sequence, those that lay there before first.
        rests_on: of each item, those that it rests on, numbered as in :class:`Contacts`: 0 is the container; None
            while no item is limited, for then nobody looks.
        balanced: the pile for the linear programme, where forces are asked for.
        barred: (nx, ny) heights of cells on which nothing may lie, m, -inf elsewhere; None where there are none.
    """

    items: tuple[Resting, ...] = ()
    rests_on: tuple[frozenset[int], ...] | None = None
    balanced: Balanced | None = None
    barred: Float32Array | None = None

    def refused(self, candidates: Candidates) -> BoolArray | None:
        """(n,) candidates that would lie on what bears nothing; None where there is no such item."""
        return None if self.barred is None else on_barred(candidates, self.barred)


@dataclass(frozen=True, eq=False)
class LoadLimits:
    """The rule that no item bears more than it may.

    Attributes:
        shapes: the items by name, as the geometry that is planned with.
        fields: their surfaces.
        find: how contacts are found.
    """

    shapes: Mapping[str, Item]
    fields: Mapping[str, SurfaceField]
    find: ContactFinder

    def after(
        self,
        loads: Loads,
        trial: Trial,
        surface: ContainerMap,
        own: Contacts | None = None,
        balanced: Balanced | None = None,
    ) -> Loads | None:
        """The pile with a candidate placed; None where an item would then bear more than it may.

        Args:
            loads: the pile without it.
            trial: the candidate.
            surface: the container heightmap without it.
            own: contacts of the item with the pile, where they are known.
            balanced: the pile with it, for the linear programme; None bounds loads by masses alone.
        """
        item = self.shapes[trial.oriented.item]
        placed = Resting(item, trial.oriented.rotation, trial.position)
        found = self.with_item(loads, placed, surface.container, own, balanced)
        if found is None:
            return None
        nx, ny = surface.heights.shape
        barred = loads.barred if item.limits.bears else with_barred(loads.barred, trial, (nx, ny))
        return replace(found, barred=barred)

    def with_item(
        self,
        loads: Loads,
        placed: Resting,
        container: Container,
        own: Contacts | None = None,
        balanced: Balanced | None = None,
    ) -> Loads | None:
        """As :meth:`after`, with an item at any pose, of which no cells are known."""
        items = (*loads.items, placed)
        if loads.rests_on is None:
            if np.isfinite(placed.item.limits.bears) or _limited(loads.items):
                return self._with_all(items, container, own, balanced)
            return Loads(items)
        if own is None:
            own = self._contacts(items, len(items), container)
        return _checked(items, with_supports(loads.rests_on, own, len(items)), balanced)

    def _with_all(
        self,
        items: tuple[Resting, ...],
        container: Container,
        own: Contacts | None,
        balanced: Balanced | None,
    ) -> Loads | None:
        """The first time that a limited item is there: who rests on whom among all."""
        known: tuple[frozenset[int], ...] = ()
        for count in range(1, len(items) + 1):
            last = own if count == len(items) else None
            known = with_supports(known, last or self._contacts(items, count, container), count)
        return _checked(items, known, balanced)

    def _contacts(self, items: Sequence[Resting], count: int, container: Container) -> Contacts:
        bodies = [
            Body(self.fields[p.item.name], p.rotation, p.position, friction=p.item.friction)
            for p in items[:count]
        ]
        return self.find(bodies[-1], bodies[:-1], container, count)


def _limited(items: Sequence[Resting]) -> bool:
    return any(np.isfinite(placed.item.limits.bears) for placed in items)


def with_supports(known: tuple[frozenset[int], ...], own: Contacts, new: int) -> tuple[frozenset[int], ...]:
    """Who rests on whom, with one more item.

    Args:
        known: without it.
        own: its contacts.
        new: its number.
    """
    rests_on = [*known, frozenset[int]()]
    into_second = own.normals[:, 2]
    rises = np.where(own.second == new, into_second, -into_second)
    other = np.where(own.second == new, own.first, own.second)
    carrying = other[rises > CARRIES]
    beneath = carrying if len(carrying) else other
    rests_on[new - 1] = frozenset(np.unique(beneath).tolist())
    for above in np.unique(other[-rises > CARRIES]).tolist():
        if above > 0:
            rests_on[above - 1] |= {new}
    return tuple(rests_on)


def _checked(
    items: tuple[Resting, ...], rests_on: tuple[frozenset[int], ...], balanced: Balanced | None
) -> Loads | None:
    for number, load, above in _burdens(items, rests_on):
        bears = items[number - 1].item.limits.bears + SLACK
        if load <= bears:
            continue
        alone = above - resting_on(0, rests_on, without=number)
        shared = balanced is not None and bears > SLACK and _mass(items, alone) <= bears
        if balanced is None or not shared or may_bear(balanced, number, above, bears):
            return None
    return Loads(items, rests_on, balanced)


def _burdens(
    items: Sequence[Resting], rests_on: Sequence[frozenset[int]]
) -> Iterator[tuple[int, float, frozenset[int]]]:
    """The number of each limited item, the mass of what rests on it, kg, and what that is."""
    for number, placed in enumerate(items, start=1):
        if np.isfinite(placed.item.limits.bears):
            above = resting_on(number, rests_on)
            yield number, _mass(items, above), above


def loads_borne(
    items: Sequence[Resting], rests_on: Sequence[frozenset[int]], balanced: Balanced | None
) -> dict[int, float]:
    """What rests on each limited item of a pile at most, by number, kg.

    Args:
        items: of the pile.
        rests_on: of each, those that it rests on.
        balanced: the pile for the linear programme, which is asked where masses alone are too much.
    """
    borne = {}
    for number, load, above in _burdens(items, rests_on):
        bears = items[number - 1].item.limits.bears
        if load > bears + SLACK and bears > 0.0 and balanced is not None:
            load = min(load, largest_load(balanced, number, above))
        borne[number] = load
    return borne


def _mass(items: Sequence[Resting], which: frozenset[int]) -> float:
    return sum(items[number - 1].item.mass for number in which)


def resting_on(number: int, rests_on: Sequence[frozenset[int]], without: int | None = None) -> frozenset[int]:
    """The items that rest on one, straight or by way of others.

    Args:
        number: the item, from 1, or 0 for the container.
        rests_on: of each item, those that it rests on.
        without: an item that is left out, so that what rests on it alone rests on nothing.
    """
    found: set[int] = set()
    waiting = [number]
    while waiting:
        below = waiting.pop()
        above = {k for k, beneath in enumerate(rests_on, start=1) if below in beneath}
        above -= {number, without, *found}
        found |= above
        waiting += above
    return frozenset(found)


def largest_load(pile: Balanced, number: int, above: frozenset[int]) -> float:
    """The most that forces which balance what rests on an item push it down by, kg; infinite without a bound.

    Args:
        pile: the pile.
        number: the item.
        above: what rests on it; all else is held.
    """
    import highspy

    found = _pushes(pile, number, above)
    if found is None:
        return np.inf
    eq, pushes = found
    highs = highs_solver()
    pass_program(highs, eq, eq.start, eq.index, eq.value, cost=-pushes)
    highs.run()
    if highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
        return np.inf
    return -float(highs.getInfo().objective_function_value)


def may_bear(pile: Balanced, number: int, above: frozenset[int], kg: float) -> bool:
    """Whether forces that balance what rests on an item may push it down by so much.

    The same question as :func:`largest_load`, as one row more of a least-squares problem: a tenth of the time.

    Args:
        pile: the pile.
        number: the item.
        above: what rests on it; all else is held.
        kg: above 0.

    Returns:
        False where it is proved that they cannot.
    """
    found = _pushes(pile, number, above)
    if found is None:
        return True
    eq, pushes = found
    columns = np.zeros((eq.n_columns + 1, eq.n_rows + 1))
    columns[:-1, :-1], columns[:-1, -1], columns[-1, -1] = eq.dense.T, pushes / kg, -1.0
    x, left = np.empty(len(columns)), np.empty(eq.n_rows + 1)
    ended = least_squares(columns, np.append(eq.rhs, 1.0), 3 * len(columns), x, left)
    return not ended or float(np.abs(left).max()) <= eq.tolerance


def _pushes(pile: Balanced, number: int, above: frozenset[int]) -> tuple[Equilibrium, FloatArray] | None:
    """The balance of what rests on an item, and what each of its columns pushes the item down by, kg.

    None where something of it is ground, of which no force is known.
    """
    body, free = number - pile.ground, np.array(sorted(above)) - pile.ground
    if min(body, free.min()) < 1:
        return None
    eq = pile.checker.build(pile.contacts, pile.masses, pile.coms, free)
    contacts = eq.contacts
    into = np.where(contacts.second == body, 1.0, -1.0)
    pressed = ((contacts.second == body) | (contacts.first == body)) & (
        into * contacts.normals[:, 2] < -CARRIES
    )
    newtons = -eq.edges[:, :, 2] * (into * eq.units)[:, None]
    gravity = float(np.linalg.norm(pile.checker.gravity))
    return eq, np.where(pressed[:, None], newtons, 0.0).ravel() / gravity


@dataclass(frozen=True, eq=False)
class LoadConstraint(Constraint):
    """The rule alone, where nobody asks whether the pile stands."""

    limits: LoadLimits

    @property
    def name(self) -> str:
        """The word for this constraint in figures and messages."""
        return "loads"

    def start(self, resting: Sequence[Resting] = ()) -> Loads:
        """What lies there."""
        return Loads(tuple(resting))

    @property
    def refusal(self) -> str:
        """The word for what would lie on an item that bears nothing."""
        return OVERLOAD

    def refused(self, candidates: Candidates, state: Loads) -> BoolArray | None:
        """What would lie on an item that bears nothing."""
        return state.refused(candidates)

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        """Whether every item bears what would rest on it."""
        loads = self.limits.after(state, trial, surface)
        if loads is None:
            return Verdict(False, OVERLOAD)
        return Verdict(True, state=loads, details=loads_details(loads))


def loads_details(loads: Loads) -> dict[str, object]:
    """What limited items bear at most, for the figures of a plan; empty where nothing is limited."""
    if loads.rests_on is None:
        return {}
    borne = loads_borne(loads.items, loads.rests_on, loads.balanced)
    return {"loads": [{"step": step, "kg": round(kg, 6)} for step, kg in borne.items()]}
