"""Whether the robot keeps clear of everything on a way between the pick place and the container.

Asked at every point of a way: joint limits, the arm against itself, the ground, the container, the item that is
held, and the item that waits. All tests are conservative: links are capsules, items their bounding boxes.

Over the container's outside nothing may be below the rim, but for the cup and what it holds straight above their
planned place, where the planner found them clear of walls and placed items
(:mod:`packenv.planning.manipulation.checker`). The cell file names no table, fence or neighbour: none is looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from packenv.planning.manipulation import cup_kernels
from packenv.robot.cell import Cell
from packenv.robot.protocol import Robot
from packenv.types import BoolArray, FloatArray

WALL: Final = 0.05
"""Thickness of the container's walls and floor, outward, m: as thick as those in physics."""
_ROUNDING: Final = 1e-6
"""Of heights, m."""
_ON_LINE: Final = 1e-4
"""A cup so near its planned line, m and rad, is on it."""
_BALLS: Final = 24
"""Balls that cover one link's capsule in the test against a box."""


@dataclass(frozen=True, eq=False)
class Task:
    """One item's way from the pick place to its own, as far as a check must know it. All in the base frame.

    Attributes:
        low: (3,) lowest corner of the item's bounding box in *box axes*, those of the container, m.
        high: (3,) highest.
        box_at_pick: (4, 4) box axes to base frame while the item waits.
        box_at_place: (4, 4) likewise at its planned place.
        tool_at_pick: (4, 4) tool pose that takes it.
        tool_at_place: (4, 4) tool pose at its planned place.
    """

    low: FloatArray
    high: FloatArray
    box_at_pick: FloatArray
    box_at_place: FloatArray
    tool_at_pick: FloatArray
    tool_at_place: FloatArray

    @property
    def corners(self) -> FloatArray:
        """(8, 3) of the bounding box, box axes, m."""
        return np.array(list(product(*zip(self.low, self.high, strict=True))))


class MotionCheck:
    """Checks ways of the robot in one cell."""

    def __init__(self, cell: Cell) -> None:
        """Place the container.

        Args:
            cell: the robot, and where the container stands.
        """
        self.cell = cell
        self.robot: Robot = cell.robot
        self.ground = min(0.0, cell.setup.pick_place.position[2], cell.position[2])
        box = cell.container
        self._outside = (
            np.array([-WALL, -WALL, -WALL]),
            np.array([box.length + WALL, box.width + WALL, box.height]),
        )
        capsules = self.robot.shapes.capsules(self.robot.link_frames(np.zeros(6)))
        self._radii = capsules.radii
        self._first = int(np.count_nonzero(capsules.links < 2))

    def problem(
        self,
        q: FloatArray,
        *,
        held: Task | None = None,
        released: Task | None = None,
        waiting: Task | None = None,
    ) -> str | None:
        """The first thing that is wrong with a way.

        Args:
            q: (m, 6) points of the way, rad.
            held: the item that the cup holds.
            released: the item above whose planned place the empty cup may be below the rim.
            waiting: an item at the pick place. The cup may touch it straight above where it takes it.

        Returns:
            a phrase for people; None where nothing is wrong.
        """
        frames = self.robot.link_frames(q)
        tools = self.robot.gripper.flange_to_tool(frames[:, 6])
        shapes = self.robot.shapes
        lowest = shapes.arm_lowest(frames)
        capsules = shapes.capsules(frames).ends
        inside = self.cell.to_container(capsules)
        if self.robot.limit_margin(q).min() < -_ROUNDING:
            return "a joint passes its limit"
        if shapes.self_collision(frames).any():
            return "the arm meets itself"
        if min(lowest.min(), tools[:, 2, 3].min()) < self.ground - _ROUNDING:
            return "the arm meets the ground"
        # Links above the rim need no closer look, which would take them for larger than they are.
        low = lowest < self.cell.rim
        if self._meets(inside[low, self._first : -1], self._radii[self._first : -1], *self._outside):
            return "the arm meets the container"
        task = held or released
        straight_above = np.zeros(len(q), dtype=np.bool_)
        if task is not None:
            straight_above = _above(tools, task.tool_at_place)
        if np.any(self._dips(*self._tube(inside[:, -1])) & ~straight_above):
            return "the cup meets the container"
        if held is not None:
            boxes = tools @ (np.linalg.inv(held.tool_at_place) @ held.box_at_place)
            corners = held.corners @ np.swapaxes(boxes[:, :3, :3], 1, 2) + boxes[:, None, :3, 3]
            if corners[..., 2].min() < self.ground - _ROUNDING:
                return "the held item meets the ground"
            corners = self.cell.to_container(corners)
            if np.any(self._dips(corners.min(axis=1), corners.max(axis=1)) & ~straight_above):
                return "the held item meets the container"
            if self._meets(_into(boxes, capsules[:, :-1]), self._radii[:-1], held.low, held.high):
                return "the arm meets the held item"
        if waiting is not None:
            ends = _into(waiting.box_at_pick, capsules)
            if self._meets(ends[:, :-1], self._radii[:-1], waiting.low, waiting.high):
                return "the arm meets the waiting item"
            aside = ~_above(tools, waiting.tool_at_pick)
            if self._meets(ends[aside, -1:], self._radii[-1:], waiting.low, waiting.high):
                return "the cup meets the waiting item"
        return None

    def _tube(self, ends: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounding boxes of the gripper, container axes: (m, 2, 3) axis ends to (m, 3) twice, m."""
        axis = ends[:, 1] - ends[:, 0]
        sine = np.sqrt(np.maximum(0.0, 1.0 - (axis / np.linalg.norm(axis, axis=1)[:, None]) ** 2))
        radius = self.robot.gripper.radius * sine
        return ends.min(axis=1) - radius, ends.max(axis=1) + radius

    def _dips(self, low: FloatArray, high: FloatArray) -> BoolArray:
        """(m,) where boxes, container axes, reach below the rim over the container's outside."""
        start, end = self._outside
        over = np.all((low[:, :2] < end[:2]) & (high[:, :2] > start[:2]), axis=1)
        dips: BoolArray = over & (low[:, 2] < end[2] - _ROUNDING)
        return dips

    @staticmethod
    def _meets(ends: FloatArray, radii: FloatArray, low: FloatArray, high: FloatArray) -> bool:
        """Whether (m, p, 2, 3) capsules meet a box anywhere."""
        hit = np.empty(1, dtype=np.bool_)
        lows, highs = (np.repeat(corner[None], len(ends), axis=0) for corner in (low, high))
        cup_kernels.meets_box(ends[None], radii, lows, highs, _BALLS, hit)
        return bool(hit[0])


def _above(tools: FloatArray, end: FloatArray) -> BoolArray:
    """(m,) where tool poses, (m, 4, 4), are straight above another, or on it."""
    level = np.abs(tools[:, :2, 3] - end[:2, 3]).max(axis=1) < _ON_LINE
    turned = np.abs(tools[:, :3, :3] - end[:3, :3]).max(axis=(1, 2)) < _ON_LINE
    above: BoolArray = level & turned & (tools[:, 2, 3] > end[2, 3] - _ROUNDING)
    return above


def _into(boxes: FloatArray, ends: FloatArray) -> FloatArray:
    """(m, p, 2, 3) points of the base frame in box axes; ``boxes`` is (4, 4) or (m, 4, 4)."""
    rotation = boxes[..., :3, :3] if boxes.ndim == 2 else boxes[:, None, :3, :3]
    position = boxes[..., :3, 3] if boxes.ndim == 2 else boxes[:, None, None, :3, 3]
    moved: FloatArray = (ends - position) @ rotation
    return moved
