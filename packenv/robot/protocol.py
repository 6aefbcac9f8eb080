"""What planning, checking and physics ask of a robot, whatever its kind.

Frames: the *base frame* has its origin in the mounting face, z up along joint 1; the *flange frame* is that
of link 6, z out of the flange. Angles in rad, lengths in m, poses as homogeneous 4 × 4 matrices.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from packenv.robot.gripper import Gripper
from packenv.robot.kinematics import LIMIT_TOLERANCE
from packenv.robot.shapes import LinkShapes
from packenv.types import BoolArray, FloatArray

MAX_STEP = 0.35
"""Default bound on a joint's step between two poses of a path, rad (20°)."""


@dataclass(frozen=True, eq=False)
class Branches:
    """All inverse-kinematics branches of some flange poses.

    A slot holds the same configuration at every pose.

    Attributes:
        q: (m, 8, 6) rad, every joint moved by whole turns into its limits where that is possible, nearest
            to 0; NaN where the branch does not exist (out of reach).
        valid: (m, 8) the branch exists and all its joints are within their limits.
    """

    q: FloatArray
    valid: BoolArray

    @property
    def exists(self) -> BoolArray:
        """(m, 8) the branch exists, whatever the limits."""
        exists: BoolArray = ~np.isnan(self.q[..., 0])
        return exists


@dataclass(frozen=True, eq=False)
class PathBranches:
    """Every branch along one path.

    Attributes:
        q: (k, m, 6) rad, continuous and within the limits, in the sequence of the first pose's slots.
        slots: (k,) slot of the first pose.
        beyond_limits: number of branches that the joint limits end.
    """

    q: FloatArray
    slots: tuple[int, ...]
    beyond_limits: int

    def __len__(self) -> int:
        """Number of branches."""
        return len(self.slots)


class Robot(Protocol):
    """A six-axis arm with a gripper at its flange. Derive from it: what a robot must bring is abstract.

    Attributes:
        name: one word.
        joint_names: six, from the base.
        lower, upper: (6,) joint limits, rad.
        velocity: (6,) largest joint speeds, rad/s.
        gripper: at the flange.
        shapes: the space that the links and the gripper take.
        near_edge: recommended distance from joint 1's axis to the container's near wall, m.
    """

    name: str
    joint_names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    gripper: Gripper
    shapes: LinkShapes
    near_edge: float

    @abstractmethod
    def link_frames(self, q: FloatArray) -> FloatArray:
        """Frames of the base and of links 1 to 6.

        Args:
            q: (..., 6) joint angles, rad.

        Returns:
            (..., 7, 4, 4) link frames in the base frame; the last is the flange.

        Raises:
            ValueError: the last axis is not 6 long.
        """

    @abstractmethod
    def inverse(self, poses: FloatArray) -> Branches:
        """All joint angles that bring the flange to given poses.

        Args:
            poses: (m, 4, 4) flange poses in the base frame; rotations orthonormal.

        Raises:
            ValueError: the shape is wrong.
        """

    @abstractmethod
    def continuous_branches(self, path: FloatArray, *, max_step: float = MAX_STEP) -> PathBranches:
        """All branches that carry the flange along a path without a jump and within the joint limits.

        Paper Alg. 1 asks that every waypoint be solvable; here one branch must do for all of them.

        Args:
            path: (m, 4, 4) flange poses in the base frame, m ≥ 1.
            max_step: largest step of any joint between two poses, rad. Near a stretched elbow small steps of
                the flange are large ones of the joints: such paths are refused.

        Returns:
            the branches; none where the path cannot be followed, which is an answer and no error.

        Raises:
            ValueError: the shape is wrong.
        """

    @abstractmethod
    def urdf(self) -> str:
        """The robot with its gripper as URDF text: links, joints, shapes and masses."""

    @abstractmethod
    def to_mapping(self) -> dict[str, Any]:
        """The robot's record as JSON has it (docs/cell.md)."""

    @abstractmethod
    def with_gripper(self, gripper: Gripper) -> Robot:
        """The same arm with another gripper."""

    @property
    def highest_rim(self) -> float:
        """No posture has links 2 to 6 above this height, base frame, m; infinite where that is not known."""
        return float("inf")

    @property
    def reach(self) -> float:
        """The flange's axis never is farther from joint 1's while it points down, m; infinite where not known."""
        return float("inf")

    def forward(self, q: FloatArray) -> FloatArray:
        """Pose of the flange: (..., 6) rad to (..., 4, 4) in the base frame."""
        return np.ascontiguousarray(self.link_frames(q)[..., 6, :, :])

    def tool(self, q: FloatArray) -> FloatArray:
        """Pose of the cup's lip: (..., 6) rad to (..., 4, 4) in the base frame."""
        return self.gripper.flange_to_tool(self.forward(q))

    def continuous_branch(self, path: FloatArray, *, max_step: float = MAX_STEP) -> FloatArray | None:
        """The branch along a path that keeps farthest from the joint limits.

        Args:
            path: (m, 4, 4) flange poses in the base frame, m ≥ 1.
            max_step: as in :meth:`continuous_branches`.

        Returns:
            (m, 6) rad, or None where no branch follows the path.
        """
        found = self.continuous_branches(path, max_step=max_step)
        if not len(found):
            return None
        branch: FloatArray = found.q[int(np.argmax(self.limit_margin(found.q).min(axis=1)))]
        return branch

    def limit_margin(self, q: FloatArray) -> FloatArray:
        """Smallest distance of any joint from a limit: (..., 6) rad to (...) rad; negative outside."""
        margin: FloatArray = np.minimum(q - self.lower, self.upper - q).min(axis=-1)
        return margin

    def all_turns(self, q: FloatArray) -> FloatArray:
        """Every joint vector within the limits that is one posture of the arm, whole turns apart.

        Args:
            q: (6,) rad.

        Returns:
            (k, 6) rad, the input's turn or the one nearest to 0 included; k = 0 where a joint has none.
        """
        choices = []
        for j in range(6):
            first = np.ceil((self.lower[j] - LIMIT_TOLERANCE - q[j]) / (2 * np.pi))
            last = np.floor((self.upper[j] + LIMIT_TOLERANCE - q[j]) / (2 * np.pi))
            choices.append(q[j] + 2 * np.pi * np.arange(first, last + 1))
        turns: FloatArray = np.stack(np.meshgrid(*choices, indexing="ij"), axis=-1).reshape(-1, 6)
        return turns

    def arm_lowest(self, q: FloatArray) -> FloatArray:
        """Height of the lowest point of links 2 to 6: the part of the arm that may be over the container.

        The base and link 1 never leave the cylinder of radius ``shapes.column_radius``; the gripper is meant
        to enter the container. Neither counts.

        Args:
            q: (..., 6) rad.

        Returns:
            (...) m above the base frame's z = 0.
        """
        return self.shapes.arm_lowest(self.link_frames(q))

    def self_collision(self, q: FloatArray) -> BoolArray:
        """Whether the arm or the gripper meets itself, judged by the enclosing capsules.

        Args:
            q: (..., 6) rad.

        Returns:
            (...) True where two capsules of links two or more joints apart overlap.
        """
        return self.shapes.self_collision(self.link_frames(q))
