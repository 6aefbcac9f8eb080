"""The vacuum gripper: a stiff tube with a suction cup (paper Sec. V: 30 cm long, 2 cm in diameter).

It is screwed to the flange, its axis on the flange's z. The *tool frame* has its origin in the cup's lip and
the flange's axes, so z points out of the cup, into the item.

The cup is round: its yaw about its own axis is free when it takes an item. It also costs nothing. With the
cup pointing down, a turn of the tool is a turn of joint 6 alone: whatever yaw is asked for, the arm's posture,
and so what it hits, is the same. A caller may therefore keep one yaw for everything.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from packenv.config import GRAVITY
from packenv.types import FloatArray

CUP_RADIUS = 0.01
"""Radius of the paper's cup, m."""


ATMOSPHERE = 101_325.0
"""Pressure of the air, Pa: what a cup at full vacuum is held by."""


@dataclass(frozen=True)
class Gripper:
    """A tube with a cup at its end.

    Attributes:
        length: flange to the cup's lip, m.
        radius: of tube and cup, m.
        mass: kg.
        payload: the heaviest item that it holds, kg, where that is known. None works it out, see :attr:`heaviest`.
        vacuum: how far the pressure under the cup is below that of the air, Pa; full vacuum by default.
        safety: factor by which the cup must hold more than the item weighs; 1 by default, the physical limit.
    """

    length: float = 0.30
    radius: float = CUP_RADIUS
    mass: float = 0.25
    payload: float | None = None
    vacuum: float = ATMOSPHERE
    safety: float = 1.0

    @property
    def heaviest(self) -> float:
        """No heavier item is planned, kg: the payload, or what the air carries on the cup, over the safety factor."""
        if self.payload is not None:
            return self.payload
        return self.vacuum * math.pi * self.radius**2 / GRAVITY / self.safety

    def tool_to_flange(self, tool_poses: FloatArray) -> FloatArray:
        """Flange poses that bring the tool to given poses.

        Args:
            tool_poses: (..., 4, 4) tool frames.

        Returns:
            (..., 4, 4) flange frames, in the frame that the tool's were given in.
        """
        flange = np.array(tool_poses, dtype=np.float64)
        flange[..., :3, 3] -= self.length * flange[..., :3, 2]
        return flange

    def flange_to_tool(self, flange_poses: FloatArray) -> FloatArray:
        """Inverse of :meth:`tool_to_flange`: (..., 4, 4) flange frames to tool frames."""
        tool = np.array(flange_poses, dtype=np.float64)
        tool[..., :3, 3] += self.length * tool[..., :3, 2]
        return tool


def top_down(points: FloatArray, yaw: float = 0.0) -> FloatArray:
    """Tool poses with the cup pointing straight down.

    Args:
        points: (..., 3) where the centre of the cup's lip shall be, m, in a frame with z up.
        yaw: of the tool's x axis about the vertical, rad.

    Returns:
        (..., 4, 4) tool poses in the points' frame.
    """
    points = np.asarray(points, dtype=np.float64)
    poses = np.zeros((*points.shape[:-1], 4, 4))
    c, s = np.cos(yaw), np.sin(yaw)
    poses[..., :3, :3] = [[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]]
    poses[..., :3, 3] = points
    poses[..., 3, 3] = 1.0
    return poses
