"""Rehearse a plan: carry it out in simulation before it is given out; where it fails, plan otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

from packenv.geometry.prepare import PreparedItem
from packenv.planning.assembly import MAX_WORLDS
from packenv.planning.packer import Planner
from packenv.planning.packing import Packing, Pile
from packenv.planning.scores import HEURISTICS
from packenv.robot.cell import Cell
from packenv.sim.disturbance import Disturbance
from packenv.sim.drop_test import Lying
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.plan_tasks import run_tasks, task_of
from packenv.sim.session import Execution, ExecutionConfig, feeling
from packenv.sim.verdicts import OUT
from packenv.types import Container

Start: TypeAlias = Callable[[Planner], Pile]
"""What a planner finds in the container: each keeps the pile in its own way."""

SEED = 7_000_000
"""Of the first disturbed world of a rehearsal: a seed that nobody is likely to measure with."""
ALTERNATIVES = ("hm", "dblf", "mta")
"""Heuristics that are tried, after the planner's own, where a plan fails."""
RESTARTS = 1
"""Most restarts of each of them."""
LATER = 2
"""Most plans with what went wrong at the end of the sequence, where no heuristic's plan survives."""


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """Where plans are carried out before they are given out.

    The first world is the nominal one. The others are disturbed, by seeds of their own, and there the robot
    feels contacts: without, a hold that is off by millimetres fails wherever there is no room to spare.

    Attributes:
        container: the box.
        physics: every item, for physics.
        urdf: of the robot.
        worlds: how many to rehearse in, 1 to ``MAX_WORLDS``.
        config: settings of the nominal world.
        lying: what the container holds already.
    """

    container: Container
    physics: Mapping[str, PhysicsItem]
    urdf: Path
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
        tasks = [task_of(p, self.physics[p.item], self.container) for p in packing.placements]
        disturbance = Disturbance(SEED + world) if world else None
        config = feeling(self.config) if world else self.config
        arm = self.urdf if any(task.joints is not None for task in tasks) else None
        return run_tasks(tasks, Cell.beside(self.container), config, arm, disturbance, self.lying)

    def astray(self, execution: Execution) -> frozenset[str]:
        """Items of a plan to which its failure is owed, as far as they can be told.

        After a collision, what was met away from its place, else what met it. Where items stick out: those;
        where it is one that lay there before, what pushed it.
        """
        names = [outcome.item for outcome in execution.items]
        last = execution.items[-1] if execution.items else None
        if last is not None and last.collided:
            gone = execution.cause == "item-displaced" and last.met in names
            return frozenset({last.met if gone else last.item})
        before = len(self.lying)
        items = [*(thing.item for thing in self.lying), *(self.physics[name] for name in names)]
        found = set()
        for k, (item, pose) in enumerate(zip(items, execution.final, strict=True)):
            if item.beyond(self.container, *pose) > OUT:
                pushed = {outcome.item for outcome in execution.items if k in outcome.moved}
                found |= {names[k - before]} if k >= before else pushed
        return frozenset(found)


@dataclass(frozen=True, eq=False)
class Rehearsed:
    """A plan, and how it did.

    Attributes:
        packing: the plan.
        worlds: in how many worlds it was carried out.
        survived: in how many of them it succeeded.
        plans: how many plans were looked at.
    """

    packing: Packing
    worlds: int
    survived: int
    plans: int

    @property
    def metrics(self) -> dict[str, float]:
        """What a plan's file tells of it."""
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
) -> Rehearsed:
    """Plan an order, carry the plan out in simulation, and plan otherwise until one plan survives.

    First by other heuristics; then with what went wrong at the end of the sequence, where little comes after
    that could meet it; then likewise by other planners. A plan's rehearsal ends with the first world in which
    it fails, for worlds are dear. Where no plan survives them all, those that place the most items are
    carried out in the other worlds too. What succeeds in most is kept, of such what fails latest.

    Args:
        planner: plans; its heuristic is tried first.
        sequence: item names.
        items: every named item, prepared.
        rehearsal: where to carry plans out.
        first: what the planner packs, where that is known already.
        running: a plan that is under way: rehearsed before any is made, and given up for one as good.
        start: what the container holds already; empty where None.
        spares: planners to ask where every plan fails.
    """
    search = _Search(list(sequence), items, rehearsal, start)
    if running is not None and search.take(running):
        return search.result()
    if search.take(first or search.pack(planner)):
        return search.result()
    if not search.among_variants(planner):
        for spare in spares:
            if search.take(search.pack(spare)) or search.among_variants(spare):
                break
    return search.result(running)


@dataclass(eq=False)
class _Tried:
    """A plan, and what became of it in the worlds in which it was carried out."""

    packing: Packing
    executions: dict[int, Execution] = field(default_factory=dict)
    flawless: bool = False

    @property
    def survived(self) -> int:
        """In how many it succeeded."""
        return sum(execution.success for execution in self.executions.values())

    @property
    def released(self) -> int:
        """How many items were released, in all worlds."""
        return sum(not outcome.collided for e in self.executions.values() for outcome in e.items)


@dataclass(eq=False)
class _Search:
    """Plans of one order that are rehearsed one after another."""

    sequence: list[str]
    items: Mapping[str, PreparedItem]
    rehearsal: Rehearsal
    start: Start | None
    tried: list[_Tried] = field(default_factory=list)
    astray: set[str] = field(default_factory=set)

    def pack(self, planner: Planner, sequence: list[str] | None = None) -> Packing:
        """Plan."""
        pile = None if self.start is None else self.start(planner)
        return planner.pack(sequence or self.sequence, self.items, self.rehearsal.container, pile)

    def take(self, packing: Packing) -> bool:
        """Rehearse a plan; True where nothing is left to wish for."""
        found = _Tried(packing)
        self.tried.append(found)
        self.astray = set()
        if self.most() > len(packing.placements):
            return False  # what has fewer items than another one cannot win
        for world in range(self.rehearsal.worlds):
            execution = found.executions[world] = self.rehearsal.execution(packing, world)
            if not execution.success:
                self.astray = set(self.rehearsal.astray(execution))
                return False
        found.flawless = not packing.improvable
        return found.flawless

    def most(self) -> int:
        """Items of the fullest plan."""
        return max(len(found.packing.placements) for found in self.tried)

    def among_variants(self, planner: Planner) -> bool:
        """Rehearse variants of a planner whose own plan failed; True where one survives."""
        return any(self.take(packing) for packing in self.variants(planner))

    def variants(self, planner: Planner) -> Iterator[Packing]:
        """Plans by other heuristics, then with what went wrong late; ``astray`` tells of the last one."""
        late = set(self.astray)
        # What is hard for one heuristic is so for the others too, and each restart of it costs a whole plan.
        brief = replace(planner, restarts=min(planner.restarts, RESTARTS), resort=())
        for name in ALTERNATIVES:
            if HEURISTICS[name] is not planner.heuristic:
                yield self.pack(replace(brief, heuristic=HEURISTICS[name]))
        # A restart would bring forward what shall come last.
        straight = replace(brief, restarts=0)
        known = {tuple(self.sequence)}
        for _ in range(LATER):
            sequence = sorted(self.sequence, key=lambda name: name in late)
            if tuple(sequence) in known:
                return
            known.add(tuple(sequence))
            yield self.pack(straight, sequence)
            late |= self.astray

    def result(self, running: Packing | None = None) -> Rehearsed:
        """The best plan."""
        best = self.tried[-1]
        if not best.flawless:
            fullest = [found for found in self.tried if len(found.packing.placements) == self.most()]
            for found in fullest:
                self.carry_out_elsewhere(found)
            best = max(fullest, key=lambda f: (f.survived, f.released, f.packing is not running))
        return Rehearsed(best.packing, self.rehearsal.worlds, best.survived, len(self.tried))

    def carry_out_elsewhere(self, found: _Tried) -> None:
        """Carry a plan out in the worlds that its rehearsal did not come to."""
        for world in range(self.rehearsal.worlds):
            if world not in found.executions:
                found.executions[world] = self.rehearsal.execution(found.packing, world)
