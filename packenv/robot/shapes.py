"""The space that the arm takes: a few cylinders and capsules a link, ours, simpler than the real castings.

Their places and radii are chosen so that each link's centre of mass and radii of gyration come near those
that the maker's CAD gives (see ``tx90_data``); the upper arm runs beside the column, about 0.2 m from the
plane of the wrist. The same primitives make the URDF, so what is checked here is what a simulator sees.

Each primitive is a segment with a radius. A *capsule* has round ends; a *cylinder* has flat ones, and the
capsule on the same segment encloses it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Final

import numpy as np

from packenv.robot import gripper, shape_kernels
from packenv.robot.tx90 import link_frames
from packenv.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Primitive:
    """A cylinder or capsule that moves with a link.

    Attributes:
        link: 0 base, 1 to 6 the links; the gripper moves with link 6.
        start: one end of the axis in the link's frame, m.
        end: the other end.
        radius: m.
        capsule: True for half spheres on both ends, False for flat ends.
    """

    link: int
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float
    capsule: bool = False


PRIMITIVES: Final = (
    Primitive(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.23), 0.15),
    Primitive(1, (0.0, 0.0, -0.248), (0.0, 0.0, 0.0), 0.14),
    Primitive(1, (0.05, -0.08, 0.0), (0.05, 0.13, 0.0), 0.13),
    Primitive(2, (0.0, 0.13, 0.0), (0.0, 0.31, 0.0), 0.105),
    Primitive(2, (0.0, 0.22, 0.0), (0.0, 0.22, 0.425), 0.095, capsule=True),
    Primitive(3, (0.0, -0.07, 0.0), (0.0, 0.08, 0.0), 0.095),
    Primitive(3, (0.0, 0.0, -0.10), (0.0, 0.0, 0.14), 0.085),
    Primitive(4, (0.0, 0.0, 0.14), (0.0, 0.0, 0.37), 0.075),
    Primitive(4, (0.0, 0.0, 0.33), (0.0, 0.0, 0.425), 0.06, capsule=True),
    Primitive(5, (0.0, 0.0, 0.0), (0.0, 0.0, 0.04), 0.045, capsule=True),
    Primitive(5, (0.0, 0.0, 0.04), (0.0, 0.0, 0.088), 0.038),
    Primitive(6, (0.0, 0.0, -0.012), (0.0, 0.0, 0.0), 0.04),
    Primitive(6, (0.0, 0.0, 0.0), (0.0, 0.0, gripper.LENGTH), gripper.RADIUS),
)
"""All primitives; the last is the gripper."""

GRIPPER: Final = len(PRIMITIVES) - 1
"""Index of the gripper in ``PRIMITIVES``."""

_LINKS: Final[IntArray] = np.array([p.link for p in PRIMITIVES], dtype=np.int64)
_ENDS: Final[FloatArray] = np.array([(p.start, p.end) for p in PRIMITIVES])
_RADII: Final[FloatArray] = np.array([p.radius for p in PRIMITIVES])
_ROUND: Final[BoolArray] = np.array([p.capsule for p in PRIMITIVES])

COLUMN_RADIUS: Final = max(
    hypot(abs(end[0]) + p.radius, abs(end[1])) if p.start[1] != p.end[1] else abs(end[0]) + p.radius
    for p in PRIMITIVES
    for end in (p.start, p.end)
    if p.link <= 1
)
"""No point of the base or of link 1 ever is farther than this from the axis of joint 1, m."""


def _meeting_pairs() -> IntArray:
    """Primitives that could meet: of links at least two joints apart, the gripper counted as link 7.

    The wrist's links 4, 5 and 6 are short, and the limits of joint 5 keep them apart; the gripper is long and
    does come back to the forearm.
    """
    order = [p.link for p in PRIMITIVES]
    order[GRIPPER] = 7
    pairs = [
        (a, b)
        for a in range(len(order))
        for b in range(a + 1, len(order))
        if order[b] - order[a] >= 2 and order[a] < (5 if b == GRIPPER else 4)
    ]
    return np.array(pairs, dtype=np.int64)


_PAIRS: Final[IntArray] = _meeting_pairs()


@dataclass(frozen=True, eq=False)
class Capsules:
    """Capsules that enclose the arm and the gripper.

    Attributes:
        ends: (..., n, 2, 3) both ends of each axis in the base frame, m.
        radii: (n,) m.
        links: (n,) which link each moves with, 0 to 6; the gripper, the last, with 6.
    """

    ends: FloatArray
    radii: FloatArray
    links: IntArray


def link_capsules(q: FloatArray) -> Capsules:
    """Capsules that enclose every primitive of the arm and the gripper.

    The last is the gripper's: its round end reaches ``gripper.RADIUS`` beyond the cup's lip, so where the cup
    touches an item test the flat cylinder instead.

    Args:
        q: (..., 6) rad.

    Returns:
        the capsules, one a primitive of ``PRIMITIVES``.
    """
    return Capsules(_ends(q), _RADII.copy(), _LINKS.copy())


def lowest_points(q: FloatArray) -> FloatArray:
    """Height of the lowest point of every primitive, flat ends taken exactly.

    Args:
        q: (..., 6) rad.

    Returns:
        (..., n) m above the base frame's z = 0, one a primitive of ``PRIMITIVES``.
    """
    ends = _ends(q)
    low: FloatArray = ends[..., 2].min(axis=-1)
    axis = ends[..., 1, :] - ends[..., 0, :]
    level = np.hypot(axis[..., 0], axis[..., 1]) / np.linalg.norm(axis, axis=-1)
    lowest: FloatArray = low - _RADII * np.where(_ROUND, 1.0, level)
    return lowest


def arm_lowest(q: FloatArray) -> FloatArray:
    """Height of the lowest point of links 2 to 6: the part of the arm that may be over the container.

    The base and link 1 never leave the cylinder of radius ``COLUMN_RADIUS``; the gripper is meant to enter
    the container. Neither counts.

    Args:
        q: (..., 6) rad.

    Returns:
        (...) m above the base frame's z = 0.
    """
    q = np.ascontiguousarray(q, dtype=np.float64)
    frames = link_frames(q.reshape(-1, 6))
    low = np.empty(len(frames))
    shape_kernels.arm_lowest(frames, _LINKS, _ENDS, _RADII, _ROUND, GRIPPER, low)
    return low.reshape(q.shape[:-1])


def self_collision(q: FloatArray) -> BoolArray:
    """Whether the arm or the gripper meets itself, judged by the enclosing capsules.

    Args:
        q: (..., 6) rad.

    Returns:
        (...) True where two capsules of links two or more joints apart overlap.
    """
    q = np.ascontiguousarray(q, dtype=np.float64)
    ends = _ends(q).reshape(-1, len(PRIMITIVES), 2, 3)
    hit = np.empty(len(ends), dtype=np.bool_)
    shape_kernels.any_overlap(ends, _RADII, _PAIRS, hit)
    return hit.reshape(q.shape[:-1])


def _ends(q: FloatArray) -> FloatArray:
    q = np.ascontiguousarray(q, dtype=np.float64)
    frames = link_frames(q.reshape(-1, 6))
    ends = np.empty((len(frames), len(PRIMITIVES), 2, 3))
    shape_kernels.place(frames, _LINKS, _ENDS, ends)
    return ends.reshape(*q.shape[:-1], len(PRIMITIVES), 2, 3)
