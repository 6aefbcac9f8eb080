"""One order on its way into one container: every item is placed, deferred or left over (paper Alg. 3 and 4)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from packenv.config import CLEARANCE, GridConfig
from packenv.errors import InputError
from packenv.geometry.prepare import PreparedItem
from packenv.planning.admission import Admission, Held
from packenv.planning.constraints import Constraint
from packenv.planning.deadline import NEVER, Deadline
from packenv.planning.inquiry import ORIENTATION, Inquiry, barrier, objection, place
from packenv.planning.manipulation.constraint import NO_GRASP, TOO_HEAVY
from packenv.planning.options import Places
from packenv.planning.packing import Packing, Pile
from packenv.planning.search.candidates import Candidates, grid_search, ranked
from packenv.planning.search.contact_height import ExactPile
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.fitting import fitting_orientations
from packenv.planning.search.heuristics import Heuristic
from packenv.planning.search.measured import Resting
from packenv.planning.search.places import ExactPlaces
from packenv.planning.sequence import Piece, pieces_of
from packenv.planning.tiers import Strategy, Tier, in_tier, still_open
from packenv.robot.cell import RELEASE_HEIGHT
from packenv.types import Container, FloatArray, IntArray, Item, Leftover, OrientedItem, Placement

Perturbations: TypeAlias = Callable[[str], Iterable[Sequence[OrientedItem]]]
"""Item name to its orientations, one group for each roll and pitch offset, the unperturbed ones first."""

_UNUSABLE = "no-usable-orientation"
_OBJECTED = {TOO_HEAVY: TOO_HEAVY, NO_GRASP: "no-graspable-spot"}
"""Reasons of leftovers all of whose orientations meet with one objection."""

_SINKS = 0.03
"""By so much items mostly come lower at most than the heightmaps say, m."""

_TIPS = 0.03
"""How far below the rim what may not stay should end, m."""

_SPACIOUS = 0.6
"""Share of a container above which the items' bounding boxes hardly ever fit with room to spare."""
_WAITING = 0.5
"""Share of an order that may wait for the fallback of a trial."""
_MAKESHIFT = 0.2
"""Share of an order that may get a makeshift place there."""
_FEW, _SOME = 7, 5
"""How many may in any case wait, and get a makeshift place."""

MAX_CHECKED = 100
"""N of the paper: candidates of one orientation set that are put to the constraints."""


@dataclass(frozen=True, eq=False)
class PassRules:
    """How an order is packed in one pass.

    Attributes:
        heuristic: scores the candidates.
        grid: the discretization that the items were prepared with.
        constraints: in the order in which they are asked; none plans under non-overlap alone.
        perturbations: orientations of the fallback and of the 5D search; None has neither.
        strategy: how careful to be, and what comes where that leaves an item without a place.
        search: ``3d`` searches the stable poses and falls back; ``5d`` searches all perturbed ones at once,
            and asks for objections to an orientation only when a candidate of it comes up: so only those
            are counted, and all legal candidates are, whether their orientation is of use or not.
        max_checked: candidates of one orientation set that are put to the constraints.
        give_up: return an empty packing as soon as an item finds no place even in the fallback (Alg. 4).
        seed: for heuristics that draw.
        release: how far above its place an item is let go, m.
        shapes: meshes of all items by name: candidates are lowered to where the meshes meet. None leaves them
            where the heightmaps say, as the paper does.
        places: whether places off the grid are candidates, too.
        admission: which items a box takes at all.
        only: rotations, as bytes, of items that are tried at some orientations alone.
        ceiling: no item's top is placed above it, m.
        until: no fallback and no restart begins after it.
    """

    heuristic: Heuristic
    grid: GridConfig = field(default_factory=GridConfig)
    constraints: Sequence[Constraint] = ()
    perturbations: Perturbations | None = None
    strategy: Strategy = field(default_factory=Strategy)
    search: Literal["3d", "5d"] = "3d"
    max_checked: int = MAX_CHECKED
    give_up: bool = False
    seed: int = 0
    release: float = RELEASE_HEIGHT
    shapes: Mapping[str, Item] | None = None
    places: Places = "grid"
    admission: Admission = field(default_factory=Admission)
    only: Mapping[str, frozenset[bytes]] = field(default_factory=dict)
    ceiling: float = math.inf
    until: Deadline = NEVER

    def __post_init__(self) -> None:
        """Check.

        Raises:
            InputError: two constraints have one name.
        """
        names = [constraint.name for constraint in self.constraints]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"two constraints are named {name!r}, give each a name of its own")

    def pile(self, surface: ContainerMap, resting: Sequence[Resting]) -> Pile:
        """A container to start with.

        Args:
            surface: its heightmap.
            resting: what lies in it.
        """
        states = tuple(constraint.start(resting) for constraint in self.constraints)
        return Pile(surface, states, Held.of(lying.item for lying in resting))


@dataclass(eq=False)
class PackingPass:
    """One order on its way into one container."""

    planner: PassRules
    items: Mapping[str, PreparedItem]
    container: Container
    start: Pile | None = None
    placements: list[Placement] = field(default_factory=list)
    surfaces: list[ContainerMap] = field(default_factory=list)
    makeshift: list[str] = field(default_factory=list)
    risk: float = 0.0
    shaky: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.planner.seed)
        shapes = self.planner.shapes
        exact = None if shapes is None else ExactPile(shapes)
        self.empty = ContainerMap.empty(self.container, self.planner.grid.cell_size, exact)
        self.pile = self.start or self.planner.pile(self.empty, ())

    def pack(self, sequence: Sequence[str]) -> Packing:
        """Paper Alg. 4."""
        pieces = pieces_of(sequence)
        if self.planner.give_up and sum(self.items[n].volume for n in sequence) > self.container.volume:
            return self.given_up(pieces, "the items' volume exceeds the container's")
        if self.start is None:
            why = barrier(self.planner.constraints, (self.items[name] for name in dict.fromkeys(sequence)))
            if why is not None:
                return self.given_up(pieces, why, "unreachable-container")
        rounds = self.planner.strategy.fallback or (self.planner.strategy.first,)
        trial = self.planner.strategy.trial
        if trial and sum(self.items[n].box_volume for n in sequence) > _SPACIOUS * self.container.volume:
            return self.given_up(pieces, "the items' bounding boxes leave little room")
        held = self.pile.held
        waiting = {piece: Counter[str]() for piece in pieces}
        lost: dict[Piece, Leftover] = {}
        for k, tiers in enumerate(((), *rounds)):
            for piece in [piece for piece in waiting if piece not in lost]:
                refusal = self.planner.admission.refusal(piece.item, held, self.container)
                if refusal is not None:
                    if self.planner.give_up:
                        return self.given_up(pieces, refusal[1])
                    lost[piece] = Leftover(piece.item, piece.instance, *refusal)
                    continue
                rejected = self.fall_back(piece, tiers, waiting[piece]) if k else self.first_pass(piece)
                if rejected is None:
                    held = self.planner.admission.with_item(held, piece.item)
                    del waiting[piece]
                    if trial and len(self.makeshift) > max(_SOME, _MAKESHIFT * len(pieces)):
                        return self.given_up(pieces, "too many items have no steady place with clearance")
                    continue
                if (
                    trial
                    and not k
                    and not self.fits(self.orientations(piece.item), self.pile.surface)
                    and self.fits_alone(piece.item)
                ):
                    return self.given_up(pieces, f"{piece.item} fits nowhere, and heights only grow")
                waiting[piece] = rejected
                if not k and self.planner.give_up and not self.fits_alone(piece.item):
                    return self.given_up(pieces, f"{piece.item} does not fit the empty container")
                if k == len(rounds):
                    lost[piece] = self.leftover(self.items[piece.item], piece, rejected)
                    if self.planner.give_up:
                        return self.given_up(pieces, f"{piece.item}: {lost[piece].detail}")
            if trial and len(waiting) > max(_FEW, _WAITING * len(pieces)):
                return self.given_up(pieces, "too many items have no steady place with clearance")
        volume = sum(self.items[p.item].volume for p in self.placements)
        share = volume / self.container.volume
        return Packing(
            self.container,
            tuple(self.placements),
            tuple(lost.values()),
            tuple(self.surfaces),
            share,
            tuple(self.makeshift),
            self.risk,
        )

    def given_up(self, pieces: Sequence[Piece], why: str, reason: str = "given-up") -> Packing:
        """An empty packing: this container cannot hold the order, and nobody asks what else fits."""
        lost = tuple(Leftover(piece.item, piece.instance, reason, why) for piece in pieces)
        return Packing(self.container, (), lost, (), 0.0)

    def fits_alone(self, name: str) -> bool:
        """Whether any orientation that the planner would try fits the empty container."""
        return any(self.fits(group) for group in self.groups(name) if group)

    def fits(self, orientations: Sequence[OrientedItem], surface: ContainerMap | None = None) -> bool:
        """Whether one of them has a place on a pile; None: in the empty container."""
        return bool(len(grid_search(surface or self.empty, orientations, self.planner.grid.step_cells)))

    def first_pass(self, piece: Piece) -> Counter[str] | None:
        """Lines 6 to 14: the stable poses, or everything at once in the 5D search."""
        planner = self.planner
        if planner.search == "5d" and planner.perturbations is not None:
            groups = self.groups(piece.item)
            return self.attempt(piece, [o for group in groups for o in group], "5d")
        return self.attempt(piece, self.orientations(piece.item), "first-pass")

    def orientations(self, name: str) -> Sequence[OrientedItem]:
        """What is tried of an item first: :meth:`fitting`, or those of them that are allowed."""
        found, only = self.fitting(name), self.planner.only.get(name)
        return found if only is None else [o for o in found if o.rotation.tobytes() in only]

    def fitting(self, name: str) -> tuple[OrientedItem, ...]:
        """An item at its stable poses and yaws; turned or leaning where it fits the container at none of these."""
        item, shapes = self.items[name], self.planner.shapes
        if shapes is None:
            return item.orientations
        return fitting_orientations(item, shapes[name], self.planner.grid, self.container.size)

    def groups(self, name: str) -> Iterator[Sequence[OrientedItem]]:
        """What is tried of an item in the end: :meth:`fitting`, then the perturbed orientations."""
        perturbed, first = self.planner.perturbations, self.fitting(name)
        if perturbed is None:
            yield first
            return
        for k, group in enumerate(perturbed(name)):
            yield first if k == 0 and first is not self.items[name].orientations else group

    def fall_back(self, piece: Piece, tiers: Sequence[Tier], rejections: Counter[str]) -> Counter[str] | None:
        """Lines 15 to 30: the stable poses again on the pile of now, then perturbed ones.

        Args:
            piece: was deferred.
            tiers: of this round of the fallback.
            rejections: of the piece until now.
        """
        planner = self.planner
        if planner.perturbations is None or planner.search == "5d" or planner.until.passed:
            return rejections
        for k, group in enumerate(self.groups(piece.item)):
            if k and not tiers[-1].leaning:
                break
            route, asked = ("later", tiers) if k == 0 else ("5d", tiers[-1:])
            rejected = self.attempt(piece, group, route, rejections, asked)
            if rejected is None:
                return None
            rejections = rejected
        return rejections

    def attempt(
        self,
        piece: Piece,
        orientations: Sequence[OrientedItem],
        route: str,
        rejections: Counter[str] | None = None,
        tiers: Sequence[Tier] | None = None,
    ) -> Counter[str] | None:
        """PackOneItem (Alg. 3): the item is placed, and None returned, or all rejections so far."""
        planner = self.planner
        inquiry = Inquiry(planner.constraints, self.pile, rejections=rejections)
        possible = orientations if planner.search == "5d" else inquiry.possible(orientations)
        if not possible:
            return inquiry.rejections
        for tier in tiers or planner.strategy.first:
            candidates = grid_search(
                self.pile.surface, possible, planner.grid.step_cells, tier.clearance, planner.release
            )
            scores = planner.heuristic(candidates, self.rng) if len(candidates) else np.empty(0)
            worth = self.worth_asking(candidates, inquiry, tier)
            candidates, scores = candidates.only(worth), scores[worth]
            exact = planner.places == "exact" and not tier.clearance and not planner.strategy.trial
            if exact and route in ("first-pass", "later"):
                finder = ExactPlaces(planner.heuristic, self.rng)
                candidates, scores = finder.add(
                    candidates,
                    scores,
                    self.pile.surface,
                    possible,
                    planner.grid.step_cells,
                    self.most(tier),
                )
                worth = self.worth_asking(candidates, inquiry, tier)
                candidates, scores = candidates.only(worth), scores[worth]
            if len(candidates) and self.among(candidates, scores, tier, piece, route, inquiry):
                return None
        return inquiry.rejections

    def worth_asking(self, candidates: Candidates, inquiry: Inquiry, tier: Tier) -> IntArray:
        """Indices of the candidates that no constraint refuses at sight, and that are where a tier looks.

        That is below the ceiling, and aside from what may not stay.
        """
        open_ = inquiry.screened(candidates)
        if tier.apart:
            ends = candidates.places + candidates.extents[:, :2]
            for low, high in self.shaky:
                beside = (ends < low - tier.apart) | (candidates.places > high + tier.apart)
                open_ &= beside.any(axis=1)
        if self.planner.ceiling < math.inf:
            open_ &= candidates.z + candidates.extents[:, 2] <= self.planner.ceiling + _SINKS
        return np.flatnonzero(open_)

    def among(
        self,
        candidates: Candidates,
        scores: FloatArray,
        tier: Tier,
        piece: Piece,
        route: str,
        inquiry: Inquiry,
    ) -> bool:
        """Place the first candidate, in order of score, that no constraint refuses.

        Args:
            candidates: the legal ones.
            scores: theirs.
            tier: which constraints are asked.
            piece: of the order.
            route: for the record.
            inquiry: knows the answers of earlier tiers on the same pile.
        """
        planner = self.planner
        rules = tier.rules(planner.constraints)
        to_check: Iterable[int]
        if planner.search == "5d":
            to_check = self.ranked_late(candidates, scores, inquiry)
        else:
            free = still_open(candidates, inquiry.refused(rules))
            to_check = in_tier(candidates, scores, tier, self.most(tier), free)
        for index in to_check:
            trial = candidates.trial(index)
            if trial.z + float(trial.oriented.extents[2]) > planner.ceiling:
                continue
            answer = inquiry.ask(trial, rules)
            if not answer.ok:
                continue
            notes = {}
            if planner.strategy.clearance:
                notes["clearance_m"] = round(tier.clearance * planner.grid.cell_size, 6)
            rejected = sum(
                n for reason, n in inquiry.rejections.items() if not reason.startswith(ORIENTATION)
            )
            placement, self.pile = place(
                piece,
                trial,
                inquiry,
                answer.verdicts,
                score=float(scores[index]),
                candidates=len(candidates),
                route=route,
                checked=rejected + 1,
                notes=notes,
            )
            self.placements.append(placement)
            # Whoever keeps many packings does not want the meshes of every step.
            surface = self.pile.surface
            self.surfaces.append(surface if surface.exact is None else replace(surface, exact=None))
            self.count_risk(tier, placement)
            return True
        return False

    def count_risk(self, tier: Tier, placement: Placement) -> None:
        """Count what a placement of a tier risks."""
        risk = tier.risk
        if tier.shaky:
            if tier.clearance and not self.shaky:
                risk = 0.0
            low, high = placement.corner, placement.corner + placement.extents
            if high[2] > self.container.height - _TIPS:
                risk += 1.0  # where it tips over it stands out of the container
            self.shaky.append((low[:2], high[:2]))
        self.risk += risk
        if risk >= 1.0:
            self.makeshift.append(placement.item)

    def ranked_late(self, candidates: Candidates, scores: FloatArray, inquiry: Inquiry) -> Iterator[int]:
        """As :meth:`ranked`, but whole orientations are ruled out only when a candidate of theirs comes up.

        Of the hundreds of orientations of the 5D search, few own one of the best candidates, and an
        objection can cost more than the search itself.
        """
        left = np.arange(len(scores))
        taken, batch = 0, self.planner.max_checked
        while len(left):
            best = left[ranked(scores[left], batch)]
            for index in best:
                if inquiry.objected(candidates.grids[candidates.grid_index[index]].oriented):
                    continue
                yield int(index)
                taken += 1
                if taken == self.planner.max_checked:
                    return
            barred = np.array([inquiry.was_objected(grid.oriented) for grid in candidates.grids])
            keep = ~barred[candidates.grid_index]
            keep[best] = False
            left = left[keep[left]]
            batch *= 2  # where most orientations are of no use, many candidates have to be passed over

    def most(self, tier: Tier) -> int:
        """How many candidates of a tier are checked; without constraints the best one passes."""
        if not self.planner.constraints:
            return 1
        return tier.max_checked or self.planner.max_checked

    def leftover(self, item: PreparedItem, piece: Piece, rejections: Mapping[str, int]) -> Leftover:
        """Why an item is not in the plan."""
        box, largest = self.container.label, np.add(self.container.size, CLEARANCE)
        groups = ([o for o in group if (o.extents <= largest).all()] for group in self.groups(item.name))
        inside = next((group for group in groups if group), [])
        fitting = [oriented for oriented in inside if self.fits([oriented])]
        objections = [objection(self.planner.constraints, oriented) for oriented in fitting]
        words = sorted({word for word in objections if word is not None})
        explained = (c.explanation(o) for o in fitting for c in self.planner.constraints)
        if words and None not in objections:
            reason = _OBJECTED.get(words[0], _UNUSABLE) if len(words) == 1 else _UNUSABLE
            ruled_out = f"every orientation of {item.name} that fits is ruled out: {', '.join(words)}"
            detail = next((why for why in explained if why is not None), ruled_out)
        elif any(not reason.startswith(ORIENTATION) for reason in rejections):
            counts = ", ".join(f"{n} {reason}" for reason, n in sorted(rejections.items()))
            reason = "no-packable-candidate"
            detail = f"every checked candidate of {item.name} was rejected: {counts}"
        elif inside:
            reason = "no-legal-candidate"
            detail = f"no tried orientation of {item.name} is free of overlap and inside {box} any more"
        else:
            tightest = min(item.orientations, key=lambda o: float(o.extents.prod())).extents
            # To 10 µm, half of what is forgiven: no message says that 0.100 is larger than 0.1.
            size = " x ".join(f"{e:.5f}".rstrip("0") for e in tightest)
            reason, rejections, which = "larger-than-container", {}, "every orientation"
            if self.planner.shapes is None:  # nobody looked at all rotations
                reason, which = "no-fitting-orientation", "every tried orientation"
            detail = f"{item.name} ({size} m) is larger than {box} in {which}"
        return Leftover(item.name, piece.instance, reason, detail, dict(rejections))
