"""Rehearse a plan: carry it out in simulation before it is given out; where it fails, plan otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from packenv.geometry.prepare import PreparedItem
from packenv.planning.deadline import NEVER, Deadline
from packenv.planning.options import rules
from packenv.planning.packing import Packing
from packenv.planning.planner import Planner
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import HEURISTICS, name_of
from packenv.planning.search.measured import Resting
from packenv.robot.cell import Cell
from packenv.sim.disturbance import Disturbance
from packenv.sim.drop_test import Lying
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.plan_tasks import run_tasks, task_of
from packenv.sim.session import Execution, ExecutionConfig, feeling
from packenv.sim.verdicts import DISPLACED, OUT

Start: TypeAlias = tuple[ContainerMap, Sequence[Resting]]
"""The heightmap of what the container holds already, and the items themselves."""

_Named: TypeAlias = tuple[str, Packing]
"""How a plan was made, and the plan."""

FIRST, RUNNING = "first", "running"
"""How a plan is called that was given, to begin with or as what is under way."""

SEED = 7_000_000
"""Of the first disturbed world of a rehearsal: a seed that nobody is likely to measure with."""
SETTLE = 3.0
"""Longest time for coming to rest, s: what moves on does so for long."""
MAX_WORLDS = int(rules()["rehearse"].most)
"""Most worlds in which a plan is carried out before it is given out."""
ALTERNATIVES = ("minz", "hm", "dblf", "mta")
"""Heuristics that are tried, after the one that made the first plan, where that fails."""
MIXED = 2
"""How many of them are tried before what went wrong is put at the end of the sequence once more."""
RANKED = 3
"""Most plans that are carried out in all worlds where every plan fails in one."""


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """Where plans are carried out before they are given out.

    The first world is the nominal one. The others are disturbed, by seeds of their own, and there the robot
    feels contacts: without, a hold that is off by millimetres fails wherever there is no room to spare.

    Attributes:
        cell: the box, beside the robot.
        physics: every item, for physics.
        worlds: how many to rehearse in, 1 to ``MAX_WORLDS``.
        config: settings of the nominal world.
        lying: what the container holds already.
    """

    cell: Cell
    physics: Mapping[str, PhysicsItem]
    worlds: int
    config: ExecutionConfig = field(default_factory=ExecutionConfig)
    lying: tuple[Lying, ...] = ()

    def __post_init__(self) -> None:
        """Check.

        Raises:
            ValueError: the number of worlds is out of range.
        """
        if not 1 <= self.worlds <= MAX_WORLDS:
            raise ValueError(f"worlds is {self.worlds}, should be 1 to {MAX_WORLDS}")

    def execution(self, packing: Packing, world: int) -> Execution:
        """What becomes of a plan in a world: 0 is the nominal one."""
        tasks = [task_of(p, self.physics[p.item], self.cell) for p in packing.placements]
        disturbance = Disturbance(SEED + world) if world else None
        motion = replace(self.config.motion, settle=min(SETTLE, self.config.motion.settle))
        config = replace(self.config, motion=motion)
        config = feeling(config) if world else config
        return run_tasks(tasks, self.cell, config, disturbance, self.lying)

    def blamed_items(self, execution: Execution) -> frozenset[str]:
        """Items of a plan that went wrong when it failed: to these, or to some of them, the failure is owed.

        What is away from its place; where nothing that was met is, what met it; what sticks out, and where
        that is an item that lay there before, what pushed it.
        """
        before = len(self.lying)
        items = [*(thing.item for thing in self.lying), *(self.physics[o.item] for o in execution.items)]
        found = set()
        for k, (item, pose) in enumerate(zip(items, execution.final, strict=True)):
            outcome = execution.items[k - before] if k >= before else None
            if outcome is not None and outcome.collided:
                if execution.cause == "collision":
                    found.add(outcome.item)
                continue
            if outcome is not None:
                way = item.com_at(pose) - item.com_at(outcome.planned)
                if float(np.linalg.norm(way)) > DISPLACED:
                    found.add(outcome.item)
            if item.beyond(self.cell.container, *pose) > OUT:
                pushed = {o.item for o in execution.items if k in o.moved}
                found |= pushed if outcome is None else {outcome.item}
        return frozenset(found)


@dataclass(frozen=True, eq=False)
class Rehearsed:
    """A plan, and how it did.

    Attributes:
        packing: the plan.
        worlds: in how many worlds it was carried out.
        survived: in how many of them it succeeded.
        plans: how many plans were looked at.
        how: how it was planned: as given (``FIRST``, ``RUNNING``), or the heuristic; ``spare 1`` before it for the
            first spare planner, ``late`` behind it with what went wrong at the end of the sequence.
    """

    packing: Packing
    worlds: int
    survived: int
    plans: int
    how: str

    @property
    def chosen(self) -> Packing:
        """The plan, which says how it was made."""
        known = self.how in (FIRST, RUNNING)
        return self.packing if known else replace(self.packing, made_by=self.how)

    @property
    def metrics(self) -> dict[str, float]:
        """How it did, for the plan's file."""
        return {
            "rehearsal_worlds": self.worlds,
            "rehearsal_survived": self.survived,
            "rehearsal_plans": self.plans,
        }


def pack_rehearsed(
    planner: Planner,
    sequence: Sequence[str],
    items: Mapping[str, PreparedItem],
    rehearsal: Rehearsal,
    *,
    first: Packing | None = None,
    running: Packing | None = None,
    start: Start | None = None,
    spares: Sequence[Planner] = (),
    until: Deadline = NEVER,
    report: Callable[[str], None] = lambda line: None,
) -> Rehearsed:
    """Plan an order, carry the plan out in simulation, and plan otherwise until one plan survives.

    First by the spares, then by the planner: with what went wrong at the end of the sequence, where little comes after
    that could meet it, and by other heuristics. A plan's rehearsal ends with the first world in
    which it fails, for worlds are expensive, and those in which most plans failed come first. Where no plan survives
    them all, of those that place the most items the few that got farthest are carried out in all worlds. What
    succeeds in most is kept, of such what fails latest.

    Args:
        planner: plans; its heuristic is tried first.
        sequence: item names.
        items: every named item, prepared.
        rehearsal: where to carry plans out.
        first: what the planner packs, where that is known already.
        running: a plan that is under way: rehearsed before any is made, and given up for one as good.
            The planner's own comes after the spares' then, and its other heuristics only where there are
            no spares, for somebody waits.
        start: what the container holds already; empty where None.
        spares: planners that are cheap to ask.
        until: no further plan is made, and none rehearsed further, after it; one is rehearsed in one world at least.
        report: is told of every plan but a first one that survives, a line each.
    """
    search = _Search(list(sequence), items, rehearsal, start, until, report)
    planner, spares = replace(planner, until=until), [replace(spare, until=until) for spare in spares]
    for how, packing in search.plans(planner, first, running, spares):
        if search.take(how, packing) or until.passed:
            break
    return search.result(running)


@dataclass(eq=False)
class _Tried:
    """A plan, how it was made, and what became of it in the worlds in which it was carried out."""

    how: str
    packing: Packing
    executions: dict[int, Execution] = field(default_factory=dict)
    blamed_items: frozenset[str] = frozenset()
    nothing_to_improve: bool = False

    @property
    def survived(self) -> int:
        """In how many it succeeded."""
        return sum(execution.success for execution in self.executions.values())

    @property
    def released(self) -> int:
        """How many items were released, in all worlds."""
        return sum(not outcome.collided for e in self.executions.values() for outcome in e.items)


def _same(one: Packing, other: Packing) -> bool:
    """Whether two plans put the same items at the same poses in the same sequence."""
    return len(one.placements) == len(other.placements) and all(
        a.item == b.item and np.array_equal(a.position, b.position) and np.array_equal(a.rotation, b.rotation)
        for a, b in zip(one.placements, other.placements, strict=True)
    )


@dataclass(eq=False)
class _Search:
    """Plans of one order that are rehearsed one after another."""

    sequence: list[str]
    items: Mapping[str, PreparedItem]
    rehearsal: Rehearsal
    start: Start | None
    until: Deadline
    report: Callable[[str], None]
    tried: list[_Tried] = field(default_factory=list)

    def __post_init__(self) -> None:
        # In a disturbed world more fails than in the nominal one.
        self._worlds = [*range(1, self.rehearsal.worlds), 0]

    @property
    def blamed_items(self) -> frozenset[str]:
        """What went wrong in the last plan."""
        return self.tried[-1].blamed_items

    def pack(self, planner: Planner, sequence: list[str] | None = None) -> Packing:
        """Pack the order, or the given sequence, on what lies there at the start."""
        pile = None if self.start is None else planner.pile(*self.start)
        return planner.pack(sequence or self.sequence, self.items, self.rehearsal.cell.container, pile)

    def take(self, how: str, packing: Packing) -> bool:
        """Rehearse a plan; True where nothing is left to wish for."""
        found = _Tried(how, packing)
        self.tried.append(found)
        words = f"plan {len(self.tried)} ({how}), {packing.words}"
        if any(_same(packing, other.packing) for other in self.tried[:-1]):
            self.report(f"{words}: the same as one before")
            return False
        if self.most() > len(packing.placements):
            self.report(f"{words}: fewer items than another one")  # so it cannot win
            return False
        for count, world in enumerate(self._worlds):
            if count and self.until.passed:
                self.report(f"{words}: survives {count} of {len(self._worlds)} worlds, and the time is over")
                return False
            execution = self.carry_out(found, world)
            if not execution.success:
                found.blamed_items = self.rehearsal.blamed_items(execution)
                self.report(f"{words}: fails in world {count + 1} of {len(self._worlds)}: {execution.detail}")
                self._worlds.insert(0, self._worlds.pop(count))
                return False
        if len(self.tried) > 1:
            self.report(f"{words}: survives all {len(self._worlds)} worlds")
        found.nothing_to_improve = not packing.improvable
        return found.nothing_to_improve

    def most(self) -> int:
        """Items of the fullest plan."""
        return max(len(found.packing.placements) for found in self.tried)

    def plans(
        self, planner: Planner, first: Packing | None, running: Packing | None, spares: Sequence[Planner]
    ) -> Iterator[_Named]:
        """Plans in the sequence in which they are worth a rehearsal, which comes between them."""
        yield (RUNNING, running) if running is not None else self.own(planner, first)
        blamed = self.blamed_items
        for number, spare in enumerate(spares, start=1):
            yield f"spare {number} {name_of(spare.heuristic)}", self.pack(spare)
            variants = self.variants(spare, self.blamed_items)
            yield from ((f"spare {number} {how}", packing) for how, packing in variants)
        if running is not None:
            yield self.own(planner, first)
            blamed = self.blamed_items
        if running is None or not spares:
            yield from self.variants(planner, blamed, "" if first is None else first.made_by)

    def own(self, planner: Planner, first: Packing | None) -> _Named:
        """What the planner packs."""
        return (name_of(planner.heuristic), self.pack(planner)) if first is None else (FIRST, first)

    def variants(self, planner: Planner, blamed: frozenset[str], made_by: str = "") -> Iterator[_Named]:
        """Plans with what went wrong in the first at the end of the sequence, and by other heuristics than made it."""
        asked = made_by if made_by in HEURISTICS else name_of(planner.heuristic)
        # Each restart costs a whole plan, and would bring forward what shall come last.
        strategy = replace(planner.strategy, restarts=0, last_resorts=())
        straight = replace(planner, strategy=strategy)
        first = replace(straight, heuristic=HEURISTICS[made_by]) if made_by in HEURISTICS else straight
        others = [name for name in ALTERNATIVES if name != asked]
        late, known = blamed, {tuple(self.sequence)}
        for group in (others[:MIXED], others[MIXED:]):
            sequence = sorted(self.sequence, key=lambda name: name in late)
            if tuple(sequence) not in known:
                known.add(tuple(sequence))
                yield f"{asked} late", self.pack(first, sequence)
                late |= self.blamed_items
            for name in group:
                yield name, self.pack(replace(straight, heuristic=HEURISTICS[name]))
                late |= self.blamed_items

    def result(self, running: Packing | None) -> Rehearsed:
        """The best plan."""
        best = self.tried[-1]
        if not best.nothing_to_improve:
            fullest = [found for found in self.tried if len(found.packing.placements) == self.most()]
            best_so_far = sorted(fullest, key=lambda f: (f.survived, f.released), reverse=True)[:RANKED]
            for found in best_so_far:
                for world in sorted(set(self._worlds) - found.executions.keys()):
                    if not self.until.passed:
                        self.carry_out(found, world)
            best = max(best_so_far, key=lambda f: (f.survived, f.released, f.packing is not running))
        return Rehearsed(best.packing, self.rehearsal.worlds, best.survived, len(self.tried), best.how)

    def carry_out(self, found: _Tried, world: int) -> Execution:
        """Carry a plan out in a world, and keep what became of it."""
        execution = found.executions[world] = self.rehearsal.execution(found.packing, world)
        return execution
