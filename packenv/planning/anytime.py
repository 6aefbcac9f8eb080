"""Search on after the first plan, for as long as the user gives: the best plan so far at any moment (``--budget``).

Several chains of plans (:mod:`packenv.planning.chains`) walk side by side, in rounds. After a round a chain that is
behind goes on from the best plan of all. The number of chains is fixed, and a round is read in the order of the
chains, so the plan does not depend on how many processes they run in.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from packenv.geometry.prepare import PreparedItem
from packenv.planning.chain_workers import OneProcess, Processes, Team
from packenv.planning.chains import Chain, Improvement, Round, RoundEnd, Start
from packenv.planning.options import Goal
from packenv.planning.packing import PERHAPS, Packing, Pile
from packenv.planning.planner import Planner
from packenv.planning.portfolio import Packer, goal
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.planning.trails import Trails, single_passes
from packenv.types import Container

CHAINS = 4
"""How many walk side by side."""

STOPPED = "stopped: the best plan so far is taken"
"""What is told after Ctrl-C."""

ROUND = 16
"""Plans of a chain in a round."""


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
class WholeIsEnough:
    """Whether a plan ends the search: one that has every item, if that is all that is asked.

    Attributes:
        aim: see :data:`packenv.planning.options.Goal`.
    """

    aim: Goal

    def __call__(self, packing: Packing) -> bool:
        """Whether nothing better can be asked."""
        return not packing.lost and not packing.risk and self.aim in ("items", "box")


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
        workers: processes to search in; 1 is this one.
        clock: tells seconds; with more workers, the same ones in all of them.
        found: is told of the first plan and of every better one.
    """

    first: Packer
    members: Sequence[Planner]
    budget: Budget
    aim: Goal = "items"
    seed: int = 0
    report: Callable[[str], None] = lambda line: None
    better: Callable[[Packing], tuple[float, ...]] = goal
    workers: int = 1
    clock: Callable[[], float] = time.monotonic
    found: Callable[[Packing], None] = lambda packing: None

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
        return self.search(sequence, items, container, start)[0]

    def search(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> tuple[Packing, bool]:
        """As :meth:`pack`, and whether somebody stopped it."""
        began = self.clock()
        first = self.first.pack(sequence, items, container, start)
        self.found(first)
        hopeless = tuple(left for left in first.leftovers if left.reason not in PERHAPS)
        within = list((Counter(sequence) - Counter(left.item for left in hopeless)).elements())
        order = sorted(within, key=list(sequence).index)
        enough = WholeIsEnough(self.aim)
        if not order or enough(first):
            return first, False
        rules = list(single_passes(self.members, margins=self.aim == "robust"))
        trails = Trails(rules, items, container, start, self.aim)
        chains = [Chain(trails, (self.seed, k), self.better, enough, self.clock) for k in range(CHAINS)]
        walk = _Walk(self, chains, Counter(left.item for left in hopeless), first, began)
        stopped = False
        try:
            with self.team(chains) as team:
                walk.go(team, order)
        except KeyboardInterrupt:
            self.report(STOPPED)
            stopped = True
        except ChildProcessError as problem:
            self.report(f"{problem}: the best plan so far is taken")
        if walk.kept is None:
            return first, stopped
        if self.aim != "robust":  # the figures that a search has no use for, such as margins
            rules = list(single_passes(self.members, margins=True))
            trails = Trails(rules, items, container, start, self.aim)
        return trails.packing(trails.trail(walk.kept.sequence, walk.kept.rule), hopeless), stopped

    def team(self, chains: Sequence[Chain]) -> Team:
        """The chains in as many processes as are asked for."""
        if self.workers > 1:
            try:
                return Processes(chains, self.workers)
            except TypeError as problem:
                self.report(f"one worker instead of {self.workers}: {problem}")
        return OneProcess(chains)


@dataclass(eq=False)
class _Walk:
    """One search.

    Attributes:
        search: its settings.
        chains: what walks.
        hopeless: items without a place in any plan, how many of each.
        best: the best plan so far, less the hopeless items.
        began: when, s.
        kept: what makes the best plan, if the search found it.
    """

    search: Anytime
    chains: Sequence[Chain]
    hopeless: Counter[str]
    best: Packing
    began: float
    kept: Start | None = None
    plans: int = 0

    def go(self, team: Team, order: Sequence[str]) -> None:
        """Rounds until the aim or the budget is reached."""
        budget, clock = self.search.budget, self.search.clock
        most = np.inf if budget.plans is None else budget.plans
        end = np.inf if budget.seconds is None else self.began + budget.seconds
        begin = self.starts(order)
        tasks = [begin[k::CHAINS] for k in range(CHAINS)]
        costs: list[tuple[int, float, float] | None] = [None] * CHAINS
        leader: tuple[tuple[int, float, float], Start] | None = None
        while self.plans < most and clock() < end:
            left = most - self.plans
            quotas = [int(max(0, min(ROUND, left - k * ROUND))) for k in range(CHAINS)]
            rounds = [Round(tuple(t), q, float(end)) for t, q in zip(tasks, quotas, strict=True)]
            ends = []
            for k, told in team.advance(rounds):
                if isinstance(told, RoundEnd):
                    ends.append(told)
                    self.plans += told.plans
                    continue
                costs[k] = told.cost
                if leader is None or told.cost < leader[0]:
                    leader = told.cost, told.start
                if self.keep(told) and self.chains[k].enough(told.packing):
                    return
            if leader is None or all(told.idle for told in ends):
                return
            tasks = [[] if cost == leader[0] else [leader[1]] for cost in costs]

    def starts(self, order: Sequence[str]) -> list[Start]:
        """What is packed first: the order's sequence and that of the first plan, by every heuristic."""
        placed = Counter(order) & Counter(p.item for p in self.best.placements)
        as_packed = (*(p.item for p in self.best.placements), *(Counter(order) - placed).elements())
        rules = range(len(self.chains[0].trails.rules))
        return [Start(names, k) for names in dict.fromkeys((tuple(order), as_packed)) for k in rules]

    def keep(self, told: Improvement) -> bool:
        """Take a plan that is better than the best so far, and say so; whether it is."""
        search, packing = self.search, told.packing
        if search.better(packing) <= search.better(self.best):
            return False
        self.best, self.kept = packing, told.start
        search.found(packing)
        tops = (float(p.corner[2] + p.extents[2]) for p in packing.placements)
        whole = len(packing.placements) + len(packing.leftovers) + self.hopeless.total()
        search.report(
            f"after {search.clock() - self.began:.1f} s and {self.plans + told.plans} plans: "
            f"{len(packing.placements)} of {whole} items, height {max(tops, default=0.0):.3f} m ({packing.made_by})"
        )
        return True
