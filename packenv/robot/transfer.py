"""Paths of the cup between two places: straight up and down, and about joint 1's axis at a safe height.

With the cup pointing down, the arm's posture depends on the cup's height and on its distance from joint 1's axis
alone. So a path whose distance, angle about the axis, height and yaw all change evenly takes the arm from one place
to the other in one posture, and a held item is not tilted.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import atan2, ceil, hypot, pi
from typing import Final

import numpy as np

from packenv.robot.gripper import top_down
from packenv.robot.protocol import Robot
from packenv.types import FloatArray

SPACING: Final = 0.005
"""Largest distance of points on a path, m."""
_TURN_SPACING: Final = 0.01
"""Largest turn between points on a path, rad."""
_POINTS: Final = 6
"""No path has fewer, so that a cubic spline can be laid through."""
_SAME: Final = 1e-6
"""Joints that differ by less are the same, rad."""


def vertical(pose: FloatArray, lift: float) -> FloatArray:
    """Straight up: a (4, 4) tool pose to (m, 4, 4), from ``pose`` to ``lift`` metres above, evenly spaced."""
    n = max(_POINTS, ceil(lift / SPACING - 1e-9) + 1)
    path = np.repeat(pose[None], n, axis=0)
    path[:, 2, 3] += np.linspace(0.0, lift, n)
    return path


def arcs(start: FloatArray, end: FloatArray) -> Iterator[FloatArray]:
    """Ways about joint 1's axis from one pose to another, both with the cup down; the shortest turns first.

    Args:
        start: (4, 4) tool pose in the base frame.
        end: likewise.

    Yields:
        (m, 4, 4) tool poses, evenly spaced: either way round, with the yaw either way round.
    """
    (r0, phi0, z0, psi0), (r1, phi1, z1, psi1) = (_cylindrical(pose) for pose in (start, end))
    for turn in _either_way(phi1 - phi0):
        for twist in _either_way(psi1 - psi0):
            length = abs(r1 - r0) + abs(z1 - z0) + max(r0, r1) * abs(turn)
            most = max(length / SPACING, max(abs(turn), abs(twist)) / _TURN_SPACING)
            share = np.linspace(0.0, 1.0, max(_POINTS, ceil(most) + 1))
            r, phi = r0 + share * (r1 - r0), phi0 + share * turn
            yaw = phi + psi0 + share * twist
            poses = top_down(np.stack([r * np.cos(phi), r * np.sin(phi), z0 + share * (z1 - z0)], axis=-1))
            c, s = np.cos(yaw), np.sin(yaw)
            poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0], poses[:, 1, 1] = c, s, s, -c
            yield poses


def branches(robot: Robot, path: FloatArray) -> FloatArray:
    """(k, m, 6) rad: every continuous branch along (m, 4, 4) tool poses within the joint limits."""
    return robot.continuous_branches(robot.gripper.tool_to_flange(path)).q


def same_posture(first: FloatArray, second: FloatArray) -> bool:
    """Whether two joint vectors are whole turns apart, or none."""
    apart = first - second
    return bool(np.abs(apart - 2.0 * pi * np.round(apart / (2.0 * pi))).max() < _SAME)


def turned_to(q: FloatArray, start: FloatArray) -> FloatArray:
    """A path of joints, whole turns aside, that begins at ``start``, which has the posture of its first point."""
    moved: FloatArray = q + np.round((start - q[0]) / (2.0 * pi)) * 2.0 * pi
    moved[0] = start
    return moved


def joined(robot: Robot, start: FloatArray, end: FloatArray) -> Iterator[FloatArray]:
    """Paths of joints from one vector to another, both with the cup down, without a change of posture.

    Args:
        robot: whose joints they are.
        start: (6,) rad.
        end: (6,) rad.

    Yields:
        (m, 6) rad, the first ``start`` and the last ``end``, within the joint limits.
    """
    for path in arcs(*robot.tool(np.stack([start, end]))):
        for q in branches(robot, path):
            if not (same_posture(q[0], start) and same_posture(q[-1], end)):
                continue
            moved = turned_to(q, start)
            if np.abs(moved[-1] - end).max() < _SAME and robot.limit_margin(moved).min() > -_SAME:
                moved[-1] = end
                yield moved


def straight(start: FloatArray, end: FloatArray) -> FloatArray:
    """(m, 6) rad: a straight line in joint space from one joint vector to another."""
    n = max(_POINTS, ceil(float(np.abs(end - start).max()) / _TURN_SPACING) + 1)
    line: FloatArray = start + np.linspace(0.0, 1.0, n)[:, None] * (end - start)
    return line


def _cylindrical(pose: FloatArray) -> tuple[float, float, float, float]:
    """Distance and angle about the vertical, height, and yaw against that angle."""
    x, y, z = pose[:3, 3].tolist()
    phi = atan2(y, x)
    return hypot(x, y), phi, z, atan2(pose[1, 0], pose[0, 0]) - phi


def _either_way(angle: float) -> tuple[float, float]:
    """The turn within [-π, π], and the one the other way round."""
    short = angle - 2.0 * pi * round(angle / (2.0 * pi))
    return short, short - 2.0 * pi if short > 0.0 else short + 2.0 * pi
