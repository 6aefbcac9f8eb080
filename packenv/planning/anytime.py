"""Search on after the first plan, for as long as the user gives: the best plan so far at any moment (``--budget``).

A plan is made of a sequence of items and one heuristic. The search changes one or the other a little, packs again,
and keeps what is not worse. Two plans whose sequences begin alike share that beginning: each step of a *trail* keeps
the pile that it left, so only what comes after the first difference is packed again. Of a piece that found no place
it is asked up to which step it would have found one; there, or earlier, it is put.

A trail tries stable poses alone: what the fallback knows is in the plan that the search begins with.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from packenv.geometry.prepare import PreparedItem
from packenv.planning.options import Goal
from packenv.planning.packing import PERHAPS, Packing, Pile
from packenv.planning.packing_pass import PackingPass, PassRules
from packenv.planning.planner import Planner
from packenv.planning.portfolio import Packer, goal
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import name_of
from packenv.planning.search.measured import Resting
from packenv.planning.sequence import Piece, pieces_of
from packenv.planning.stability.constraint import StabilityConstraint
from packenv.planning.tiers import Strategy
from packenv.types import Container, Leftover

_STALE = 60
"""So many plans without a better one end a walk: it goes on from the best."""

_WORSE = 0.1
"""Share of worse plans that are walked on from, if they lose no more than one piece more."""

_AGAIN = 0.3
"""Share of changes that are two changes at once."""


@dataclass(frozen=True)
class Budget:
    """How long to search.

    Attributes:
        seconds: of time, the first plan included, which is made whatever it takes; None has no limit.
        plans: how many plans are made after the first; None has no limit. The same number gives the same plan.
    """

    seconds: float | None = None
    plans: int | None = None

    @property
    def given(self) -> bool:
        """Whether there is a limit: without one nothing is searched."""
        return self.seconds is not None or self.plans is not None


@dataclass(frozen=True, eq=False)
class Step:
    """What became of one piece.

    Attributes:
        run: the pass of this piece alone, which has its placement, if any.
        pile: what the container then holds.
        leftover: why the piece has no place; None where it has one.
    """

    run: PackingPass
    pile: Pile
    leftover: Leftover | None


@dataclass(frozen=True, eq=False)
class Trail:
    """A plan with the pile of every step.

    Attributes:
        sequence: item names.
        rule: index of the heuristic.
        steps: one for each name.
    """

    sequence: tuple[str, ...]
    rule: int
    steps: tuple[Step, ...]

    @property
    def lost(self) -> list[int]:
        """Places in the sequence of the pieces without a place."""
        return [k for k, step in enumerate(self.steps) if step.leftover is not None]


class _OverError(Exception):
    """The time is over."""


@dataclass(frozen=True, eq=False)
class Anytime:
    """Makes a plan, and searches for better ones.

    Attributes:
        first: makes the plan to begin with.
        members: planners that differ in their heuristic alone.
        budget: how long to search.
        aim: what is better: see :data:`packenv.planning.options.Goal`.
        seed: of the changes.
        report: is told of every improvement, a line each.
        better: figures of a packing, the larger the better.
        found: is given every better packing, without margins.
        clock: tells seconds.
    """

    first: Packer
    members: Sequence[Planner]
    budget: Budget
    aim: Goal = "items"
    seed: int = 0
    report: Callable[[str], None] = lambda line: None
    better: Callable[[Packing], tuple[float, ...]] = goal
    found: Callable[[Packing], None] = lambda packing: None
    clock: Callable[[], float] = time.monotonic

    def __enter__(self) -> Anytime:
        """The search."""
        return self

    def __exit__(self, *_: object) -> None:
        """Free what the constraints hold: the first packer's are the members', too."""
        self.first.__exit__()

    def pile(self, surface: ContainerMap, resting: Sequence[Resting]) -> Pile:
        """A container to start with, for any member."""
        return self.first.pile(surface, resting)

    def pack(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> Packing:
        """The best plan that is found; after Ctrl-C, the best that was found until then.

        Args:
            sequence: as for :meth:`Planner.pack`.
            items: likewise.
            container: likewise.
            start: likewise.
        """
        began = self.clock()
        best = self.first.pack(sequence, items, container, start)
        end = np.inf if self.budget.seconds is None else began + self.budget.seconds
        walk = _Walk(self, items, container, start, best, began, end)
        hopeless = Counter(left.item for left in walk.left_over)
        within = tuple((Counter(sequence) - hopeless).elements())
        order = sorted(within, key=list(sequence).index)
        if order:
            walk.go(order)
        return walk.told()


@dataclass(eq=False)
class _Walk:
    """One search.

    Attributes:
        search: its settings.
        items: prepared.
        container: the box.
        start: what lies in it.
        best: the best plan so far.
        began: when, s.
        end: when it has to end, s.
    """

    search: Anytime
    items: Mapping[str, PreparedItem]
    container: Container
    start: Pile | None
    best: Packing
    began: float
    end: float

    def __post_init__(self) -> None:
        self.rules = [rules for member in self.search.members for rules in _single_passes(member, quiet=True)]
        self.kept: Trail | None = None
        self.rng = np.random.default_rng(self.search.seed)
        self.left_over = tuple(left for left in self.best.leftovers if left.reason not in PERHAPS)
        self.plans = 0

    def go(self, sequence: Sequence[str]) -> None:
        """Search until the aim or the budget is reached, or somebody stops it."""
        if self.done():
            return
        placed = Counter(sequence) & Counter(p.item for p in self.best.placements)
        as_packed = (*(p.item for p in self.best.placements), *(Counter(sequence) - placed).elements())
        begin = dict.fromkeys((tuple(sequence), as_packed))
        try:
            trails = (self.trail(names, k, None) for names in begin for k in range(len(self.rules)))
            current = min(trails, key=self.cost)
            best, stale, idle = current, 0, 0
            while not self.done() and self.search.clock() < self.end and idle < _STALE:
                changed = self.changed(current)
                if changed is None:
                    idle += 1
                    continue
                idle = 0
                trail = self.trail(*changed, current)
                cost, now = self.cost(trail), self.cost(current)
                one_more = cost[0] <= now[0] + 1 and self.rng.random() < _WORSE
                stale = 0 if cost < now else stale + 1
                if cost <= now or one_more:
                    current = trail
                if cost < self.cost(best):
                    best = trail
                if stale > _STALE:
                    current, stale = best, 0
        except _OverError:
            pass
        except KeyboardInterrupt:
            self.search.report("stopped: the best plan so far is taken")

    def told(self) -> Packing:
        """The best plan, with the figures that a search has no use for, such as margins."""
        if self.kept is None:
            return self.best
        self.rules = [
            rules for member in self.search.members for rules in _single_passes(member, quiet=False)
        ]
        steps: list[Step] = []
        for piece in pieces_of(self.kept.sequence):
            steps.append(self.step(piece, self.kept.rule, steps[-1].pile if steps else self.start))
        return self.packing(replace(self.kept, steps=tuple(steps)))

    def done(self) -> bool:
        """Whether the aim or the budget is reached."""
        whole = not self.best.lost and not self.best.risk and self.search.aim == "items"
        return whole or (self.search.budget.plans is not None and self.plans >= self.search.budget.plans)

    def cost(self, trail: Trail) -> tuple[int, float, float]:
        """Pieces without a place, the volume of their boxes, m³, and the height of the pile, m."""
        lost = trail.lost
        tops = (float(p.corner[2] + p.extents[2]) for s in trail.steps for p in s.run.placements)
        volume = sum(self.items[trail.sequence[k]].box_volume for k in lost)
        return len(lost), volume, max(tops, default=0.0)

    def trail(self, sequence: tuple[str, ...], rule: int, parent: Trail | None) -> Trail:
        """Pack a sequence; what it shares with its parent's beginning is taken from there."""
        if self.search.budget.plans is not None and self.plans >= self.search.budget.plans:
            raise _OverError
        shared = 0
        if parent is not None and parent.rule == rule:
            pairs = zip(sequence, parent.sequence, strict=True)
            shared = next((k for k, (a, b) in enumerate(pairs) if a != b), len(sequence))
        steps = list(parent.steps[:shared]) if parent is not None else []
        pieces = pieces_of(sequence)
        for piece in pieces[shared:]:
            if self.search.clock() > self.end:
                raise _OverError
            steps.append(self.step(piece, rule, steps[-1].pile if steps else self.start))
        self.plans += 1
        made = Trail(sequence, rule, tuple(steps))
        self.keep(made)
        return made

    def step(self, piece: Piece, rule: int, pile: Pile | None) -> Step:
        """One piece more."""
        rules = self.rules[rule]
        run = PackingPass(rules, self.items, self.container, pile)
        refusal = rules.admission.refusal(piece.item, run.pile.held, self.container)
        if refusal is not None:
            return Step(run, run.pile, Leftover(piece.item, piece.instance, *refusal))
        held = rules.admission.with_item(run.pile.held, piece.item)
        rejected = run.first_pass(piece)
        if rejected is not None:
            return Step(run, run.pile, run.leftover(self.items[piece.item], piece, rejected))
        return Step(run, replace(run.pile, held=held), None)

    def latest(self, trail: Trail, lost: int) -> int | None:
        """The latest step before which a lost piece has a place; None where it has none in the empty container."""
        name, rule = trail.sequence[lost], trail.rule

        def fits(before: int) -> bool:
            pile = trail.steps[before - 1].pile if before else self.start
            return self.step(Piece(name, 1), rule, pile).leftover is None

        if not fits(0):
            return None
        low, high = 0, lost
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if fits(middle) else (low, middle)
        return low

    def changed(self, trail: Trail) -> tuple[tuple[str, ...], int] | None:
        """Another sequence or heuristic; None where nothing changed."""
        names, rule, lost = list(trail.sequence), trail.rule, trail.lost
        for _ in range(2 if self.rng.random() < _AGAIN else 1):
            draw, (i, j) = self.rng.random(), self.rng.integers(0, len(names), 2).tolist()
            if lost and draw < 0.5:
                piece = int(self.rng.choice(lost))
                before = self.latest(trail, piece)
                if before is None:
                    return None
                before = before if self.rng.random() < 0.5 else int(self.rng.integers(0, before + 1))
                names.insert(before, names.pop(piece))
                lost = []
            elif draw < 0.7:
                names[i], names[j] = names[j], names[i]
            elif draw < 0.85:
                names.insert(j, names.pop(i))
            else:
                rule = int(self.rng.integers(len(self.rules)))
        found = tuple(names)
        return None if (found, rule) == (trail.sequence, trail.rule) else (found, rule)

    def keep(self, trail: Trail) -> None:
        """Take a plan that is better than the best so far, and say so."""
        packing = self.packing(trail)
        if self.search.better(packing) <= self.search.better(self.best):
            return
        self.best, self.kept = packing, trail
        self.search.found(packing)
        tops = (float(p.corner[2] + p.extents[2]) for p in packing.placements)
        whole = len(packing.placements) + len(packing.leftovers)
        self.search.report(
            f"after {self.search.clock() - self.began:.1f} s and {self.plans} plans: {len(packing.placements)} of "
            f"{whole} items, height {max(tops, default=0.0):.3f} m ({packing.made_by})"
        )

    def packing(self, trail: Trail) -> Packing:
        """A trail as the planner's result."""
        runs = [step.run for step in trail.steps]
        placements = tuple(p for run in runs for p in run.placements)
        lost = tuple(step.leftover for step in trail.steps if step.leftover is not None)
        volume = sum(self.items[p.item].volume for p in placements)
        return Packing(
            self.container,
            placements,
            (*lost, *self.left_over),
            tuple(surface for run in runs for surface in run.surfaces),
            volume / self.container.volume,
            tuple(name for run in runs for name in run.makeshift),
            sum(run.risk for run in runs),
            name_of(self.rules[trail.rule].heuristic),
        )


def _single_passes(member: Planner, *, quiet: bool) -> Iterator[PassRules]:
    """The rules of trails: the tiers of a restart, stable poses alone, and where quiet no margins to be told.

    Where exact places are tried, another trail tries the grid alone: in the time of one there are five of those.
    """
    tiers = member.strategy.restart_tiers or member.strategy.first
    constraints = [
        replace(c, with_margin=False) if quiet and isinstance(c, StabilityConstraint) else c
        for c in member.constraints
    ]
    strategy = Strategy(first=tuple(tiers), clearance=member.strategy.clearance)
    rules = replace(member, constraints=constraints, strategy=strategy, perturbations=None, give_up=False)
    yield rules
    if member.places == "exact":
        yield replace(rules, places="grid")
