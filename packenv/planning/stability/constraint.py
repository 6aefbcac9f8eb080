"""Stability as a constraint of the planner: contacts, then force balance of the whole pile."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from packenv.geometry.distance_grids import SurfaceField
from packenv.planning.constraints import Constraint, Details, Trial, Verdict
from packenv.planning.options import ContactRule
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.planning.stability.checker import StabilityChecker, StabilityResult
from packenv.planning.stability.contact_patches import thin, tighten
from packenv.planning.stability.contacts import Body, item_contacts, join, no_contacts
from packenv.planning.stability.margins import MarginRule, check_margin, measure_margin, upright_forces
from packenv.planning.stability.paper_contacts import paper_contacts
from packenv.planning.stability.settling import settled_tilt, settles, settles_with
from packenv.types import Contacts, Container, FloatArray

ContactFinder: TypeAlias = Callable[[Body, Sequence[Body], Container, int], Contacts]


def contact_finder(rule: ContactRule, *, tight: bool) -> ContactFinder:
    """How contacts of a new item with the pile are found.

    Args:
        rule: ``surface``: surfaces at most 1.5 mm apart, thinned by patches; ``paper``: geometry scaled by
            1.03 that overlaps, merged in 1 cm cells.
        tight: tighten surface contacts to those that can touch together: a margin on contacts that only the
            threshold bridges would be no margin.
    """
    if rule == "paper":
        return lambda new, others, container, index: paper_contacts(new, others, container, index=index)
    if tight:
        return lambda new, others, container, index: thin(
            tighten(item_contacts(new, others, container, index=index))
        )
    return lambda new, others, container, index: thin(item_contacts(new, others, container, index=index))


@dataclass(frozen=True, eq=False)
class PileState:
    """A pile that stands.

    Attributes:
        bodies: its items in packing sequence.
        masses: (n,) kg.
        coms: (n, 3) m.
        contacts: all of them, thinned.
        balance: the forces that were found, one result for each direction of gravity that was asked.
        ground: how many of the first bodies are taken as part of the container.
        found: contacts of the candidates that were asked on this pile, by place: tiers ask the same ones.
    """

    bodies: tuple[Body, ...]
    masses: FloatArray
    coms: FloatArray
    contacts: Contacts
    balance: tuple[StabilityResult, ...]
    ground: int = 0
    found: dict[tuple[str, bytes, int, int, float], Contacts] = field(default_factory=dict, repr=False)


@dataclass(frozen=True, eq=False)
class StabilityConstraint(Constraint):
    """Every item of the pile in static equilibrium (paper Sec. III-A).

    Attributes:
        fields: surface of every item of the order, by name.
        masses: kg, by name.
        checker: friction and solvers.
        rule: what more the pile must survive than gravity as it is; None asks for equilibrium alone (the
            paper's rule).
        contact_rule: name of the rule that finds contacts, see :func:`contact_finder`.
        with_margin: also tell, for each placed item, the tilt that it survives while the others are held.
        alone: what the new item must survive while all others are held; None asks nothing of this kind. It
            leaves the state of the pile as it is without.
        prestress: count on contacts that only press against each other (the paper's rule); otherwise the new
            item must also settle (:mod:`packenv.planning.stability.settling`).
    """

    fields: Mapping[str, SurfaceField]
    masses: Mapping[str, float]
    checker: StabilityChecker
    rule: MarginRule | None = None
    contact_rule: ContactRule = "surface"
    with_margin: bool = False
    alone: MarginRule | None = None
    prestress: bool = False

    @property
    def name(self) -> str:
        """The word for this constraint in figures and messages."""
        return "stability"

    def start(self, resting: Sequence[Resting] = ()) -> PileState:
        """What lies at rest is taken as ground, like the floor: it proved that it stands."""
        ground = tuple(Body(self.fields[p.item.name], p.rotation, p.position) for p in resting)
        return PileState(ground, np.empty(0), np.empty((0, 3)), no_contacts(), (), len(ground))

    def check(self, trial: Trial, surface: ContainerMap, state: PileState) -> Verdict:
        """Whether the pile stands with the candidate placed."""
        name = trial.oriented.item
        box = np.stack([trial.corner, trial.corner + trial.oriented.extents])
        body = Body(self.fields[name], trial.oriented.rotation, trial.position, box)
        index = len(state.bodies) - state.ground + 1
        place = (name, trial.oriented.rotation.tobytes(), trial.ix, trial.iy, trial.z)
        own = state.found.get(place)
        if own is None:
            find = contact_finder(self.contact_rule, tight=self.rule is not None)
            own = grounded(find(body, state.bodies, surface.container, index + state.ground), state.ground)
            state.found[place] = own
        if not np.any(own.normals[:, 2] * np.where(own.second == index, 1.0, -1.0) > 0.0):
            return Verdict(False, "no-support")
        contacts = join([state.contacts, own])
        masses = np.append(state.masses, self.masses[name])
        coms = np.vstack([state.coms, trial.com])
        if self.alone is not None and not self._stands_alone(own, masses, coms):
            return Verdict(False, "unstable-margin")
        balance = self._balance(contacts, masses, coms, state.balance)
        if not balance[-1].stable:
            return Verdict(False, f"unstable-{balance[-1].decided_by}")
        if not self.prestress and not settles_with(self.checker, tighten(own), trial.com, index, self.rule):
            return Verdict(False, "unstable-new-item")
        details = Details(lambda: self._details(contacts, masses, coms, balance, index))
        pile = PileState((*state.bodies, body), masses, coms, contacts, balance, state.ground)
        return Verdict(True, state=pile, details=details)

    def _stands_alone(self, own: Contacts, masses: FloatArray, coms: FloatArray) -> bool:
        assert self.alone is not None
        checker, tight = self.alone.weakened(self.checker), tighten(own)
        pulls = self.alone.pulls(checker.gravity)
        solutions = checker.balance_alone(tight, masses, coms, pulls)
        return all(solution.status == "stable" for solution in solutions) and (
            self.prestress or settles(self.checker, tight, coms[-1], len(masses), self.alone)
        )

    def _details(
        self,
        contacts: Contacts,
        masses: FloatArray,
        coms: FloatArray,
        balance: tuple[StabilityResult, ...],
        index: int,
    ) -> dict[str, object]:
        """Where the new item is touched, with which forces on it, and how far it is from falling."""
        touching = (contacts.first == index) | (contacts.second == index)
        forces = (
            upright_forces(balance)[touching]
            * np.where(contacts.second[touching] == index, 1.0, -1.0)[:, None]
        )
        loaded = np.linalg.norm(forces, axis=1) > 1e-6 * masses[-1]
        details: dict[str, object] = {
            "decided_by": balance[0].decided_by,
            "contacts": int(touching.sum()),
            "forces": [
                {"at": [round(v, 6) for v in at], "force": [round(v, 6) for v in force]}
                for at, force in zip(
                    contacts.points[touching][loaded].tolist(), forces[loaded].tolist(), strict=True
                )
            ],
        }
        if self.with_margin:
            tight = tighten(contacts)
            survived = measure_margin(self.checker, tight, masses, coms, free=[index])
            tilt = (
                survived.tilt_deg
                if self.prestress
                else settled_tilt(self.checker, tight, coms[-1], index, survived)
            )
            details["margin_deg"] = round(tilt, 3)
        return details

    def _balance(
        self,
        contacts: Contacts,
        masses: FloatArray,
        coms: FloatArray,
        previous: tuple[StabilityResult, ...],
    ) -> tuple[StabilityResult, ...]:
        if self.rule is not None:
            return check_margin(self.checker, contacts, masses, coms, self.rule, previous=previous or None)
        return (self.checker.check(contacts, masses, coms, previous=previous[0] if previous else None),)


def grounded(contacts: Contacts, ground: int) -> Contacts:
    """Contacts with the first ``ground`` bodies as contacts with the container."""
    if not ground:
        return contacts
    first, second = (np.maximum(b - ground, 0) for b in (contacts.first, contacts.second))
    swap = second == 0
    return replace(
        contacts,
        normals=np.where(swap[:, None], -contacts.normals, contacts.normals),
        first=np.where(swap, second, first),
        second=np.where(swap, first, second),
    )
