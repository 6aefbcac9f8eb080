"""The TX90 in a world: its URDF, moved joint by joint without error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pybullet

from packenv.robot.cell import Cell
from packenv.sim.world import SCALE, World
from packenv.types import FloatArray

_JOINTS = 6


class RobotModel:
    """The robot beside the container. It is stiff: its joints are where the trajectory wants them."""

    def __init__(self, world: World, cell: Cell, urdf: Path) -> None:
        """Load the robot.

        Args:
            world: where.
            cell: where the container is beside it.
            urdf: of the robot.
        """
        p, c = pybullet, world.client
        self.world = world
        base = cell.to_container(np.zeros(3)) * SCALE
        self.body = int(
            p.loadURDF(str(urdf), base.tolist(), useFixedBase=True, globalScaling=SCALE, physicsClientId=c)
        )
        for joint in range(_JOINTS):
            # Bullet brakes every joint of a new robot.
            p.setJointMotorControl2(self.body, joint, p.VELOCITY_CONTROL, force=0.0, physicsClientId=c)
        # Robot and container stand on one table, which is no obstacle.
        world.ignore_pair(self.body, world.fixed[0])

    def move(self, joints: FloatArray) -> None:
        """Put the joints where they shall be, rad."""
        for joint, value in enumerate(joints.tolist()):
            pybullet.resetJointState(self.body, joint, value, 0.0, physicsClientId=self.world.client)
