"""From the placements of a plan to what the robot shall do in physics."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from packenv.errors import PlanError
from packenv.robot.cell import RELEASE_HEIGHT, RIM_CLEARANCE, Cell
from packenv.robot.motion import refine
from packenv.sim.descent import PlacementTask
from packenv.sim.disturbance import Disturbance
from packenv.sim.drop_test import Lying
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.session import Execution, ExecutionConfig, Session
from packenv.types import Container, Placement


def task_of(placement: Placement, item: PhysicsItem, container: Container) -> PlacementTask:
    """The task of one placement.

    A plan that asked the robot tells joints; any other is carried out by an ideal hand without size.

    Raises:
        PlanError: the stated path is not one.
    """
    path = placement.path
    if path is None:
        lift = max(container.height + RIM_CLEARANCE - float(placement.corner[2]), RELEASE_HEIGHT)
        heights = np.array([lift, RELEASE_HEIGHT, 0.0])
        return PlacementTask(item, placement.rotation, placement.position, None, heights)
    try:
        refine(Cell.beside(container).robot, path.joints)
    except ValueError as problem:
        raise PlanError(f"{placement.item}: details.manipulation: {problem}, plan again") from None
    return PlacementTask(item, placement.rotation, placement.position, path.joints, path.cup_heights)


def run_tasks(
    tasks: Sequence[PlacementTask],
    cell: Cell,
    config: ExecutionConfig,
    urdf: Path | None,
    disturbance: Disturbance | None = None,
    lying: Sequence[Lying] = (),
) -> Execution:
    """Carry tasks out one after another, open loop, up to the first collision.

    Args:
        tasks: in packing sequence.
        cell: container and robot.
        config: settings of the nominal world.
        urdf: of the robot; None where no task has joints.
        disturbance: makes world and tasks differ from what was planned.
        lying: what the container holds already.
    """
    settings = config if disturbance is None else disturbance.config(config)
    with Session(cell, settings, urdf, lying=lying) as session:
        for step, task in enumerate(tasks, start=len(lying) + 1):
            session.place(task if disturbance is None else disturbance.task(task, step))
            if session.failed:
                break
        return session.result()
