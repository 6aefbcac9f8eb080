"""How fast the robot follows a path: times for waypoints, and joints at any time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from packenv.robot.protocol import Robot
from packenv.types import FloatArray

_SAME: Final = 1e-6
"""Joints that differ by less are the same, rad."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Joints over time: straight lines in joint space between knots.

    Attributes:
        times: (m,) s, from 0, ascending.
        joints: (m, 6) rad.
    """

    times: FloatArray
    joints: FloatArray

    @property
    def duration(self) -> float:
        """S."""
        return float(self.times[-1])

    def sampled(self, step: float) -> FloatArray:
        """(n, 6) joints at every ``step`` seconds, both ends included."""
        times = np.minimum(np.arange(int(np.ceil(self.duration / step - 1e-9)) + 1) * step, self.duration)
        columns = [np.interp(times, self.times, column) for column in self.joints.T]
        return np.column_stack(columns)


def follow(
    joints: FloatArray,
    tips: FloatArray,
    velocity: FloatArray,
    *,
    speed: float = 0.5,
    acceleration: float = 2.0,
    share: float = 0.5,
) -> Trajectory:
    """The fastest way along a path that starts and ends at rest within all limits.

    A trapezoid of tool speed over the length of the tool's path, slowed down wherever a joint would
    exceed its share of its published speed.

    Args:
        joints: (m, 6) waypoints, rad.
        tips: (m, 3) where the tool is at each, m.
        velocity: (6,) largest joint speeds, rad/s.
        speed: largest speed of the tool, m/s.
        acceleration: of the tool, m/s².
        share: of the joints' largest speeds that is used.

    Returns:
        the trajectory, with knots close enough for the ramps (1/100 of a second or of the path).
    """
    joints = np.asarray(joints, dtype=np.float64)
    lengths = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    total = float(along[-1])
    if total <= 0.0:
        return Trajectory(np.zeros(1), joints[:1])
    stations = np.unique(np.concatenate([along, np.linspace(0.0, total, 101)]))
    path = np.column_stack([np.interp(stations, along, joints[:, j]) for j in range(joints.shape[1])])
    step = np.diff(stations)
    limit = np.full(len(step), speed)
    turned = np.abs(np.diff(path, axis=0))
    with np.errstate(divide="ignore"):
        limit = np.minimum(limit, (share * velocity / np.maximum(turned / step[:, None], 1e-12)).min(axis=1))
    # Ramps: v² ≤ 2 a s from either end, and from every slower place.
    squared = np.zeros(len(stations))
    squared[1:-1] = np.minimum(limit[:-1], limit[1:]) ** 2
    for k in range(1, len(stations)):
        squared[k] = min(squared[k], squared[k - 1] + 2.0 * acceleration * step[k - 1])
    for k in range(len(stations) - 2, -1, -1):
        squared[k] = min(squared[k], squared[k + 1] + 2.0 * acceleration * step[k])
    v = np.sqrt(squared)
    durations = 2.0 * step / (v[:-1] + v[1:])
    return Trajectory(np.concatenate([[0.0], np.cumsum(durations)]), path)


def refine(robot: Robot, joints: FloatArray, *, spacing: float = 0.002) -> FloatArray:
    """Fill the straight lines between waypoints with further ones, on the same branch.

    Straight lines in joint space bulge: by half a millimetre between two waypoints 2 cm apart, which is more
    than the gaps beside a packed item.

    Args:
        robot: whose joints they are.
        joints: (m, 6) waypoints whose flanges have one orientation, rad.
        spacing: largest distance between flanges, m.

    Returns:
        (n, 6) rad, the given waypoints among them.

    Raises:
        ValueError: no branch leads through all waypoints.
    """
    knots = robot.forward(joints)
    path = [knots[:1]]
    for before, after in pairwise(knots):
        n = max(1, int(np.ceil(np.linalg.norm(after[:3, 3] - before[:3, 3]) / spacing - 1e-9)))
        share = np.arange(1, n + 1)[:, None, None] / n
        path.append(before + share * (after - before))
    places = np.cumsum([0, *(len(part) for part in path[1:])])
    found = robot.continuous_branches(np.concatenate(path)).q
    # A joint that stands at half a turn may come out at minus half a turn: the same posture, a whole turn away.
    found = found + 2.0 * np.pi * np.round((joints[0] - found[:, :1]) / (2.0 * np.pi))
    found = found[(robot.limit_margin(found) >= -_SAME).all(axis=1)]
    errors = np.abs(found[:, places] - joints).max(axis=(1, 2))
    if not len(errors) or errors.min() > _SAME:
        raise ValueError("the waypoints do not lie on one branch of the inverse kinematics")
    refined: FloatArray = found[int(np.argmin(errors))]
    return refined
