"""The space that an arm takes: a few cylinders and capsules a link, simpler than the real castings.

The same primitives make the URDF, so what is checked here is what a simulator sees. Each primitive is a segment
with a radius. A *capsule* has round ends; a *cylinder* has flat ones, and the capsule on the same segment
encloses it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import numpy as np

from packenv.robot import shape_kernels
from packenv.robot.gripper import Gripper
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

    @property
    def reach(self) -> float:
        """No point of it is farther than this from its link's z axis, m."""
        (x, y), (u, v) = self.start[:2], self.end[:2]
        level = hypot(u - x, v - y)
        if self.capsule or level == 0.0 or self.start[2] != self.end[2]:
            return max(hypot(x, y), hypot(u, v)) + self.radius
        # A lying cylinder is a rectangle seen from above.
        across = self.radius * abs(v - y) / level, self.radius * abs(u - x) / level
        return max(hypot(abs(a) + across[0], abs(b) + across[1]) for a, b in ((x, y), (u, v)))


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


class LinkShapes:
    """The primitives of an arm and its gripper, ready for placing.

    Attributes:
        primitives: all of them; the last is the gripper.
        column_radius: no point of the base or of link 1 ever is farther than this from joint 1's axis, m.
    """

    def __init__(self, arm: tuple[Primitive, ...], gripper: Gripper) -> None:
        """Put the gripper behind the arm's primitives."""
        tube = Primitive(6, (0.0, 0.0, 0.0), (0.0, 0.0, gripper.length), gripper.radius)
        self.primitives = (*arm, tube)
        self.column_radius = max(p.reach for p in arm if p.link <= 1)
        self._links = np.array([p.link for p in self.primitives], dtype=np.int64)
        self._ends = np.array([(p.start, p.end) for p in self.primitives])
        self._radii = np.array([p.radius for p in self.primitives])
        self._round = np.array([p.capsule for p in self.primitives])
        self._pairs = _meeting_pairs([p.link for p in arm])

    @property
    def gripper(self) -> int:
        """Index of the gripper in ``primitives``."""
        return len(self.primitives) - 1

    def capsules(self, frames: FloatArray) -> Capsules:
        """Capsules that enclose every primitive of the arm and the gripper.

        The last is the gripper's: its round end reaches its radius beyond the cup's lip, so where the cup
        touches an item test the flat cylinder instead.

        Args:
            frames: (..., 7, 4, 4) link frames.

        Returns:
            the capsules, one a primitive.
        """
        return Capsules(self._placed(frames), self._radii.copy(), self._links.copy())

    def lowest_points(self, frames: FloatArray) -> FloatArray:
        """Height of the lowest point of every primitive, flat ends taken exactly.

        Args:
            frames: (..., 7, 4, 4) link frames.

        Returns:
            (..., n) m above the base frame's z = 0, one a primitive.
        """
        ends = self._placed(frames)
        low: FloatArray = ends[..., 2].min(axis=-1)
        axis = ends[..., 1, :] - ends[..., 0, :]
        level = np.hypot(axis[..., 0], axis[..., 1]) / np.linalg.norm(axis, axis=-1)
        lowest: FloatArray = low - self._radii * np.where(self._round, 1.0, level)
        return lowest

    def arm_lowest(self, frames: FloatArray) -> FloatArray:
        """(...) height of the lowest point of links 2 to 6, the gripper left out, m; ``frames`` as above."""
        low = np.empty(frames.size // 112)
        shape_kernels.arm_lowest(
            frames.reshape(-1, 7, 4, 4), self._links, self._ends, self._radii, self._round, self.gripper, low
        )
        return low.reshape(frames.shape[:-3])

    def self_collision(self, frames: FloatArray) -> BoolArray:
        """(...) whether two capsules of links two or more joints apart overlap; ``frames`` as above."""
        ends = self._placed(frames).reshape(-1, len(self.primitives), 2, 3)
        hit = np.empty(len(ends), dtype=np.bool_)
        shape_kernels.any_overlap(ends, self._radii, self._pairs, hit)
        return hit.reshape(frames.shape[:-3])

    def _placed(self, frames: FloatArray) -> FloatArray:
        ends = np.empty((frames.size // 112, len(self.primitives), 2, 3))
        shape_kernels.place(frames.reshape(-1, 7, 4, 4), self._links, self._ends, ends)
        return ends.reshape(*frames.shape[:-3], len(self.primitives), 2, 3)


def _meeting_pairs(links: list[int]) -> IntArray:
    """Primitives that could meet: of links at least two joints apart, the gripper counted as link 7.

    The wrist's links 4, 5 and 6 are short, and the limits of joint 5 keep them apart; the gripper is long and
    does come back to the forearm.
    """
    order = [*links, 7]
    last = len(links)
    pairs = [
        (a, b)
        for a in range(len(order))
        for b in range(a + 1, len(order))
        if order[b] - order[a] >= 2 and order[a] < (5 if b == last else 4)
    ]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
