"""Closed loop: look at the pile after every placement, and plan the rest anew when something moved."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from packenv.geometry.prepare import PreparedItem
from packenv.planning.measured import Resting, measured_map
from packenv.planning.packer import Packing, Pile, Planner
from packenv.sim.disturbance import Disturbance
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.plan_tasks import task_of
from packenv.sim.session import Execution, Pose, Session
from packenv.types import Item, Leftover, Placement

MOVED = 0.002
"""Items that are farther than this from where they are believed to be call for a new plan, m: a cell."""


@dataclass(frozen=True, eq=False)
class ClosedLoopResult:
    """What became of an order in closed loop.

    Attributes:
        execution: in physics; its success needs every planned item placed.
        placements: as they were planned last, in packing sequence.
        leftovers: items for which the last plan found no place.
        plans: how often was planned, the first time included.
    """

    execution: Execution
    placements: tuple[Placement, ...]
    leftovers: tuple[Leftover, ...]
    plans: int

    @property
    def success(self) -> bool:
        """Every item of the order is inside the container and nothing collided."""
        return self.execution.success and not self.leftovers


def run_closed_loop(
    planner: Planner,
    packing: Packing,
    session: Session,
    meshes: Mapping[str, Item],
    prepared: Mapping[str, PreparedItem],
    physics: Mapping[str, PhysicsItem],
    disturbance: Disturbance | None = None,
    watch: Callable[[Packing], None] | None = None,
) -> ClosedLoopResult:
    """Carry out a plan; after every placement compare the measured poses with those believed.

    Where an item is farther than ``MOVED`` from where the plan has it, the measured poses become the
    heightmap and the rest of the order is planned anew, in the sequence in which it was planned.

    Args:
        planner: plans the rest.
        packing: the plan to begin with.
        session: an empty world.
        meshes: every item of the order, of the geometry that is planned with, by name.
        prepared: the same, prepared.
        physics: the same, for physics.
        disturbance: makes the tasks differ from what was planned; the session's world is the caller's.
        watch: called with every new plan.
    """
    waiting = list(packing.placements)
    leftovers = packing.leftovers
    done: list[Placement] = []
    believed: list[Pose] = []
    plans = 1
    while waiting and not session.failed:
        placement = waiting.pop(0)
        task = task_of(placement, physics[placement.item], session.container)
        session.place(task if disturbance is None else disturbance.task(task, len(done) + 1))
        done.append(placement)
        believed.append((placement.rotation, placement.position))
        measured = session.measured()
        if not waiting or session.failed or not _moved(done, believed, measured, physics):
            continue
        resting = [
            Resting(meshes[p.item], rotation, position)
            for p, (rotation, position) in zip(done, measured, strict=True)
        ]
        surface = measured_map(session.container, planner.cell_size, resting)
        start = Pile(surface, tuple(c.start(resting) for c in planner.constraints))
        names = [p.item for p in waiting] + [left.item for left in leftovers]
        again = planner.pack(names, prepared, session.container, start)
        plans += 1
        if watch is not None:
            watch(again)
        waiting, leftovers = list(again.placements), again.leftovers
        believed = list(measured)
    return ClosedLoopResult(session.result(), tuple(done), leftovers, plans)


def _moved(
    done: Sequence[Placement],
    believed: Sequence[Pose],
    measured: Sequence[Pose],
    physics: Mapping[str, PhysicsItem],
) -> bool:
    """Whether any item is not where it is believed to be."""
    for placement, (r0, p0), (r1, p1) in zip(done, believed, measured, strict=True):
        item = physics[placement.item]
        # As if the item's own ball turned with it: a bound on how far any of its points is off.
        away = float(np.linalg.norm(r1 @ item.com + p1 - r0 @ item.com - p0))
        turn = float(np.linalg.norm(r1 - r0)) / np.sqrt(2.0)
        if away + (0.0 if item.radius else turn * item.reach) > MOVED:
            return True
    return False
