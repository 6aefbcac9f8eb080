"""The robot cell: where the container stands beside the robot.

Robot and container stand on one table: the base frame's z = 0 is the container's inner floor. The container's
axes are parallel to those of the base, its near wall ``NEAR_EDGE`` in front of joint 1's axis, its middle
on the base's x axis. docs/cell.md shows the reachability map behind it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from packenv.robot import gripper
from packenv.robot.shapes import arm_lowest, self_collision
from packenv.robot.tx90 import MAX_STEP, PathBranches, continuous_branches
from packenv.types import BoolArray, Container, FloatArray

NEAR_EDGE: Final = 0.30
"""From joint 1's axis to the inner face of the container's near wall, m."""
RIM_CLEARANCE: Final = 0.01
"""What links, gripper and held item keep above the rim before they go over the container, m."""
RELEASE_HEIGHT: Final = 0.01
"""How far above its place an item is let go, m (paper Sec. V)."""
WAYPOINT_STEP: Final = 0.02
"""Default distance of waypoints on a straight path, m."""


@dataclass(frozen=True)
class Cell:
    """A container in front of the robot.

    Attributes:
        container: the box.
        position: (x, y, z) of the container frame's origin in the base frame, m; the axes are parallel.
    """

    container: Container
    position: tuple[float, float, float]

    @classmethod
    def beside(cls, container: Container) -> Cell:
        """The chosen layout for a container of any size (docs/cell.md)."""
        return cls(container, (NEAR_EDGE, -container.width / 2.0, 0.0))

    @property
    def rim(self) -> float:
        """Height of the container's rim in the base frame, m."""
        return self.position[2] + self.container.height

    def to_base(self, points: FloatArray) -> FloatArray:
        """Points of the container frame in the base frame: (..., 3) to (..., 3), m."""
        moved: FloatArray = np.asarray(points, dtype=np.float64) + np.array(self.position)
        return moved

    def to_container(self, points: FloatArray) -> FloatArray:
        """Points of the base frame in the container frame: (..., 3) to (..., 3), m."""
        moved: FloatArray = np.asarray(points, dtype=np.float64) - np.array(self.position)
        return moved

    def poses_to_base(self, poses: FloatArray) -> FloatArray:
        """Poses in the container frame to poses in the base frame: (..., 4, 4) to (..., 4, 4)."""
        moved = np.array(poses, dtype=np.float64)
        moved[..., :3, 3] += self.position
        return moved

    def top_down_path(self, point: FloatArray, lift: float, *, spacing: float = WAYPOINT_STEP) -> FloatArray:
        """Flange poses that lower the cup straight down to a point.

        Args:
            point: (3,) centre of the cup's lip at the end, container frame, m.
            lift: how far above the point the path begins, m, at least 0.
            spacing: largest distance between two waypoints, m.

        Returns:
            (m, 4, 4) flange poses in the base frame, from the top down, both ends included.

        Raises:
            ValueError: ``lift`` is negative or ``spacing`` is not positive.
        """
        if not (lift >= 0.0 and spacing > 0.0):
            raise ValueError(f"lift is {lift:g} and spacing {spacing:g}, give lift ≥ 0 and spacing > 0")
        waypoints = int(np.ceil(lift / spacing - 1e-9)) + 1
        points = np.repeat(self.to_base(point)[None], waypoints, axis=0)
        points[:, 2] += np.linspace(lift, 0.0, waypoints)
        return gripper.tool_to_flange(gripper.top_down(points))

    def arm_clear(self, q: FloatArray) -> BoolArray:
        """Whether the arm keeps above the rim and off itself along each of some paths.

        Links 2 to 6 above the rim hit neither the walls nor what the container holds; the base and link 1
        stay within ``shapes.COLUMN_RADIUS``, which the layout keeps off the container. The gripper and the
        held item are the caller's to check.

        Args:
            q: (k, m, 6) joints of k paths of m poses, rad.

        Returns:
            (k,) True where every pose of the path is clear.
        """
        clear: BoolArray = np.all(arm_lowest(q) >= self.rim, axis=-1)
        clear[clear] = ~self_collision(q[clear]).any(axis=-1)
        return clear

    def clear_branches(self, path: FloatArray, *, max_step: float = MAX_STEP) -> PathBranches:
        """The continuous branches along a path whose arm keeps above the rim and off itself.

        Args:
            path: (m, 4, 4) flange poses in the base frame.
            max_step: as in :func:`packenv.robot.tx90.continuous_branches`.

        Returns:
            the branches that are left; none is an answer.
        """
        found = continuous_branches(path, max_step=max_step)
        keep = np.flatnonzero(self.arm_clear(found.q))
        return PathBranches(found.q[keep], tuple(found.slots[k] for k in keep), found.beyond_limits)
