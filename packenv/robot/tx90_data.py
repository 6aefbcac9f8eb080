"""Published figures of the Stäubli TX90: plain data, SI units, radians.

Source: ros-industrial/staubli_experimental, ``staubli_tx90_support`` (Apache-2.0), whose limits come from the
maker's manual D28082904C and whose masses come from CAD and may be inaccurate. Joint i turns link i about an
axis of its own frame: z, y, y, z, y, z. All joints at 0: the arm stands straight up.
"""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np

from packenv.types import FloatArray

BASE_HEIGHT: Final = 0.478
"""Height of the shoulder axis (joint 2) above the mounting face, m."""
SHOULDER_OFFSET: Final = 0.05
"""From the axis of joint 1 to the axis of joint 2, along x of link 1, m."""
LATERAL_OFFSET: Final = 0.05
"""From the axis of joint 1 to the plane of forearm and wrist, along y of link 1, m."""
UPPER_ARM: Final = 0.425
"""Shoulder axis to elbow axis, m."""
FOREARM: Final = 0.425
"""Elbow axis to wrist centre, m."""
FLANGE: Final = 0.1
"""Wrist centre to flange face, m."""

JOINT_ORIGINS: Final[tuple[tuple[float, float, float], ...]] = (
    (0.0, 0.0, BASE_HEIGHT),
    (SHOULDER_OFFSET, 0.0, 0.0),
    (0.0, LATERAL_OFFSET, UPPER_ARM),
    (0.0, 0.0, 0.0),
    (0.0, 0.0, FOREARM),
    (0.0, 0.0, FLANGE),
)
"""Origin of joint i in the frame of link i - 1, m; the axes are parallel where all joints are 0."""
JOINT_AXES: Final = "zyyzyz"

_DEGREE = pi / 180.0
LOWER: Final[FloatArray] = np.array([-180.0, -130.0, -145.0, -270.0, -115.0, -270.0]) * _DEGREE
UPPER: Final[FloatArray] = np.array([180.0, 147.5, 145.0, 270.0, 140.0, 270.0]) * _DEGREE
VELOCITY: Final[FloatArray] = np.array([400.0, 400.0, 430.0, 540.0, 475.0, 760.0]) * _DEGREE
"""Largest joint speeds, rad/s."""
EFFORT: Final[FloatArray] = np.array([318.0, 166.0, 76.0, 34.0, 29.0, 11.0])
"""Largest joint torques, N m (floor mounting)."""

LINK_NAMES: Final = ("base_link", "link_1", "link_2", "link_3", "link_4", "link_5", "link_6")
LINK_MASSES: Final = (10.733459, 16.934564, 12.98711, 7.50151, 4.54015, 0.56876, 0.03098)
"""kg, in the sequence of ``LINK_NAMES``."""
for _array in (LOWER, UPPER, VELOCITY, EFFORT):
    _array.setflags(write=False)
