"""Stability as a constraint of the planner: contacts, then force balance of the whole pile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from packenv.geometry.distance_grids import SurfaceField
from packenv.planning.constraints import Constraint, Details, Trial, Verdict
from packenv.planning.options import ContactRule
from packenv.planning.search.candidates import Candidates
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.planning.stability.checker import StabilityChecker, StabilityResult
from packenv.planning.stability.contact_finder import contact_finder, grounded
from packenv.planning.stability.contact_patches import tighten
from packenv.planning.stability.contacts import Body, join, no_contacts
from packenv.planning.stability.loads import OVERLOAD, Balanced, LoadLimits, Loads, loads_details
from packenv.planning.stability.margins import MarginRule, check_margin, measure_margin, upright_forces
from packenv.planning.stability.settling import settled_tilt, settles, settles_with
from packenv.planning.stability.solvers import Solution
from packenv.types import BoolArray, Contacts, FloatArray, Item


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
        loads: what rests on what.
        found: contacts of the candidates that were asked on this pile, by place: tiers ask the same ones. Ground
            is told apart in them.
    """

    bodies: tuple[Body, ...]
    masses: FloatArray
    coms: FloatArray
    contacts: Contacts
    balance: tuple[StabilityResult, ...]
    ground: int = 0
    loads: Loads = field(default_factory=Loads)
    found: dict[tuple[str, bytes, int, int, float], Contacts] = field(default_factory=dict, repr=False)


@dataclass(frozen=True, eq=False)
class StabilityConstraint(Constraint):
    """Every item of the pile in static equilibrium (paper Sec. III-A).

    Attributes:
        fields: surface of every item of the order, by name.
        shapes: the items by name, as the geometry that is planned with.
        checker: friction and solvers.
        rule: what more the pile must survive than gravity as it is; None asks for equilibrium alone (the
            paper's rule).
        contact_rule: name of the rule that finds contacts, see :func:`contact_finder`.
        with_margin: also tell, for each placed item, the tilt that it survives while the others are held.
        alone: what the new item must survive while all others are held; None asks nothing of this kind. It
            leaves the state of the pile as it is without.
        prestress: count on contacts that only press against each other (the paper's rule); otherwise the new
            item must also settle (:mod:`packenv.planning.stability.settling`).
        loads: what items bear; None where none is limited.
    """

    fields: Mapping[str, SurfaceField]
    shapes: Mapping[str, Item]
    checker: StabilityChecker
    rule: MarginRule | None = None
    contact_rule: ContactRule = "surface"
    with_margin: bool = False
    alone: MarginRule | None = None
    prestress: bool = False
    loads: LoadLimits | None = None

    @property
    def name(self) -> str:
        """The word for this constraint in figures and messages."""
        return "stability"

    def start(self, resting: Sequence[Resting] = ()) -> PileState:
        """What lies at rest is taken as ground, like the floor: it proved that it stands."""
        ground = tuple(
            Body(self.fields[p.item.name], p.rotation, p.position, friction=p.item.friction) for p in resting
        )
        loads = Loads(tuple(resting))
        return PileState(ground, np.empty(0), np.empty((0, 3)), no_contacts(), (), len(ground), loads)

    @property
    def refusal(self) -> str:
        """The word for what would lie on an item that bears nothing."""
        return OVERLOAD

    def refused(self, candidates: Candidates, state: PileState) -> BoolArray | None:
        """What would lie on an item that bears nothing."""
        return state.loads.refused(candidates)

    def check(self, trial: Trial, surface: ContainerMap, state: PileState) -> Verdict:
        """Whether the pile stands with the candidate placed."""
        name = trial.oriented.item
        box = np.stack([trial.corner, trial.corner + trial.oriented.extents])
        item = self.shapes[name]
        body = Body(self.fields[name], trial.oriented.rotation, trial.position, box, item.friction)
        index = len(state.bodies) - state.ground + 1
        place = (name, trial.oriented.rotation.tobytes(), trial.ix, trial.iy, trial.z)
        touched = state.found.get(place)
        if touched is None:
            find = contact_finder(self.contact_rule, self.checker.mu, tight=self.rule is not None)
            touched = state.found[place] = find(body, state.bodies, surface.container, index + state.ground)
        own = grounded(touched, state.ground)
        if not np.any(own.normals[:, 2] * np.where(own.second == index, 1.0, -1.0) > 0.0):
            return Verdict(False, "no-support")
        contacts = join([state.contacts, own])
        masses = np.append(state.masses, item.mass)
        coms = np.vstack([state.coms, trial.com])
        loads = state.loads
        if self.loads is not None:
            pile = Balanced(self.checker, contacts, masses, coms, state.ground)
            borne = self.loads.after(loads, trial, surface, touched, pile)
            if borne is None:
                return Verdict(False, OVERLOAD)
            loads = borne
        if self.alone is not None and not self._stands_alone(own, masses, coms):
            return Verdict(False, "unstable-margin")
        # What is asked of the new item alone takes less time than what is asked of the pile.
        alone = self._alone(contacts, masses, coms)
        if alone[-1].status == "unstable" or not (
            self.prestress or settles_with(self.checker, tighten(own), trial.com, index, self.rule)
        ):
            return Verdict(False, "unstable-new-item")
        balance = self._balance(contacts, masses, coms, state.balance, alone)
        if not balance[-1].stable:
            return Verdict(False, f"unstable-{balance[-1].decided_by}")
        details = Details(
            lambda: self._details(contacts, masses, coms, balance, index) | loads_details(loads)
        )
        after = PileState((*state.bodies, body), masses, coms, contacts, balance, state.ground, loads)
        return Verdict(True, state=after, details=details)

    def _stands_alone(self, own: Contacts, masses: FloatArray, coms: FloatArray) -> bool:
        assert self.alone is not None
        tight = tighten(own)
        solutions = self.alone.alone(self.checker, tight, masses, coms)
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

    def _alone(self, contacts: Contacts, masses: FloatArray, coms: FloatArray) -> tuple[Solution, ...]:
        """The new item balanced while all others are held, under each direction of gravity that is asked."""
        if self.rule is not None:
            return self.rule.alone(self.checker, contacts, masses, coms)
        return self.checker.balance_alone(contacts, masses, coms, np.zeros((1, 3)))

    def _balance(
        self,
        contacts: Contacts,
        masses: FloatArray,
        coms: FloatArray,
        previous: tuple[StabilityResult, ...],
        alone: tuple[Solution, ...],
    ) -> tuple[StabilityResult, ...]:
        if self.rule is not None:
            before = previous or None
            return check_margin(self.checker, contacts, masses, coms, self.rule, previous=before, alone=alone)
        before_it = previous[0] if previous else None
        return (self.checker.check(contacts, masses, coms, previous=before_it, alone=alone[0]),)
