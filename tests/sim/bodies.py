"""Items and tasks for tests of physics."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from packenv.geometry.ball_fit import Ball
from packenv.geometry.convex_parts import ConvexParts
from packenv.robot.files import default_cell
from packenv.sim.descent import PlacementTask
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.session import Execution, ExecutionConfig, Session
from packenv.sim.world import World
from packenv.types import Container, Item
from tests import shapes

BOX = Container(0.32, 0.32, 0.30)


def convex(item: Item) -> PhysicsItem:
    """An item that is convex."""
    return PhysicsItem.of_item(item, ConvexParts((item.vertices,), None, 0.0, 0.0))


def brick(x: float = 0.10, y: float = 0.08, z: float = 0.05, name: str = "brick") -> PhysicsItem:
    """A box with its smallest corner at the origin of its mesh frame."""
    return convex(shapes.box(x, y, z, name))


def ball(radius: float = 0.04) -> PhysicsItem:
    """A true sphere about the origin of its mesh frame."""
    item = shapes.ball(radius)
    return PhysicsItem.of_item(item, ConvexParts((item.vertices,), Ball(np.zeros(3), radius), 0.0, 0.0))


def by_hand(
    item: PhysicsItem, corner: tuple[float, float, float], slip: np.ndarray | None = None
) -> PlacementTask:
    """An ideal hand puts an item down without turning it."""
    heights = np.array([BOX.height, 0.01, 0.0])
    return PlacementTask(item, np.eye(3), np.array(corner), None, heights, slip)


def by_robot(
    item: PhysicsItem, size: tuple[float, float, float], corner: tuple[float, float, float]
) -> PlacementTask:
    """The robot does the same; the cup holds the middle of the top of a box of this size."""
    cell = default_cell().with_container(BOX)
    place = np.array(corner) + np.array(size) * [0.5, 0.5, 1.0]
    path = np.concatenate(
        [
            cell.top_down_path(place + np.array([0.0, 0.0, 0.01]), BOX.height - 0.01),
            cell.top_down_path(place, 0.0),
        ]
    )
    heights = path[:, 2, 3] - path[-1, 2, 3]
    return PlacementTask(
        item, np.eye(3), np.array(corner), cell.robot.continuous_branches(path).q[0], heights
    )


def slipped(x: float, y: float) -> np.ndarray:
    """An item that is off in the cup by so much."""
    slip = np.eye(4)
    slip[:2, 3] = x, y
    return slip


def carried_out(
    tasks: Sequence[PlacementTask],
    config: ExecutionConfig | None = None,
    watch: Callable[[World], None] | None = None,
) -> Execution:
    """Tasks in physics, up to a collision."""
    arm = any(task.joints is not None for task in tasks)
    with Session(
        default_cell().with_container(BOX), config or ExecutionConfig(), arm=arm, watch=watch
    ) as session:
        for task in tasks:
            session.place(task)
            if session.failed:
                break
        return session.result()
