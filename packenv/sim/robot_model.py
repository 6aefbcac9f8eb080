"""The robot in a world: its URDF, moved joint by joint without error."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pybullet

from packenv.robot.cell import Cell
from packenv.sim.world import SCALE, Touch, World
from packenv.types import FloatArray

_JOINTS = 6
_GRIPPER = 6
"""Index of the gripper's link."""
_EVERYWHERE = (np.full(3, -np.inf), np.full(3, np.inf))


class RobotModel:
    """The robot beside the container. It is stiff: its joints are where the trajectory wants them."""

    def __init__(self, world: World, cell: Cell) -> None:
        """Load the robot.

        Args:
            world: where.
            cell: the robot, and where the container is beside it.
        """
        p, c = pybullet, world.client
        self.world = world
        base = (cell.to_container(np.zeros(3)) * SCALE).tolist()
        turn = p.getQuaternionFromEuler([0.0, 0.0, -cell.yaw])
        with tempfile.TemporaryDirectory(prefix="robotpack-") as folder:
            urdf = Path(folder) / "robot.urdf"
            urdf.write_text(cell.robot.urdf(), encoding="utf-8")
            self.body = int(
                p.loadURDF(str(urdf), base, turn, useFixedBase=True, globalScaling=SCALE, physicsClientId=c)
            )
        for joint in range(_JOINTS):
            # Bullet brakes every joint of a new robot.
            p.setJointMotorControl2(self.body, joint, p.VELOCITY_CONTROL, force=0.0, physicsClientId=c)
        # It is watched, not felt: what it meets ends the execution.
        world.ghost(self.body)
        self._cell, self._joints = cell, np.zeros(_JOINTS)

    def move(self, joints: FloatArray) -> None:
        """Put the joints where they shall be, rad."""
        for joint, value in enumerate(joints.tolist()):
            pybullet.resetJointState(self.body, joint, value, 0.0, physicsClientId=self.world.client)
        self._joints = joints

    def overlaps(self, held: int | None) -> list[Touch]:
        """What the robot is in now, but for the item that it holds.

        While the arm keeps above all that is in the container, only the gripper needs a look.
        """
        robot, gripper = self._cell.robot, self._cell.robot.gripper
        tool = self._cell.poses_to_container(robot.tool(self._joints[None]))[0]
        tip = tool[:3, 3]
        back = tip - gripper.length * tool[:3, 2]
        low, high = np.minimum(tip, back) - gripper.radius, np.maximum(tip, back) + gripper.radius
        found = self.world.overlaps(self.body, low, high, _GRIPPER)
        if robot.arm_lowest(self._joints) < self._cell.rim:
            # The base stands on the table that the container's floor is part of.
            for link in range(1, _GRIPPER):
                found += self.world.overlaps(self.body, _EVERYWHERE[0], _EVERYWHERE[1], link)
        return [touch for touch in found if touch.other not in (held, self.world.fixed[0])]
