"""Rehearse a plan: carry it out in simulation before it is given out; where it fails, plan otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from packenv.geometry.prepare import PreparedItem
from packenv.planning.packer import Planner
from packenv.planning.packing import Packing, Pile
from packenv.planning.scores import HEURISTICS
from packenv.robot.cell import Cell
from packenv.sim.disturbance import Disturbance
from packenv.sim.drop_test import Lying
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.plan_tasks import run_tasks, task_of
from packenv.sim.session import Execution, ExecutionConfig, feeling
from packenv.sim.verdicts import DISPLACED
from packenv.types import Container

SEED = 7_000_000
"""Of the first disturbed world of a rehearsal: a seed that nobody is likely to measure with."""
ALTERNATIVES = ("hm", "dblf", "mta")
"""Heuristics that are tried, after the planner's own, where a plan fails."""
RESTARTS = 1
"""Most restarts of each of them."""
LATER = 2
"""Most plans with what left its place at the end of the sequence, where no heuristic's plan survives."""


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """Where plans are carried out before they are given out.

    The first world is the nominal one, and there the robot is blind. The others are disturbed, by seeds of
    their own, and there it feels contacts: without, a hold that is off by millimetres fails wherever there is
    no room to spare.

    Attributes:
        container: the box.
        physics: every item, for physics.
        urdf: of the robot.
        worlds: how many to rehearse in, at least 1.
        lying: what the container holds already.
        feel: the robot feels contacts in the nominal world too.
    """

    container: Container
    physics: Mapping[str, PhysicsItem]
    urdf: Path
    worlds: int
    lying: tuple[Lying, ...] = ()
    feel: bool = False

    def execution(self, packing: Packing, world: int) -> Execution:
        """What becomes of a plan in a world: 0 is the nominal one."""
        tasks = [task_of(p, self.physics[p.item], self.container) for p in packing.placements]
        disturbance = Disturbance(SEED + world) if world else None
        config = feeling(ExecutionConfig()) if world or self.feel else ExecutionConfig()
        arm = self.urdf if any(task.joints is not None for task in tasks) else None
        return run_tasks(tasks, Cell.beside(self.container), config, arm, disturbance, self.lying)

    def survived(self, packing: Packing) -> tuple[int, frozenset[str]]:
        """In how many worlds a plan succeeds before it fails in one, and which items went wrong there.

        A rehearsal ends with the first failure, for worlds are dear.
        """
        for world in range(self.worlds):
            execution = self.execution(packing, world)
            if not execution.success:
                return world, self._astray(execution)
        return self.worlds, frozenset()

    def _astray(self, execution: Execution) -> frozenset[str]:
        """Items that left their planned place; where none did, the one that met something in it."""
        astray = set()
        lies = execution.final[len(self.lying) :]
        for outcome, pose in zip(execution.items, lies, strict=True):
            item = self.physics[outcome.item]
            way = item.com_at(pose) - item.com_at(outcome.planned)
            if not outcome.collided and float(np.linalg.norm(way)) > DISPLACED:
                astray.add(outcome.item)
        return frozenset(astray or {o.item for o in execution.items if o.collided})


@dataclass(frozen=True, eq=False)
class Rehearsed:
    """A plan, and how it did.

    Attributes:
        packing: the plan.
        worlds: in how many worlds it was to be carried out.
        survived: in how many of them it succeeded before one in which it failed.
        plans: how many plans were rehearsed or made.
        astray: items that went wrong in that one.
    """

    packing: Packing
    worlds: int
    survived: int
    plans: int
    astray: frozenset[str] = frozenset()

    @property
    def metrics(self) -> dict[str, float]:
        """What a plan's file tells of it."""
        return {
            "rehearsal_worlds": self.worlds,
            "rehearsal_survived": self.survived,
            "rehearsal_plans": self.plans,
        }

    @property
    def flawless(self) -> bool:
        """True where nothing is left to wish for."""
        return self.packing.complete and self.survived == self.worlds


def pack_rehearsed(
    planner: Planner,
    sequence: Sequence[str],
    items: Mapping[str, PreparedItem],
    rehearsal: Rehearsal,
    *,
    first: Packing | None = None,
    running: Packing | None = None,
    start: Pile | None = None,
) -> Rehearsed:
    """Plan an order, carry the plan out in simulation, and plan otherwise until one plan survives.

    First by other heuristics; then with what went wrong in the best plan at the end of the sequence, where
    nothing that comes after can meet it.

    Args:
        planner: plans; its heuristic is tried first.
        sequence: item names.
        items: every named item, prepared.
        rehearsal: where to carry plans out.
        first: what the planner packs, where that is known already.
        running: a plan that is known already and asked before any is made.
        start: what the container holds already, for the planner.
    """
    found: list[Rehearsed] = []
    for packing in _packings(planner, sequence, items, rehearsal.container, found, first, running, start):
        survived, astray = 0, frozenset[str]()
        # What has fewer items than another one cannot win.
        if all(len(packing.placements) >= len(other.packing.placements) for other in found):
            survived, astray = rehearsal.survived(packing)
        found.append(Rehearsed(packing, rehearsal.worlds, survived, len(found) + 1, astray))
        if found[-1].flawless:
            break
    return replace(_best(found), plans=len(found))


def _best(found: Sequence[Rehearsed]) -> Rehearsed:
    """The fullest plan, of such the one that gets through most worlds, of such the first."""
    return max(found, key=lambda done: (len(done.packing.placements), done.survived))


def _packings(
    planner: Planner,
    sequence: Sequence[str],
    items: Mapping[str, PreparedItem],
    container: Container,
    found: Sequence[Rehearsed],
    first: Packing | None,
    running: Packing | None,
    start: Pile | None,
) -> Iterator[Packing]:
    """Plans in the sequence in which they are worth a rehearsal; ``found`` grows by each meanwhile."""
    if running is not None:
        yield running
    yield first or planner.pack(sequence, items, container, start)
    # What is hard for one heuristic is so for the others too, and each restart of it costs a whole plan.
    brief = replace(planner, restarts=min(planner.restarts, RESTARTS), resort=())
    for name in ALTERNATIVES:
        if HEURISTICS[name] is not planner.heuristic:
            yield replace(brief, heuristic=HEURISTICS[name]).pack(sequence, items, container, start)
    # A restart would bring forward what shall come last.
    straight = replace(brief, restarts=0)
    last = set(_best(found).astray)
    tried = {tuple(sequence)}
    for _ in range(LATER):
        later = sorted(sequence, key=lambda name: name in last)
        if tuple(later) in tried:
            return
        tried.add(tuple(later))
        yield straight.pack(later, items, container, start)
        last |= found[-1].astray
