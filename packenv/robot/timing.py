"""When the robot is where on a smooth path: speeds that start and end at rest, within the limits of every joint.

One rule for every path: the share of the path that is done grows with a smooth ramp of fixed duration, then
steadily, then ends with the same ramp. So positions, velocities and accelerations are continuous, and the largest
steady speed that keeps all limits follows in closed form: with q' and q'' the joints' derivatives by the share,
|q'| V ≤ v and |q''| V² + 1.5 |q'| V / ramp ≤ a at every point of the path, whenever the robot is there.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np

from packenv.errors import InputError, is_number
from packenv.types import FloatArray

STEP: Final = 0.02
"""Largest time between two points, s: straight lines between points then stay within 0.5 mm of the path."""
_ROUNDING: Final = 0.999
"""Of the limits is used, so that limits hold between the places where they are looked at, too."""


@dataclass(frozen=True)
class MotionLimits:
    """How fast the robot may move.

    Attributes:
        share: of the joints' published speeds that is used, above 0, at most 1.
        speed: largest speed of a cup that holds an item, m/s.
        acceleration: largest acceleration of a cup that holds an item, m/s².
        empty: how many times as fast, and as strongly accelerated, the empty cup may be.
        full_speed_in: s in which a joint may reach its published speed from rest: what bounds the joints'
            accelerations, which makers seldom publish. An assumption.
        ramp: s from rest to the steady speed, and from there to rest.
    """

    share: float = 0.5
    speed: float = 0.5
    acceleration: float = 2.5
    empty: float = 2.0
    full_speed_in: float = 0.25
    ramp: float = 0.3

    def __post_init__(self) -> None:
        """Check.

        Raises:
            InputError: a value is not a number above 0, or ``share`` is above 1.
        """
        for name, value in vars(self).items():
            most = 1.0 if name == "share" else 100.0
            if not is_number(value) or not 0.0 < value <= most:
                raise InputError(f"{name} is {value!r:.60}, give a number above 0, at most {most:g}")

    def joint_speeds(self, velocity: FloatArray) -> FloatArray:
        """(6,) largest joint speeds of published ones, rad/s."""
        return self.share * velocity

    def joint_accelerations(self, velocity: FloatArray) -> FloatArray:
        """(6,) largest joint accelerations, rad/s²."""
        return velocity / self.full_speed_in


@dataclass(frozen=True, eq=False)
class Motion:
    """Joints over time, from rest to rest.

    Attributes:
        times: (n,) s, from 0, ascending.
        positions: (n, 6) rad.
        velocities: (n, 6) rad/s.
        accelerations: (n, 6) rad/s².
    """

    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray

    @property
    def duration(self) -> float:
        """S."""
        return float(self.times[-1])


def timed(
    joints: FloatArray, tips: FloatArray, velocity: FloatArray, limits: MotionLimits, *, empty: bool = False
) -> Motion:
    """The motion along a smooth path.

    Args:
        joints: (m, 6) points of the path, m ≥ 4, evenly spaced in whatever describes it smoothly, rad.
        tips: (m, 3) where the tool is at each, m.
        velocity: (6,) published joint speeds, rad/s.
        limits: what is used of them.
        empty: the cup holds nothing.

    Returns:
        the motion along a cubic spline through the points.
    """
    from scipy.interpolate import CubicSpline

    path = np.concatenate([joints, tips], axis=1)
    spline = CubicSpline(np.linspace(0.0, 1.0, len(path)), path)
    at = np.linspace(0.0, 1.0, 4 * (len(path) - 1) + 1)
    first, second = np.abs(spline(at, 1)), np.abs(spline(at, 2))
    # The tool's velocity and acceleration are bounded as vectors.
    first, second = (np.column_stack([d[:, :6], np.linalg.norm(d[:, 6:], axis=1)]) for d in (first, second))
    times_as_fast = limits.empty if empty else 1.0
    fastest = np.append(limits.joint_speeds(velocity), times_as_fast * limits.speed)
    strongest = np.append(limits.joint_accelerations(velocity), times_as_fast * limits.acceleration)
    linear = 1.5 * first / limits.ramp
    with np.errstate(divide="ignore", invalid="ignore"):
        by_speed = np.min(fastest / np.maximum(first, 1e-12))
        # The positive root of second V² + linear V = strongest, in the form that needs no division by second.
        root = np.sqrt(linear**2 + 4.0 * second * strongest)
        by_acceleration = np.min(2.0 * strongest / np.maximum(linear + root, 1e-12))
    steady = min(_ROUNDING * by_speed, _ROUNDING * by_acceleration, 1.0 / limits.ramp)
    duration = 1.0 / steady + limits.ramp
    times = np.linspace(0.0, duration, ceil(duration / STEP) + 1)
    share, rate, change = _progress(times, duration, steady, limits.ramp)
    at_times = spline(share)[:, :6]
    slope, curve = spline(share, 1)[:, :6], spline(share, 2)[:, :6]
    at_times[0], at_times[-1] = joints[0], joints[-1]
    return Motion(
        times,
        at_times,
        slope * rate[:, None],
        curve * rate[:, None] ** 2 + slope * change[:, None],
    )


def _progress(
    times: FloatArray, duration: float, steady: float, ramp: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Share of the path that is done, and its first and second derivative by time.

    The ramp is the smoothstep 3u² - 2u³ of speed, whose slope is 0 at both ends and at most 1.5.
    """
    left = np.minimum(times, duration - times)
    u = np.clip(left / ramp, 0.0, 1.0)
    done = steady * (ramp * (u**3 - u**4 / 2.0) + np.maximum(left - ramp, 0.0))
    second_half = times > duration / 2.0
    share = np.where(second_half, 1.0 - done, done)
    change = steady / ramp * 6.0 * u * (1.0 - u)
    return share, steady * (3.0 * u**2 - 2.0 * u**3), np.where(second_half, -change, change)
