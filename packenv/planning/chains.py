"""Chains of plans, each a little different from one before: several walk side by side, in rounds.

What a chain does in a round depends on its seed and on what it is given, not on the others' progress or on where it
runs. So the same rounds come out in one process and in several.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from packenv.planning.packing import Packing
from packenv.planning.trails import Cost, Trail, Trails, Turn

_STALE = 60
"""So many plans without a better one end a walk: it goes on from the best."""

_WORSE = 0.1
"""Share of worse plans that are walked on from, if they lose no more than one piece more."""

_AGAIN = 0.3
"""Share of changes that are two changes at once."""

_WHOLE = 0.5
"""Share of changes of heuristic that change every piece's, and not that of one."""

_LOWER = 0.01
"""Share by which the next pile has to be lower."""

_IDLE = 60
"""So many changes in a row that change nothing end a round."""


@dataclass(frozen=True)
class Start:
    """What a plan is made of.

    Attributes:
        turns: what is packed, and how.
        ceiling: no item's top is above it, m.
    """

    turns: tuple[Turn, ...]
    ceiling: float = math.inf


@dataclass(frozen=True)
class Round:
    """What a chain is asked to do.

    Attributes:
        begin: is packed before anything else; the best of it, or of what the chain has, is gone on from.
        plans: how many plans to make at most.
        end: when to end, as the chain's clock tells, s.
    """

    begin: tuple[Start, ...]
    plans: int
    end: float


@dataclass(frozen=True, eq=False)
class Improvement:
    """A plan that is better than all before it in its chain.

    Attributes:
        start: what to go on from: its turns, and for the aim of a low pile a ceiling that is lower than this one.
        packing: the plan.
        cost: as :meth:`Trails.cost` has it.
        plans: how many plans the chain had made by then in this round, this one included.
    """

    start: Start
    packing: Packing
    cost: Cost
    plans: int


@dataclass(frozen=True)
class RoundEnd:
    """How a round ended.

    Attributes:
        plans: how many plans were made.
        idle: no change changed anything: there is nothing to search for.
    """

    plans: int
    idle: bool


def lower(height: float) -> float:
    """The ceiling for the next plan after one of this height, m."""
    return height * (1.0 - _LOWER)


class _OverError(Exception):
    """The time is over."""


@dataclass(eq=False)
class Chain:
    """Walks from plan to plan.

    Attributes:
        trails: makes the plans.
        seed: of the changes.
        better: figures of a packing, the larger the better.
        enough: whether a plan ends the search.
        clock: tells seconds.
    """

    trails: Trails
    seed: tuple[int, ...]
    better: Callable[[Packing], tuple[float, ...]]
    enough: Callable[[Packing], bool]
    clock: Callable[[], float] = time.monotonic
    _current: Trail | None = field(default=None, init=False)
    _best: Trail | None = field(default=None, init=False)
    _figures: tuple[float, ...] = field(default=(), init=False)
    _stale: int = field(default=0, init=False)
    _told: Cost | None = field(default=None, init=False)
    _begin: list[Start] = field(default_factory=list, init=False)
    _kept: Trail | None = field(default=None, init=False)
    _ceiling: float = field(default=math.inf, init=False)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)

    def advance(self, task: Round) -> Iterator[Improvement | RoundEnd]:
        """Walk on; every better plan is told when it is found, and at last how the round ended."""
        plans, idle = 0, 0

        def in_time() -> None:
            if self.clock() > task.end:
                raise _OverError

        self._begin += task.begin
        try:
            while plans < task.plans and idle < _IDLE:
                in_time()
                given = self._begin.pop(0) if self._begin else None
                if given is not None and given.ceiling > self._ceiling:
                    continue
                if given is not None and given.ceiling < self._ceiling:
                    self._lower(given.ceiling)
                turns = self._changed() if given is None else given.turns
                if turns is None:
                    idle += 1
                    continue
                idle = 0
                risky = self._rng.random() < _WORSE
                limit = self._limit(given=given is not None, risky=risky)
                trail = self.trails.trail(turns, self._current or self._kept, in_time, limit)
                plans += 1
                if not trail.finished:
                    self._aged(better=False)
                    continue
                if (told := self._improvement(trail, plans)) is not None:
                    yield told
                    if self.enough(told.packing):
                        break
                    if told.start.ceiling < self._ceiling:
                        self._kept = self.trails.kept(trail, told.start.ceiling)
                        self._begin.insert(0, told.start)
                        continue
                self._walk_on(trail, begins=given is not None, risky=risky)
        except _OverError:
            pass
        yield RoundEnd(plans, idle >= _IDLE)

    def _improvement(self, trail: Trail, plans: int) -> Improvement | None:
        """What is to be told of a plan; None where it is neither better nor cheaper than all before."""
        cost, packing = self.trails.cost(trail), self.trails.packing(trail)
        figures = self.better(packing)
        if self._told is not None and figures <= self._figures and cost >= self._told:
            return None
        self._figures = max(figures, self._figures)
        self._told = cost if self._told is None else min(cost, self._told)
        whole = self.trails.aim == "height" and not cost[0]
        ceiling = lower(cost[2]) if whole else self._ceiling
        return Improvement(Start(trail.turns, ceiling), packing, cost, plans)

    def _lower(self, ceiling: float) -> None:
        """Go on under a lower ceiling, where no plan is known yet."""
        self._ceiling, self.trails = ceiling, self.trails.under(ceiling)
        self._current = self._best = None
        self._kept = None if self._kept is None else self.trails.kept(self._kept, ceiling)
        self._stale = 0

    def _limit(self, *, given: bool, risky: bool) -> Callable[[Cost], bool]:
        """Which cost ends a plan early: one that is not walked on from.

        Args:
            given: the plan is, so it is made whatever it costs.
            risky: a worse plan is walked on from.
        """
        if given or self._current is None:
            return lambda cost: False
        now = self.trails.cost(self._current)
        if risky:
            return lambda cost: cost[0] > now[0] + 1
        return lambda cost: cost > now

    def _walk_on(self, trail: Trail, *, begins: bool, risky: bool) -> None:
        """Go on from a plan that is not worse, now and then from one that is, and from the best if all is stale.

        Args:
            trail: the plan.
            begins: it was given, not found by a change.
            risky: one that is worse by one piece without a place is walked on from.
        """
        if self._current is None or self._best is None:
            self._current = self._best = trail
            return
        cost, now = self.trails.cost(trail), self.trails.cost(self._current)
        if begins:
            if cost < self.trails.cost(self._best):
                self._current = self._best = trail
            return
        if cost <= now or (risky and cost[0] <= now[0] + 1):
            self._current = trail
        if cost < self.trails.cost(self._best):
            self._best = trail
        self._aged(better=cost < now)

    def _aged(self, *, better: bool) -> None:
        """One more plan: after many that are no better the best is walked on from."""
        self._stale = 0 if better else self._stale + 1
        if self._stale > _STALE:
            self._current, self._stale = self._best, 0

    def _changed(self) -> tuple[Turn, ...] | None:
        """Other turns than the present ones; None where nothing changed."""
        trail = self._current
        if trail is None:
            return None
        turns, lost = list(trail.turns), trail.lost
        for _ in range(2 if self._rng.random() < _AGAIN else 1):
            draw, (i, j) = self._rng.random(), self._rng.integers(0, len(turns), 2).tolist()
            if lost and draw < 0.5:
                k = int(self._rng.choice(lost))
                before = self.trails.latest(trail, k)
                if before is None:
                    return None
                before = before if self._rng.random() < 0.5 else int(self._rng.integers(0, before + 1))
                turns.insert(before, turns.pop(k))
                lost = []
            elif draw < 0.7:
                turns[i], turns[j] = turns[j], turns[i]
            elif draw < 0.85:
                turns.insert(j, turns.pop(i))
            else:
                rule = int(self._rng.integers(len(self.trails.rules)))
                whole = self._rng.random() < _WHOLE
                for k in range(len(turns)) if whole else (i,):
                    turns[k] = replace(turns[k], rule=rule)
        found = tuple(turns)
        return None if found == trail.turns else found
