"""The robot in a world: the primitives of its links, moved without error. It is watched, not felt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from packenv.robot.cell import Cell
from packenv.robot.shapes import Primitive
from packenv.sim.engine import Touch
from packenv.sim.world import World
from packenv.types import BoolArray, FloatArray

_EVERYWHERE = np.array([[-np.inf] * 3, [np.inf] * 3])
_FIRST_LINK = 2
"""The base and link 1 stay beside the container."""


@dataclass(frozen=True, eq=False)
class _Rod:
    """A primitive: its body, its link, and its middle and axes in the link's frame."""

    body: int
    link: int
    pose: FloatArray


@dataclass(frozen=True, eq=False)
class RobotWay:
    """Joints along a way, and what of the robot may meet something there.

    Attributes:
        joints: (n, 6) rad.
        boxes: (n, 2, 3) around the gripper, m.
        low: (n,) whether the arm is below the rim: while it keeps above, only the gripper needs a look.
    """

    joints: FloatArray
    boxes: FloatArray
    low: BoolArray


class RobotModel:
    """The robot beside the container. It is stiff: its joints are where the trajectory wants them."""

    def __init__(self, world: World, cell: Cell) -> None:
        """Put the gripper into the world; the arm comes when it is first below the rim.

        Args:
            world: where.
            cell: the robot, and where the container is beside it.
        """
        self.world, self._cell = world, cell
        world.joints = np.zeros(6)
        shapes = cell.robot.shapes
        self._gripper = self._rod(shapes.primitives[shapes.gripper])
        self._arm: tuple[_Rod, ...] | None = None

    def way(self, joints: FloatArray) -> RobotWay:
        """What to watch along (n, 6) joints, rad."""
        robot, gripper = self._cell.robot, self._cell.robot.gripper
        tools = self._cell.poses_to_container(robot.tool(joints))
        ends = np.stack([tools[:, :3, 3], tools[:, :3, 3] - gripper.length * tools[:, :3, 2]], axis=1)
        boxes = np.stack([ends.min(axis=1) - gripper.radius, ends.max(axis=1) + gripper.radius], axis=1)
        return RobotWay(joints, boxes, robot.arm_lowest(joints) < self._cell.rim)

    def near(self, way: RobotWay, held: int) -> BoolArray:
        """(n,) where the robot may meet something but the item that it holds, as all lies now."""
        return way.low | self.world.near(way.boxes, self._apart(held))

    def move(self, joints: FloatArray) -> None:
        """Put the joints where they shall be, rad, for whoever watches."""
        self.world.joints = joints
        if self.world.gui:
            self._place(joints, [*self._arm_rods(), self._gripper])

    def overlaps(self, way: RobotWay, k: int, held: int) -> list[Touch]:
        """What the robot is in at index ``k`` of a way, but for the item that it holds."""
        apart, joints = self._apart(held), way.joints[k]
        self._place(joints, [self._gripper])
        found = self.world.overlaps(self._gripper.body, way.boxes[k], apart)
        if way.low[k]:
            self._place(joints, self._arm_rods())
            for rod in self._arm_rods():
                found += self.world.overlaps(rod.body, _EVERYWHERE, apart)
        return found

    def _apart(self, held: int) -> tuple[int, int]:
        # The base stands on the table that the container's floor is part of.
        return held, self.world.fixed[0]

    def _arm_rods(self) -> tuple[_Rod, ...]:
        if self._arm is None:
            shapes = self._cell.robot.shapes
            links = (p for p in shapes.primitives[: shapes.gripper] if p.link >= _FIRST_LINK)
            self._arm = tuple(self._rod(primitive) for primitive in links)
        return self._arm

    def _rod(self, primitive: Primitive) -> _Rod:
        start, end = np.array(primitive.start), np.array(primitive.end)
        length = float(np.linalg.norm(end - start))
        body = self.world.engine.add_rod(length, primitive.radius, rounded=primitive.capsule)
        pose = np.eye(4)
        pose[:3, 2] = (end - start) / length
        # Any axes across will do: the rod is round.
        across = np.eye(3)[int(np.argmin(np.abs(pose[:3, 2])))]
        pose[:3, 0] = np.cross(across, pose[:3, 2])
        pose[:3, 0] /= np.linalg.norm(pose[:3, 0])
        pose[:3, 1] = np.cross(pose[:3, 2], pose[:3, 0])
        pose[:3, 3] = (start + end) / 2.0
        return _Rod(body, primitive.link, pose)

    def _place(self, joints: FloatArray, rods: Sequence[_Rod]) -> None:
        """Put rods where joints have them."""
        frames = self._cell.poses_to_container(self._cell.robot.link_frames(joints))
        for rod in rods:
            pose = frames[rod.link] @ rod.pose
            self.world.engine.place(rod.body, pose[:3, :3], pose[:3, 3])
