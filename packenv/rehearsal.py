"""Rehearse a plan: carry it out in simulation before it is given out; where it fails, plan otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from packenv.geometry.prepare import PreparedItem
from packenv.planning.packer import Planner
from packenv.planning.packing import Packing
from packenv.planning.scores import HEURISTICS
from packenv.robot.cell import Cell
from packenv.sim.disturbance import Disturbance
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.plan_tasks import run_tasks, task_of
from packenv.sim.session import ExecutionConfig, feeling
from packenv.types import Container

SEED = 7_000_000
"""Of the first disturbed world of a rehearsal: a seed that nobody is likely to measure with."""
ALTERNATIVES = ("hm", "dblf", "mta")
"""Heuristics that are tried, after the planner's own, where a plan fails."""
RESTARTS = 1
"""Most restarts of each of them."""


@dataclass(frozen=True, eq=False)
class Rehearsed:
    """A plan, and how it did.

    Attributes:
        packing: the plan.
        worlds: in how many worlds it was carried out.
        survived: in how many of them it succeeded before one in which it failed.
        plans: how many plans were made.
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
    container: Container,
    physics: Mapping[str, PhysicsItem],
    urdf: Path,
    worlds: int,
    first: Packing | None = None,
) -> Rehearsed:
    """Plan an order, carry the plan out in simulation, and plan by other heuristics until one plan survives.

    The first world is the nominal one, and there the robot is blind. The others are disturbed, by seeds of
    their own, and there it feels contacts: without, a hold that is off by millimetres fails wherever there is
    no room to spare. A plan's rehearsal ends with the first world in which it fails, for worlds are dear. The
    fullest plan is kept, of such the one that gets through most worlds, of such the first.

    Args:
        planner: plans; its heuristic is tried first.
        sequence: item names.
        items: every named item, prepared.
        container: the box.
        physics: every named item, for physics.
        urdf: of the robot.
        worlds: how many to rehearse in, at least 1.
        first: what the planner packs, where that is known already.
    """
    best: Rehearsed | None = None
    for plans, packing in enumerate(_packings(planner, sequence, items, container, first), start=1):
        survived = 0
        # What has fewer items than another one cannot win.
        if best is None or len(packing.placements) >= len(best.packing.placements):
            failures = (k for k in range(worlds) if not _survives(packing, physics, container, urdf, k))
            survived = next(failures, worlds)
        found = Rehearsed(packing, worlds, survived, plans)
        if best is None or _goodness(found) > _goodness(best):
            best = found
        if packing.complete and survived == worlds:
            break
    assert best is not None
    return replace(best, plans=plans)


def _goodness(rehearsed: Rehearsed) -> tuple[int, int]:
    return len(rehearsed.packing.placements), rehearsed.survived


def _packings(
    planner: Planner,
    sequence: Sequence[str],
    items: Mapping[str, PreparedItem],
    container: Container,
    first: Packing | None,
) -> Iterator[Packing]:
    yield first or planner.pack(sequence, items, container)
    # What is hard for one heuristic is so for the others too, and each restart of it costs a whole plan.
    brief = replace(planner, restarts=min(planner.restarts, RESTARTS), resort=None)
    for name in ALTERNATIVES:
        if HEURISTICS[name] is not planner.heuristic:
            yield replace(brief, heuristic=HEURISTICS[name]).pack(sequence, items, container)


def _survives(
    packing: Packing, physics: Mapping[str, PhysicsItem], container: Container, urdf: Path, world: int
) -> bool:
    """Whether a plan succeeds in a world: 0 is the nominal one."""
    tasks = [task_of(p, physics[p.item], container) for p in packing.placements]
    disturbance = Disturbance(SEED + world) if world else None
    config = feeling(ExecutionConfig()) if world else ExecutionConfig()
    arm = urdf if any(task.joints is not None for task in tasks) else None
    return run_tasks(tasks, Cell.beside(container), config, arm, disturbance).success
