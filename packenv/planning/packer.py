"""The planner: sequence, place, fall back, report what does not fit (paper Alg. 3 and 4)."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from packenv.geometry.prepare import PreparedItem
from packenv.planning.candidates import Candidates, grid_search
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.container_map import ContainerMap
from packenv.planning.measured import Resting
from packenv.planning.packing import Packing, Pile
from packenv.planning.scores import Heuristic
from packenv.planning.turns import Tier, in_tier, ranked, still_open
from packenv.robot.cell import RELEASE_HEIGHT
from packenv.types import Container, FloatArray, Leftover, OrientedItem, Placement

Perturbations: TypeAlias = Callable[[str], Iterable[Sequence[OrientedItem]]]
"""Item name to its orientations, one group for each roll and pitch offset, the unperturbed ones first."""

_ORIENTATION = "orientation-"
"""Prefix of the reasons that rule out whole orientations; such candidates were never checked."""

MAX_CHECKED = 100
"""N of the paper: candidates of one orientation set that are put to the constraints."""


@dataclass(frozen=True, eq=False)
class Planner:
    """The settings of a planner; :meth:`pack` plans an order.

    Attributes:
        heuristic: scores the candidates.
        step: cells between tried translations.
        cell_size: m.
        constraints: in the order in which they are asked; none plans under non-overlap alone.
        perturbations: orientations of the fallback and of the 5D search; None has neither.
        search: ``3d`` searches the stable poses and falls back; ``5d`` searches all perturbed ones at once,
            and asks for objections to an orientation only when a candidate of it comes up: so only those
            are counted, and all legal candidates are, whether their orientation is of use or not.
        max_checked: candidates of one orientation set that are put to the constraints.
        restarts: how often an incomplete order is planned again with its leftovers first; the paper: 0.
        give_up: return an empty packing as soon as an item finds no place even in the fallback (Alg. 4).
        seed: for heuristics that draw.
        tiers: how careful to be, the most careful first; a later one is tried where an earlier one leaves no
            packable candidate. The paper has one, without clearance.
        bold: the tiers of a restart of an incomplete packing, in place of ``tiers``; None takes those.
        resort: the tiers of more plans, with restarts of their own, of the sequence as it was given: one
            after another until one has placed every item, where restarts are allowed and none did. Such a
            plan has to place more items than those before it.
        passes: the tiers of the fallback, one set after another: each is tried on the stable poses, its last
            tier also on the perturbed ones. None makes one pass with ``tiers``.
        play: height of the release above the placement, m.
        clearance: cells that were asked for; where it is not 0, each placement tells what it got.
    """

    heuristic: Heuristic
    step: int
    cell_size: float
    constraints: Sequence[Constraint] = ()
    perturbations: Perturbations | None = None
    search: Literal["3d", "5d"] = "3d"
    max_checked: int = MAX_CHECKED
    restarts: int = 0
    give_up: bool = False
    seed: int = 0
    tiers: Sequence[Tier] = (Tier(),)
    bold: Sequence[Tier] | None = None
    resort: Sequence[Sequence[Tier]] = ()
    passes: Sequence[Sequence[Tier]] | None = None
    play: float = RELEASE_HEIGHT
    clearance: int = 0

    def pile(self, surface: ContainerMap, resting: Sequence[Resting]) -> Pile:
        """A container to start with.

        Args:
            surface: its heightmap.
            resting: what lies in it.
        """
        return Pile(surface, tuple(constraint.start(resting) for constraint in self.constraints))

    def pack(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> Packing:
        """Pack items one after another (paper Alg. 4); with restarts, again with what failed first.

        The paper never takes a placement back. A restart does, all at once: what found no place, or a
        makeshift one, goes to the front of the sequence, and the order is planned anew. The fullest packing
        is kept, and of such the one with the least risk.

        Under the non-overlap constraints alone there is no fallback in the sequence: heights only grow, so an
        item that fits nowhere fits nowhere later.

        Args:
            sequence: item names, a name as often as the order has it.
            items: every named item, prepared at ``cell_size``.
            container: the box.
            start: what the container holds already; empty where None.
        """
        given = sequence
        best = _Run(self, items, container, start).pack(sequence)
        last, tried = best, {tuple(sequence)}
        for k in range(self.restarts):
            late = list(last.lost)
            # Once: it costs a whole plan.
            late += last.makeshift if k == 0 else ()
            rest = list((Counter(sequence) - Counter(late)).elements())
            sequence = [*late, *sorted(rest, key=list(sequence).index)]
            if not late or tuple(sequence) in tried:
                break
            tried.add(tuple(sequence))
            tiers = self.tiers if self.bold is None or best.complete else self.bold
            last = _Run(replace(self, tiers=tiers), items, container, start).pack(sequence)
            best = max(best, last, key=_goodness)
        for tiers in self.resort if self.restarts else ():
            if not best.improvable:
                break
            bolder = replace(self, tiers=tiers, passes=(tiers,), bold=None, resort=())
            found = bolder.pack(given, items, container, start)
            if len(found.placements) > len(best.placements):
                best = found
        return best


def _goodness(packing: Packing) -> tuple[int, float]:
    return len(packing.placements), -packing.risk


def by_box_volume(names: Sequence[str], items: Mapping[str, PreparedItem]) -> list[str]:
    """The paper's sequence: non-increasing bounding-box volume, then name."""
    return sorted(names, key=lambda name: (-items[name].box_volume, name))


@dataclass(frozen=True, eq=False)
class _Attempt:
    """What came of one call of packOneItem."""

    placement: Placement | None
    rejections: Counter[str]


@dataclass(eq=False)
class _Run:
    """One order on its way into one container."""

    planner: Planner
    items: Mapping[str, PreparedItem]
    container: Container
    start: Pile | None = None
    placements: list[Placement] = field(default_factory=list)
    surfaces: list[ContainerMap] = field(default_factory=list)
    makeshift: list[str] = field(default_factory=list)
    risk: float = 0.0

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.planner.seed)
        self.empty = ContainerMap.empty(self.container, self.planner.cell_size)
        self.pile = self.start or Pile(self.empty, tuple(c.start() for c in self.planner.constraints))

    def pack(self, sequence: Sequence[str]) -> Packing:
        """Paper Alg. 4."""
        failed: list[tuple[str, int, _Attempt]] = []
        pieces = list(_numbered(sequence))
        if self.planner.give_up and sum(self.items[n].volume for n in sequence) > self.container.volume:
            return self.given_up(pieces, "the items' volume exceeds the container's")
        for name, instance in pieces:
            attempt = self.first_pass(name, instance)
            if attempt.placement is None:
                failed.append((name, instance, attempt))
                if self.planner.give_up and not self.fits_alone(name):
                    return self.given_up(pieces, f"{name} does not fit the empty container")
        leftovers = []
        for name, instance, first in failed:
            attempt = self.fall_back(name, instance, first)
            if attempt.placement is None:
                leftovers.append(self.leftover(self.items[name], instance, attempt))
                if self.planner.give_up:
                    return self.given_up(pieces, leftovers[0].detail)
        volume = sum(self.items[p.item].volume for p in self.placements)
        share = volume / self.container.volume
        return Packing(
            self.container,
            tuple(self.placements),
            tuple(leftovers),
            tuple(self.surfaces),
            share,
            tuple(self.makeshift),
            self.risk,
        )

    def given_up(self, pieces: Sequence[tuple[str, int]], why: str) -> Packing:
        """An empty packing: this container cannot hold the order, and nobody asks what else fits."""
        lost = tuple(Leftover(name, instance, "given-up", why) for name, instance in pieces)
        return Packing(self.container, (), lost, (), 0.0)

    def fits_alone(self, name: str) -> bool:
        """Whether any orientation that the planner would try fits the empty container."""
        planner = self.planner
        groups: Iterable[Sequence[OrientedItem]] = [self.items[name].orientations]
        if planner.perturbations is not None:
            groups = itertools.chain(groups, planner.perturbations(name))
        return any(len(grid_search(self.empty, group, planner.step)) for group in groups if group)

    def first_pass(self, name: str, instance: int) -> _Attempt:
        """Lines 6 to 14: the stable poses, or everything at once in the 5D search."""
        planner = self.planner
        if planner.search == "5d" and planner.perturbations is not None:
            groups = [*planner.perturbations(name)]
            return self.attempt(name, instance, [o for group in groups for o in group], "5d")
        return self.attempt(name, instance, self.items[name].orientations, "first-pass")

    def fall_back(self, name: str, instance: int, first: _Attempt) -> _Attempt:
        """Lines 15 to 30: the stable poses again on the pile of now, then perturbed ones."""
        planner = self.planner
        if planner.perturbations is None or planner.search == "5d":
            return first
        rejections = Counter(first.rejections)
        for tiers in planner.passes or (planner.tiers,):
            for k, group in enumerate(planner.perturbations(name)):
                route, asked = ("later", tiers) if k == 0 else ("5d", tiers[-1:])
                attempt = self.attempt(name, instance, group, route, rejections, asked)
                if attempt.placement is not None:
                    return attempt
                rejections = attempt.rejections
        return _Attempt(None, rejections)

    def attempt(
        self,
        name: str,
        instance: int,
        orientations: Sequence[OrientedItem],
        route: str,
        rejections: Counter[str] | None = None,
        tiers: Sequence[Tier] | None = None,
    ) -> _Attempt:
        """PackOneItem (Alg. 3); the pile becomes the new one where it succeeds."""
        counts = Counter(rejections or ())
        lazily = self.planner.search == "5d"
        asked: dict[OrientedItem, bool] = {}
        possible = orientations if lazily else [o for o in orientations if not self.objected(o, counts)]
        if not possible:
            return _Attempt(None, counts)
        known: dict[tuple[int, int, int, int], Verdict] = {}
        for tier in tiers or self.planner.tiers:
            candidates = grid_search(
                self.pile.surface, possible, self.planner.step, tier.clearance, self.planner.play
            )
            if not len(candidates):
                continue
            placement = self.among(
                candidates, tier, name, instance, route, counts, asked if lazily else None, known
            )
            if placement is not None:
                return _Attempt(placement, counts)
        return _Attempt(None, counts)

    def among(
        self,
        candidates: Candidates,
        tier: Tier,
        name: str,
        instance: int,
        route: str,
        counts: Counter[str],
        asked: dict[OrientedItem, bool] | None,
        known: dict[tuple[int, int, int, int], Verdict],
    ) -> Placement | None:
        """Place the first candidate, in order of score, that no constraint refuses.

        Args:
            candidates: the legal ones.
            tier: which constraints are asked.
            name: of the item.
            instance: of the item.
            route: for the record.
            counts: rejections by reason so far; grows.
            asked: as in :meth:`turns`; None where all objections have been asked for.
            known: answers of earlier tiers on the same pile, by constraint and candidate; grows.
        """
        scores = self.planner.heuristic(candidates, self.rng)
        constraints = self.planner.constraints if tier.constraints is None else tier.constraints
        in_turn = (
            in_tier(candidates, scores, tier, self.most(tier), still_open(candidates, constraints, known))
            if asked is None
            else self.turns(candidates, scores, counts, asked)
        )
        for index in in_turn:
            trial = _trial(candidates, index)
            states: list[Any] = []
            details: dict[str, object] = {}
            surface: ContainerMap | None = None
            for constraint, state in zip(constraints, self.pile.states, strict=True):
                question = (id(constraint), id(trial.oriented), trial.ix, trial.iy)
                verdict = known.get(question)
                if verdict is None:
                    verdict = known[question] = constraint.check(trial, self.pile.surface, state)
                    if not verdict.ok:
                        counts[verdict.reason] += 1
                if not verdict.ok:
                    break
                states.append(verdict.state)
                surface = verdict.surface or surface
                details[constraint.name] = dict(verdict.details)
            else:
                if self.planner.clearance:
                    details["clearance_m"] = round(tier.clearance * self.planner.cell_size, 6)
                placement = Placement(
                    item=name,
                    instance=instance,
                    rotation=trial.oriented.rotation,
                    position=trial.position,
                    corner=trial.corner,
                    extents=trial.oriented.extents,
                    pose_index=trial.oriented.pose_index,
                    yaw=trial.oriented.yaw,
                    score=float(scores[index]),
                    candidates=len(candidates),
                    route=route,
                    checked=sum(n for r, n in counts.items() if not r.startswith(_ORIENTATION)) + 1,
                    rejections=dict(counts),
                    details=details,
                )
                if surface is None:
                    surface = self.pile.surface.with_item(trial.oriented, trial.ix, trial.iy, trial.z)
                self.pile = Pile(surface, tuple(states))
                self.placements.append(placement)
                self.surfaces.append(surface)
                if tier.risk:
                    self.makeshift.append(name)
                    self.risk += tier.risk
                return placement
        return None

    def objected(self, oriented: OrientedItem, counts: Counter[str]) -> bool:
        """Whether a constraint rules the whole orientation out: it then takes no candidate's turn."""
        for constraint in self.planner.constraints:
            reason = constraint.objection(oriented)
            if reason is not None:
                counts[f"{_ORIENTATION}{reason}"] += 1
                return True
        return False

    def turns(
        self,
        candidates: Candidates,
        scores: FloatArray,
        counts: Counter[str],
        asked: dict[OrientedItem, bool],
    ) -> Iterator[int]:
        """As :meth:`ranked`, but whole orientations are ruled out only when a candidate of theirs comes up.

        Of the hundreds of orientations of the 5D search, few own one of the best candidates, and an
        objection can cost more than the search itself.

        Args:
            candidates: the legal ones.
            scores: theirs.
            counts: rejections by reason so far; grows.
            asked: whether an orientation has been objected to; grows.
        """
        left = np.arange(len(scores))
        taken, batch = 0, self.planner.max_checked
        while len(left):
            best = left[ranked(scores[left], batch)]
            for index in best:
                oriented = candidates.grids[candidates.grid_index[index]].oriented
                if oriented not in asked:
                    asked[oriented] = self.objected(oriented, counts)
                if asked[oriented]:
                    continue
                yield int(index)
                taken += 1
                if taken == self.planner.max_checked:
                    return
            barred = np.array([asked.get(grid.oriented, False) for grid in candidates.grids])
            keep = ~barred[candidates.grid_index]
            keep[best] = False
            left = left[keep[left]]
            batch *= 2  # where most orientations are of no use, many candidates have to be passed over

    def most(self, tier: Tier) -> int:
        """How many candidates of a tier are checked; without constraints the best one passes."""
        if not self.planner.constraints:
            return 1
        return tier.max_checked or self.planner.max_checked

    def leftover(self, item: PreparedItem, instance: int, attempt: _Attempt) -> Leftover:
        """Why an item is not in the plan."""
        box = self.container.label
        rejections = dict(attempt.rejections)
        fitting = [o for o in item.orientations if len(grid_search(self.empty, [o], self.planner.step))]
        if fitting and all(self.objected(o, Counter()) for o in fitting):
            detail = f"{item.name} has no graspable spot in any stable pose that fits"
            return Leftover(item.name, instance, "no-graspable-spot", detail, rejections)
        if any(not reason.startswith(_ORIENTATION) for reason in rejections):
            counts = ", ".join(f"{n} {reason}" for reason, n in sorted(rejections.items()))
            detail = f"every checked candidate of {item.name} was rejected: {counts}"
            return Leftover(item.name, instance, "no-packable-candidate", detail, rejections)
        if fitting:
            detail = f"no tried pose of {item.name} is free of overlap and inside {box} any more"
            return Leftover(item.name, instance, "no-legal-candidate", detail, rejections)
        tightest = min(item.orientations, key=lambda o: float(o.extents.prod())).extents
        size = " x ".join(f"{e:.3f}" for e in tightest)
        detail = f"{item.name} ({size} m) is larger than {box} in every tried orientation"
        return Leftover(item.name, instance, "larger-than-container", detail)


def _trial(candidates: Candidates, index: int) -> Trial:
    oriented = candidates.grids[candidates.grid_index[index]].oriented
    return Trial(oriented, int(candidates.ix[index]), int(candidates.iy[index]), float(candidates.z[index]))


def _numbered(sequence: Sequence[str]) -> Iterator[tuple[str, int]]:
    """Each name with how often it has come up so far, itself included."""
    seen: Counter[str] = Counter()
    for name in sequence:
        seen[name] += 1
        yield name, seen[name]


def pack(
    sequence: Sequence[str],
    items: Mapping[str, PreparedItem],
    container: Container,
    heuristic: Heuristic,
    *,
    cell_size: float,
    step: int,
    seed: int = 0,
) -> Packing:
    """Plan under the non-overlap constraints alone: :class:`Planner` without constraints."""
    return Planner(heuristic, step, cell_size, seed=seed).pack(sequence, items, container)
