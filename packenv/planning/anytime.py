"""Search on after the first plan, for as long as the user gives: the best plan so far at any moment (``--budget``).

Several chains of plans (:mod:`packenv.planning.chains`) walk side by side, in rounds. After a round a chain that is
behind goes on from the best plan of all. The number of chains is fixed, and a round is read in the order of the
chains, so the plan does not depend on how many processes they run in.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from packenv.geometry.prepare import PreparedItem
from packenv.planning.chain_workers import OneProcess, Processes, Team
from packenv.planning.chains import Chain, Round, RoundEnd, Start, lower
from packenv.planning.deadline import Deadline
from packenv.planning.options import Goal
from packenv.planning.packing import PERHAPS, Packing, Pile
from packenv.planning.portfolio import Portfolio, goal
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import name_of
from packenv.planning.search.measured import Resting
from packenv.planning.trails import Trails, Turn, single_passes
from packenv.types import Container, Leftover

CHAINS = 4
"""How many walk side by side."""

STOPPED = "stopped: the best plan so far is taken"
"""What is told after Ctrl-C."""

ROUND = 16
"""Plans of a chain in a round."""

QUICK = 0.05
"""Share of a budget that a pass may take where all rules, with fallback and restarts, are tried before the search."""

CAREFUL = 0.25
"""Share of a budget after which nothing of that begins any more, and the search does."""


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
        first: makes the plan to begin with, as far as the time goes.
        budget: how long to search.
        aim: what is better: see :data:`packenv.planning.options.Goal`.
        seed: of the changes.
        report: is told of every improvement, a line each.
        better: figures of a packing, the larger the better.
        workers: processes to search in; 1 is this one.
        clock: tells seconds; with more workers, the same ones in all of them.
        found: is told of the first plan and of every better one.
        known: a plan to begin with in place of those that it makes; None makes them.
    """

    first: Portfolio
    budget: Budget
    aim: Goal = "items"
    seed: int = 0
    report: Callable[[str], None] = lambda line: None
    better: Callable[[Packing], tuple[float, ...]] = goal
    workers: int = 1
    clock: Callable[[], float] = time.monotonic
    found: Callable[[Packing], None] = lambda packing: None
    known: Packing | None = None

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
        end = np.inf if self.budget.seconds is None else began + self.budget.seconds
        record = _Record(self, began)
        deadline, enough = Deadline(float(end), self.clock), WholeIsEnough(self.aim)
        try:
            record.best = self.known
            lead = self.first.members[0]
            roomy = None if self.known else lead.with_room(sequence, items, container, start)
            if roomy is not None:
                roomy = replace(roomy, made_by=name_of(lead.heuristic))
                record.keep(roomy)
            first = self.known or roomy
            if first is None:
                first = self.quick(deadline, record).pack(sequence, items, container, start)
            if enough(first) or deadline.passed:
                return first, False
            if (self.known or roomy) is None and not self.hurried(self.clock() - began):
                share = Deadline(began + CAREFUL * (float(end) - began), self.clock)
                members = [member.without_room for member in self.first.members]
                whole = replace(self.first, members=members, until=share, found=record.keep)
                first = whole.pack(sequence, items, container, start)
            hopeless = tuple(left for left in first.leftovers if left.reason not in PERHAPS)
            within = list((Counter(sequence) - Counter(left.item for left in hopeless)).elements())
            order = sorted(within, key=list(sequence).index)
            if order and not enough(first):
                trails = Trails(
                    list(single_passes(self.first.members, margins=self.margins_first(first))),
                    items,
                    container,
                    start,
                    self.aim,
                )
                chains = [
                    Chain(trails, (self.seed, k), self.better, enough, self.clock) for k in range(CHAINS)
                ]
                with self.team(chains) as team:
                    _Walk(record, chains, hopeless, float(end)).go(team, order)
        except KeyboardInterrupt:
            if record.best is None:
                raise
            self.report(STOPPED)
            return record.best, True
        except ChildProcessError as problem:
            self.report(f"{problem}: the best plan so far is taken")
        assert record.best is not None
        return record.best, False

    def quick(self, deadline: Deadline, record: _Record) -> Portfolio:
        """One pass of the first member without the fallback, in which much time goes where much is left over."""
        member = self.first.members[0].without_room
        strategy = replace(member.strategy, restarts=0)
        return Portfolio(
            [replace(member, perturbations=None, strategy=strategy)], self.better, deadline, record.keep
        )

    def hurried(self, seconds: float) -> bool:
        """Whether a pass takes so many seconds that the search had better begin at once."""
        return self.budget.seconds is not None and seconds > QUICK * self.budget.seconds

    def margins_first(self, first: Packing) -> bool:
        """Whether a margin goes before a better place: where all items have one, or margins are the aim."""
        return self.aim == "robust" or (self.aim == "height" and not first.lost)

    def team(self, chains: Sequence[Chain]) -> Team:
        """The chains in as many processes as are asked for."""
        if self.workers > 1:
            try:
                return Processes(chains, self.workers)
            except TypeError as problem:
                self.report(f"one worker instead of {self.workers}: {problem}")
        return OneProcess(chains)


@dataclass(eq=False)
class _Record:
    """The best plan so far.

    Attributes:
        search: its settings.
        began: when, s.
        best: the plan; None before the first one.
    """

    search: Anytime
    began: float
    best: Packing | None = None

    def keep(self, packing: Packing, plans: int = 0) -> bool:
        """Take a plan that is better than the best so far, and say so; whether it is.

        Args:
            packing: the plan.
            plans: how many were made by the search until then.
        """
        search = self.search
        if self.best is not None and search.better(packing) <= search.better(self.best):
            return False
        self.best = packing
        search.found(packing)
        seconds = search.clock() - self.began
        search.report(f"after {seconds:.1f} s and {plans} plans: {packing.words} ({packing.made_by})")
        return True


@dataclass(eq=False)
class _Walk:
    """One search.

    Attributes:
        record: keeps the best plan, and has the first one.
        chains: what walks.
        hopeless: items without a place in any plan.
        end: when to end, s.
        plans: how many were made.
    """

    record: _Record
    chains: Sequence[Chain]
    hopeless: tuple[Leftover, ...]
    end: float
    plans: int = 0

    def go(self, team: Team, order: Sequence[str]) -> None:
        """Rounds until the aim or the budget is reached."""
        budget, clock = self.record.search.budget, self.record.search.clock
        most = np.inf if budget.plans is None else budget.plans
        begin = self.starts(order)
        tasks = [begin[k::CHAINS] for k in range(CHAINS)]
        costs: list[tuple[int, float, float] | None] = [None] * CHAINS
        leader: tuple[tuple[int, float, float], Start] | None = None
        while self.plans < most and clock() < self.end:
            left = most - self.plans
            quotas = [int(max(0, min(ROUND, left - k * ROUND))) for k in range(CHAINS)]
            rounds = [Round(tuple(t), q, self.end) for t, q in zip(tasks, quotas, strict=True)]
            ends = []
            for k, told in team.advance(rounds):
                if isinstance(told, RoundEnd):
                    ends.append(told)
                    self.plans += told.plans
                    continue
                costs[k] = told.cost
                if leader is None or told.cost < leader[0]:
                    leader = told.cost, told.start
                packing = replace(told.packing, leftovers=(*told.packing.leftovers, *self.hopeless))
                better = self.record.keep(packing, self.plans + told.plans)
                if better and self.chains[k].enough(packing):
                    return
            if leader is None or all(told.idle for told in ends):
                return
            tasks = [[] if cost == leader[0] else [leader[1]] for cost in costs]

    def starts(self, order: Sequence[str]) -> list[Start]:
        """What is packed first: the order's sequence and that of the first plan, by every heuristic."""
        first = () if self.record.best is None else self.record.best.placements
        placed = Counter(order) & Counter(p.item for p in first)
        as_packed = (*(p.item for p in first), *(Counter(order) - placed).elements())
        rules = range(len(self.chains[0].trails.rules))
        both = dict.fromkeys((tuple(order), as_packed))
        return [Start(tuple(Turn(name, k) for name in names), self.ceiling) for names in both for k in rules]

    @property
    def ceiling(self) -> float:
        """What further plans have to be below, m."""
        best, aim = self.record.best, self.record.search.aim
        return lower(best.height) if aim == "height" and best is not None and not best.lost else math.inf
