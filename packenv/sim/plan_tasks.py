"""From the placements of a plan to what the robot shall do in physics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from packenv.errors import PlanError
from packenv.robot.cell import Cell
from packenv.robot.motion import refine
from packenv.sim.descent import PlacementTask
from packenv.sim.disturbance import Disturbance
from packenv.sim.drop_test import Lying
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.session import Execution, ExecutionConfig, Session
from packenv.types import Placement


def task_of(placement: Placement, item: PhysicsItem, cell: Cell) -> PlacementTask:
    """The task of one placement.

    A plan that asked the robot tells joints; any other is carried out by an ideal hand without size.

    Raises:
        PlanError: the stated path is not one.
    """
    path = placement.path
    if path is None:
        release = cell.setup.release_height
        top = cell.container.height + cell.setup.rim_clearance
        heights = np.array([max(top - float(placement.corner[2]), release), release, 0.0])
        return PlacementTask(item, placement.rotation, placement.position, None, heights)
    try:
        refine(cell.robot, path.joints)
    except ValueError as problem:
        raise PlanError(f"{placement.item}: details.manipulation: {problem}, plan again") from None
    return PlacementTask(item, placement.rotation, placement.position, path.joints, path.cup_heights)


def run_tasks(
    tasks: Sequence[PlacementTask],
    cell: Cell,
    config: ExecutionConfig,
    disturbance: Disturbance | None = None,
    lying: Sequence[Lying] = (),
) -> Execution:
    """Carry tasks out one after another, open loop, up to the first collision.

    Args:
        tasks: in packing sequence.
        cell: container and robot.
        config: settings of the nominal world.
        disturbance: makes world and tasks differ from what was planned.
        lying: what the container holds already.
    """
    settings = config if disturbance is None else disturbance.config(config)
    arm = any(task.joints is not None for task in tasks)
    coming = [task.item for task in tasks]
    with Session(cell, settings, arm=arm, lying=lying, coming=coming) as session:
        for step, task in enumerate(tasks, start=len(lying) + 1):
            session.place(task if disturbance is None else disturbance.task(task, step))
            if session.failed:
                break
        return session.result()
