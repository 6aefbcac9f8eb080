"""The cell as pictures show it: robot, table and container, seen from one place that suits the cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np
import trimesh

from packenv.robot.cell import Cell
from packenv.robot.shapes import Primitive
from packenv.types import FloatArray, Item, Pose
from packenv.view.camera import camera_around
from packenv.view.colours import item_colour
from packenv.view.painter import QUICK, Image, paint
from packenv.view.surfaces import Surface, item_surface, surface_of

_AZIMUTH, _ELEVATION = -38.0, 24.0
_AROUND = 28
_ARM, _WRIST, _GRIPPER = (238, 186, 70), (176, 180, 188), (62, 66, 74)
_TABLE = (228, 231, 236)
_TABLE_SHADE = 0.5
_BELOW = 0.004
"""How far the table is below the container's floor, m."""
_PARKED = 0.06
"""How far above the rim the cup waits at home, m."""


class Stage:
    """Draws a cell: the same camera and the same fixed things in every picture."""

    def __init__(self, cell: Cell, size: tuple[int, int]) -> None:
        """Prepare what stays.

        Args:
            cell: robot and container.
            size: (width, height) of the pictures, px.

        Raises:
            ValueError: the size is out of range.
        """
        self.cell = cell
        self._around = _corners(cell)
        self._table = _table(cell)
        self.camera = camera_around(self._around, size, _AZIMUTH, _ELEVATION)

    @cached_property
    def home(self) -> FloatArray:
        """(6,) joints with the cup above the middle of the rim, rad; all 0 where the arm does not get there."""
        length, width, height = self.cell.container.size
        above = np.array([length / 2, width / 2, height + _PARKED])
        found = self.cell.clear_branches(self.cell.top_down_path(above, 0.0))
        return found.q[0, 0] if len(found.q) else np.zeros(6)

    def draw(self, placed: Sequence[tuple[Item, Pose]], joints: FloatArray | None = None) -> Image:
        """One moment.

        Args:
            placed: what is in the container, or in the hand, in packing sequence: colours go by that.
            joints: (6,) of the robot, rad; None leaves the robot out.

        Returns:
            (height, width, 3) sRGB.
        """
        surfaces = [self._table, *placed_surfaces(placed)]
        if joints is not None:
            robot = self.cell.robot
            links = self.cell.poses_to_container(robot.link_frames(joints))
            for link, surface in robot_surfaces(robot.shapes.primitives):
                surfaces.append(surface.at(Pose(links[link, :3, :3], links[link, :3, 3])))
        return paint(self.cell.container, surfaces, self.camera, QUICK, self._around)


def placed_surfaces(placed: Sequence[tuple[Item, Pose]]) -> list[Surface]:
    """Items at their poses, in the colours of their places in the sequence."""
    return [item_surface(item).at(pose, item_colour(k)) for k, (item, pose) in enumerate(placed)]


@lru_cache(maxsize=4)
def robot_surfaces(primitives: tuple[Primitive, ...]) -> tuple[tuple[int, Surface], ...]:
    """For each primitive of an arm and, the last, its gripper: its link, and its surface in that link's frame."""
    found = []
    for part in primitives:
        ends = np.array([part.start, part.end])
        mesh = trimesh.creation.cylinder(part.radius, sections=_AROUND, segment=ends)
        if part.capsule:
            along = ends[1] - ends[0]
            turn = trimesh.geometry.align_vectors([0, 0, 1], along)  # type: ignore[no-untyped-call]
            turn[:3, 3] = ends.mean(axis=0)
            count = [_AROUND // 2, _AROUND]
            mesh = trimesh.creation.capsule(float(np.linalg.norm(along)), part.radius, count, turn)
        colour = _GRIPPER if part is primitives[-1] else _WRIST if part.link >= 5 else _ARM
        found.append((part.link, surface_of(mesh, colour)))
    return tuple(found)


def _corners(cell: Cell) -> FloatArray:
    """(16, 3) corners of what the camera looks at: the box, the gripper above it, the robot's column."""
    length, width, height = cell.container.size
    above = height + cell.robot.gripper.length + 0.04
    over_box = [(x, y, z) for x in (0.0, length) for y in (0.0, width) for z in (0.0, above)]
    base = cell.to_container(np.zeros(3))
    column = base + [(x, y, z) for x in (-0.03, 0.1) for y in (-0.05, 0.1) for z in (0.05, 0.5)]
    return np.concatenate([over_box, column])


def _table(cell: Cell) -> Surface:
    """What robot and container stand on: a disc around both."""
    length, width, _ = cell.container.size
    base = cell.to_container(np.zeros(3))
    middle = np.array([(base[0] + length) / 2, width / 2, -_BELOW])
    radius = 0.75 * float(np.hypot(length, width)) + 0.35
    disc = trimesh.creation.revolve([(radius, 0.0), (0.0, 0.0)], sections=48)
    disc.apply_translation(middle)
    return replace(surface_of(disc, _TABLE), shade=_TABLE_SHADE, shadow=False)
