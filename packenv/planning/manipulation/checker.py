"""Manipulation feasibility of a candidate (paper Sec. III-D, Alg. 1: ``isManipFeasible``).

The cup holds the item by a grasp, in the orientation in which it will lie. The path leads straight down from
where the item's lowest point is 1 cm above the rim to the *release*, 1 cm above the placement
(Sec. V), where the cup lets go. Joints are also found for the placement itself.

What is asked, cheapest first, and why the answer holds along the whole path:

1. *Held item*: its footprint is inside the container and it lies nowhere below max(H_c - H_b). Both
   maps are conservative, so at that height it meets no placed item, and higher up even less: a vertical move
   changes neither footprint nor maps. Above the rim there is nothing at all.
2. *Gripper*: a tube of the cup's radius. Below the rim it must be off the walls, and no container cell that
   it touches, seen from above, may be higher than the lip at the release. All that is under the disc is
   then below the lip, there and at every waypoint above. The held item itself is below the lip by the
   grasp's definition (:class:`packenv.planning.manipulation.grasps.Grasp`).
3. *Arm*: one inverse-kinematics branch follows all waypoints within the joint limits
   (:meth:`packenv.robot.protocol.Robot.continuous_branches`).
4. *Links*: on that branch links 2 to 6 stay above the rim, so they meet neither walls nor placed items, the
   arm keeps off itself (:meth:`packenv.robot.cell.Cell.arm_clear`), and no link meets the held item's
   bounding box.

Only 3 and 4 are sampled, at the waypoints. 4 is sufficient, not necessary: a link beside the container but
below its rim is refused, and so is a link inside the held item's box but off its surface. No mesh is asked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias, get_args

import numpy as np

from packenv.config import CLEARANCE
from packenv.planning.manipulation import cup_kernels
from packenv.planning.manipulation.grasps import Grasp
from packenv.planning.search.container_map import ContainerMap
from packenv.robot.cell import WAYPOINT_STEP, Cell
from packenv.robot.gripper import top_down
from packenv.types import FloatArray, OrientedItem

Reason: TypeAlias = Literal[
    "no-grasp",
    "held-item-blocked",
    "gripper-hits-wall",
    "gripper-hits-item",
    "unreachable",
    "joint-limits",
    "link-collision",
]

REASONS: Final[tuple[Reason, ...]] = get_args(Reason)
"""Why a candidate is not feasible, in the sequence of the tests."""

TOLERANCE: Final = cup_kernels.TOUCH_TOLERANCE
"""Less than this is rounding of a pose, m."""

_BALLS = 12
"""Balls that cover one link's capsule in the test against the held item."""


@dataclass(frozen=True, eq=False)
class ManipulationResult:
    """Whether and how the robot can bring an item to a candidate.

    Attributes:
        reason: None where it can, else how far the grasp that came farthest came: one of ``REASONS``.
        grasp: the one that is used; None where it cannot.
        joints: (m, 6) rad, one continuous branch over the waypoints; None where it cannot.
        lip_heights: (m,) height of the cup's lip at each waypoint, container frame, m, from the top down. The
            last but one is the release, the last the placement; None where it cannot.
        grasps_tried: number of grasps that were looked at.
    """

    reason: Reason | None
    grasp: Grasp | None
    joints: FloatArray | None
    lip_heights: FloatArray | None
    grasps_tried: int

    @property
    def feasible(self) -> bool:
        """True where the robot can."""
        return self.reason is None


class ManipulationChecker:
    """Checks candidates for one robot cell."""

    def __init__(self, cell: Cell, *, spacing: float = WAYPOINT_STEP) -> None:
        """Keep the settings.

        Args:
            cell: the robot, and where the container stands.
            spacing: largest distance of two waypoints, m, above 0.

        Raises:
            ValueError: ``spacing`` is not positive.
        """
        if not spacing > 0.0:
            raise ValueError(f"spacing is {spacing:g}, give spacing > 0")
        self.cell = cell
        self.release = cell.setup.release_height
        self.spacing = spacing
        self._in_column = cell.in_column
        # The flange where the lip is at the base frame's origin: every waypoint is this, moved.
        self._flange = cell.robot.gripper.tool_to_flange(top_down(np.zeros(3)))

    def check(
        self, oriented: OrientedItem, corner: FloatArray, surface: ContainerMap, grasps: Sequence[Grasp]
    ) -> ManipulationResult:
        """Find the first grasp with which the robot can bring the item to its place (Alg. 1).

        Args:
            oriented: the item at its orientation.
            corner: (3,) smallest x, y, z of the placed item in the container frame, m.
            surface: the container heightmap before the item is placed.
            grasps: in the sequence in which they are tried.

        Returns:
            the answer; where it is no, the reason.

        Raises:
            ValueError: the corner is not finite, the surface is not of the cell's container, or the cell
                sizes differ.
        """
        corner = np.asarray(corner, dtype=np.float64)
        self._check(oriented, corner, surface)
        if not grasps:
            return ManipulationResult("no-grasp", None, None, None, 0)
        if self._blocked(oriented, corner, surface):
            return ManipulationResult("held-item-blocked", None, None, None, 0)
        if self._in_column:
            return ManipulationResult("link-collision", None, None, None, 0)
        farthest: Reason = "gripper-hits-wall"
        for tried, grasp in enumerate(grasps, start=1):
            reason = self._gripper_blocked(corner + grasp.point, surface)
            if reason is None:
                lips = self._lip_heights(float(corner[2]), float(grasp.point[2]))
                found = self._joints(oriented, corner, grasp, lips)
                if not isinstance(found, str):
                    return ManipulationResult(None, grasp, found, lips, tried)
                reason = found
            farthest = max(farthest, reason, key=REASONS.index)
        return ManipulationResult(farthest, None, None, None, len(grasps))

    def _check(self, oriented: OrientedItem, corner: FloatArray, surface: ContainerMap) -> None:
        size = surface.cell_size
        if oriented.cell_size != size:
            raise ValueError(f"the item's cells are {oriented.cell_size:g} m, the container's {size:g} m")
        if surface.container.size != self.cell.container.size:
            raise ValueError(
                f"the surface is of {surface.container.label}, the robot cell of {self.cell.container.label}"
            )
        if not math.isfinite(float(corner.sum())):
            raise ValueError(f"corner is {corner.tolist()}, give finite metres")

    @staticmethod
    def _blocked(oriented: OrientedItem, corner: FloatArray, surface: ContainerMap) -> bool:
        """Whether the held item meets walls, floor, rim or placed items at its place or above it."""
        x, y, z = corner.tolist()
        beyond = corner + oriented.extents - surface.container.size
        if min(x, y) < -TOLERANCE or (beyond > CLEARANCE + TOLERANCE).any():
            return True
        placed, ix, iy = surface.locate(oriented.whole or oriented, x, y)
        lowest = surface.bound(placed, ix, iy)
        if z < lowest - TOLERANCE:
            lowest = surface.lowest(placed, ix, iy, lowest)
        return bool(z < lowest - TOLERANCE)

    def _gripper_blocked(self, point: FloatArray, surface: ContainerMap) -> Reason | None:
        """What the tube meets between the release and the top; ``point`` is the lip's at the placement."""
        x, y, lip = float(point[0]), float(point[1]), float(point[2]) + self.release
        box, radius = surface.container, self.cell.robot.gripper.radius
        edge = radius - TOLERANCE
        beside = x < edge or y < edge or x > box.length - edge or y > box.width - edge
        if beside and lip < box.height:
            return "gripper-hits-wall"
        highest = cup_kernels.highest_under(surface.heights, x, y, radius, surface.cell_size)
        return "gripper-hits-item" if highest > lip + TOLERANCE else None

    def _lip_heights(self, z: float, lip: float) -> FloatArray:
        """Waypoints from above the rim to the release, and the placement."""
        top = self.cell.container.height + self.cell.setup.rim_clearance
        bottom = z + self.release
        steps = max(1, math.ceil((top - bottom) / self.spacing - 1e-9))
        heights = np.empty(steps + 2)
        heights[:-1] = np.arange(steps, -1, -1)
        heights[:-1] *= max(top - bottom, 0.0) / steps
        heights[:-1] += bottom
        heights[-1] = z
        heights += lip
        return heights

    def _joints(
        self, oriented: OrientedItem, corner: FloatArray, grasp: Grasp, lips: FloatArray
    ) -> FloatArray | Reason:
        """(m, 6) joints of the branch that is farthest from the limits, or why there is none."""
        cell, robot = self.cell, self.cell.robot
        at = corner + grasp.point
        path = np.empty((len(lips), 4, 4))
        path[:] = self._flange
        path[:, :3, 3] += cell.to_base(at)
        path[:, 2, 3] += lips - at[2]
        branches = robot.continuous_branches(path)
        if not len(branches):
            return "joint-limits" if branches.beyond_limits else "unreachable"
        tips = path[:, :3, 3] - self._flange[:3, 3]
        for k in np.argsort(-robot.limit_margin(branches.q).min(axis=1), kind="stable"):
            joints: FloatArray = branches.q[k]
            if self._links_clear(oriented, grasp.point, tips, joints):
                return joints
        return "link-collision"

    def way_clear(
        self,
        oriented: OrientedItem,
        corner: FloatArray,
        surface: ContainerMap,
        lip: FloatArray,
        joints: FloatArray,
    ) -> bool:
        """Whether gripper and links are clear along stated joints, the cup upright and never turning.

        Args:
            oriented: the held item at its orientation.
            corner: (3,) smallest x, y, z of the placed item in the container frame, m.
            surface: the container heightmap before the item is placed.
            lip: (3,) middle of the cup's lip at the placement, container frame, m.
            joints: (m, 6) rad, from above the rim down to the placement.
        """
        tips = self.cell.robot.tool(joints)[:, :3, 3]
        blocked = self._gripper_blocked(lip, surface)
        return blocked is None and self._links_clear(oriented, lip - corner, tips, joints)

    def _links_clear(
        self, oriented: OrientedItem, point: FloatArray, tips: FloatArray, joints: FloatArray
    ) -> bool:
        """Whether the arm keeps off the rim, itself and the held item's box at every waypoint.

        ``point`` is the lip's middle seen from the item's corner, ``tips`` (m, 3) the same in the base frame.
        """
        cell, shapes, q = self.cell, self.cell.robot.shapes, joints[None]
        if not cell.arm_clear(q)[0]:
            return False
        # The held item's box, along the container's axes.
        low = (tips @ cell.turn if cell.yaw else tips) - point
        capsules = shapes.capsules(cell.robot.link_frames(q))
        ends = capsules.ends @ cell.turn if cell.yaw else capsules.ends
        hit = np.empty(1, dtype=np.bool_)
        # The gripper, the last capsule, does touch the item.
        cup_kernels.meets_box(ends[:, :, :-1], capsules.radii[:-1], low, low + oriented.extents, _BALLS, hit)
        return not hit[0]
