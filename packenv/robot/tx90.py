"""Kinematics of the Stäubli TX90: forward, all inverse branches, and branches continued along a path.

Frames: the *base frame* has its origin in the mounting face, z up along joint 1; the *flange frame* is that
of link 6, z out of the flange. Angles in rad, lengths in m, poses as homogeneous 4 × 4 matrices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from packenv.robot import kinematics
from packenv.robot.tx90_data import LOWER, UPPER
from packenv.types import BoolArray, FloatArray

MAX_STEP = 0.35
"""Default bound on a joint's step between two poses of a path, rad (20°)."""


@dataclass(frozen=True, eq=False)
class Branches:
    """All inverse-kinematics branches of some flange poses.

    Slot 4 · wrist + 2 · shoulder + elbow holds the same configuration at every pose: wrist 0 has q5 ≥ 0,
    shoulder 0 reaches forward, elbow 0 has q3 ≥ 0.

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


def link_frames(q: FloatArray) -> FloatArray:
    """Frames of the base and of links 1 to 6.

    Args:
        q: (..., 6) joint angles, rad.

    Returns:
        (..., 7, 4, 4) link frames in the base frame; the last is the flange.

    Raises:
        ValueError: the last axis is not 6 long.
    """
    q = np.ascontiguousarray(q, dtype=np.float64)
    if q.shape[-1:] != (6,):
        raise ValueError(f"q has shape {q.shape}, give six joint angles on the last axis")
    frames = np.empty((q.size // 6, 7, 4, 4))
    kinematics.link_frames(q.reshape(-1, 6), frames)
    return frames.reshape(*q.shape[:-1], 7, 4, 4)


def forward(q: FloatArray) -> FloatArray:
    """Pose of the flange.

    Args:
        q: (..., 6) joint angles, rad.

    Returns:
        (..., 4, 4) flange pose in the base frame.
    """
    return np.ascontiguousarray(link_frames(q)[..., 6, :, :])


def inverse(poses: FloatArray) -> Branches:
    """All joint angles that bring the flange to given poses.

    Singularities: on the shoulder's and the elbow's borders two branches coincide and both are given; a wrist
    centre beyond the border by at most ``kinematics.REACH_TOLERANCE`` (1e-10 m) is taken to be on it. In the
    wrist's singularity (|sin q5| < ``kinematics.WRIST_TOLERANCE``, 1e-9) joint 4 is free: one solution of the
    family is given, with q4 = 0 (wrist 0) or ±π (wrist 1).

    Args:
        poses: (m, 4, 4) flange poses in the base frame; rotations orthonormal.

    Returns:
        the branches of each pose.

    Raises:
        ValueError: the shape is wrong.
    """
    poses = _poses(poses)
    q = np.empty((len(poses), 8, 6))
    valid = np.empty((len(poses), 8), dtype=np.bool_)
    kinematics.inverse(poses, q, valid)
    return Branches(q, valid)


def continuous_branches(path: FloatArray, *, max_step: float = MAX_STEP) -> PathBranches:
    """All branches that carry the flange along a path without a jump and within the joint limits.

    Paper Alg. 1 asks that every waypoint be solvable; here one branch must do for all of them.

    Args:
        path: (m, 4, 4) flange poses in the base frame, m ≥ 1.
        max_step: largest step of any joint between two poses, rad. Near a stretched elbow small steps of the
            flange are large ones of the joints: such paths are refused.

    Returns:
        the branches; none where the path cannot be followed, which is an answer and no error.

    Raises:
        ValueError: the shape is wrong.
    """
    path = _poses(path)
    if not len(path):
        raise ValueError("path is empty, give at least one pose")
    q = np.empty((8, len(path), 6))
    state = np.empty(8, dtype=np.int8)
    kinematics.follow(path, float(max_step), q, state)
    good = np.flatnonzero(state == 0)
    return PathBranches(q[good], tuple(int(s) for s in good), int(np.count_nonzero(state == 2)))


def continuous_branch(path: FloatArray, *, max_step: float = MAX_STEP) -> FloatArray | None:
    """The branch along a path that keeps farthest from the joint limits.

    Args:
        path: (m, 4, 4) flange poses in the base frame, m ≥ 1.
        max_step: as in :func:`continuous_branches`.

    Returns:
        (m, 6) rad, or None where no branch follows the path.
    """
    found = continuous_branches(path, max_step=max_step)
    if not len(found):
        return None
    branch: FloatArray = found.q[int(np.argmax(limit_margin(found.q).min(axis=1)))]
    return branch


def limit_margin(q: FloatArray) -> FloatArray:
    """Distance of the joints from their limits.

    Args:
        q: (..., 6) rad.

    Returns:
        (...) smallest distance of any joint from a limit, rad; negative outside.
    """
    margin: FloatArray = np.minimum(q - LOWER, UPPER - q).min(axis=-1)
    return margin


def all_turns(q: FloatArray) -> FloatArray:
    """Every joint vector within the limits that is one posture of the arm, whole turns apart.

    Args:
        q: (6,) rad.

    Returns:
        (k, 6) rad, the input's turn or the one nearest to 0 included; k = 0 where a joint has none.
    """
    choices = []
    tolerance = kinematics.LIMIT_TOLERANCE
    for j in range(6):
        first = np.ceil((LOWER[j] - tolerance - q[j]) / (2 * np.pi))
        last = np.floor((UPPER[j] + tolerance - q[j]) / (2 * np.pi))
        choices.append(q[j] + 2 * np.pi * np.arange(first, last + 1))
    turns: FloatArray = np.stack(np.meshgrid(*choices, indexing="ij"), axis=-1).reshape(-1, 6)
    return turns


def _poses(poses: FloatArray) -> FloatArray:
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ValueError(f"poses have shape {poses.shape}, give (m, 4, 4)")
    return poses
