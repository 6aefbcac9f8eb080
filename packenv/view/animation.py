"""An execution as an animated GIF: robot, open box, items, and where the plan wants the one that moves."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from packenv.io.files import write_whole
from packenv.items.plan_items import cell_of
from packenv.robot.cell import Cell
from packenv.types import Container, Float32Array, FloatArray, Frame, IntArray, Item, Plan, Pose
from packenv.view.colours import item_colour
from packenv.view.painter import CREASE, Camera, Image, Quality, Surface, camera_around, paint, silhouette
from packenv.view.robot_meshes import robot_meshes

if TYPE_CHECKING:
    from PIL.Image import Image as PillowPicture


Progress: TypeAlias = Callable[[Sequence["Frame"]], Iterable["Frame"]]

SIZE = (480, 360)
"""Width and height of the animation, px."""

_FRAME_MS = 80  # GIF counts in hundredths of a second: 12.5 frames a second
_LAST_MS = 2500
_WAY_FRAMES = 5
"""Moments of an item's way down in the animation of a plan."""
_AZIMUTH, _ELEVATION = -38.0, 24.0
_QUALITY = Quality(samples=2, skies=16, sky_map=128, sun_map=512)
_ROBOT_COLOURS = {"arm": (238, 186, 70), "wrist": (176, 180, 188), "gripper": (62, 66, 74)}
_TABLE_COLOUR = (236, 238, 242)
_GHOST = np.array([200.0, 30.0, 90.0])
_TEXT = (40, 48, 60)


def write_gif(
    path: Path,
    plan: Plan,
    items: Mapping[str, Item],
    frames: Sequence[Frame],
    ending: str = "",
    progress: Progress = iter,
) -> None:
    """Draw frames and write them as an animated GIF.

    Args:
        path: the file to write; an older one is replaced only when the new one is complete.
        plan: what is shown.
        items: the plan's items by name.
        frames: as recorded in an execution or made by :func:`planned_frames`, at least one.
        ending: text for the last frame.
        progress: iterates over the frames, for a progress bar.

    Raises:
        InputError: the file cannot be written.
    """
    from PIL import Image as PillowImage

    artist = Artist(plan, items)
    palette = _palette([artist.draw(frames[k]) for k in _spread(len(frames), 6)])
    pictures = []
    for number, frame in enumerate(progress(frames), start=1):
        drawn = PillowImage.fromarray(artist.draw(frame))
        _caption(drawn, _step_text(plan, frame), ending if number == len(frames) else "")
        pictures.append(drawn.quantize(palette=palette, dither=PillowImage.Dither.NONE))
    durations = [_FRAME_MS] * (len(pictures) - 1) + [_LAST_MS]
    buffer = io.BytesIO()
    pictures[0].save(
        buffer, format="GIF", save_all=True, append_images=pictures[1:], duration=durations, loop=0
    )
    write_whole(Path(path), buffer.getvalue())


def planned_frames(plan: Plan) -> tuple[Frame, ...]:
    """Moments of a plan as the robot would carry it out: each item on its way down, and in its place."""
    frames: list[Frame] = [Frame(0.0, None, ())]
    lying: list[Pose] = []
    for placement in plan.placements:
        path = placement.path
        lifts, joints = np.array([plan.container.height, 0.0]), None
        if path is not None:
            chosen = _spread(len(path.joints), _WAY_FRAMES)
            lifts, joints = (path.cup_heights - path.cup_heights[-1])[chosen], path.joints[chosen]
        for k, lift in enumerate(lifts):
            held = placement.pose.moved(np.array([0.0, 0.0, float(lift)]))
            now = None if joints is None else joints[k]
            frames.append(Frame(float(len(frames)), now, (*lying, held)))
        lying.append(placement.pose)
    return tuple(frames)


def _spread(count: int, wanted: int) -> list[int]:
    """So many of ``count`` indices, evenly, first and last among them."""
    return sorted({round(k * (count - 1) / (wanted - 1)) for k in range(wanted)})


def _palette(pictures: Sequence[Image]) -> PillowPicture:
    """The colours that do best for some pictures: one palette, so that colours do not flicker."""
    from PIL import Image as PillowImage

    return PillowImage.fromarray(np.concatenate(pictures)).quantize(256, kmeans=1)


@dataclass(frozen=True, eq=False)
class _Shape:
    """A surface in the frame of what it moves with."""

    vertices: FloatArray
    faces: IntArray
    normals: Float32Array
    colour: tuple[int, int, int]

    def at(self, rotation: FloatArray, position: FloatArray) -> Surface:
        turned: Float32Array = (self.normals.reshape(-1, 3) @ rotation.T).astype(np.float32)
        moved = np.ascontiguousarray(self.vertices @ rotation.T + position)
        return Surface(moved, self.faces, turned.reshape(self.normals.shape), self.colour)


class Artist:
    """Draws the moments of one execution."""

    def __init__(self, plan: Plan, items: Mapping[str, Item], size: tuple[int, int] = SIZE) -> None:
        """Prepare all shapes.

        Args:
            plan: what is carried out.
            items: the plan's items by name.
            size: (width, height) of the pictures, px.
        """
        self._plan = plan
        self._cell = cell_of(plan)
        self._robot = self._cell.robot
        self._items = [
            _shape(items[p.item].vertices, items[p.item].faces, item_colour(k))
            for k, p in enumerate(plan.placements)
        ]
        self._links = [
            (mesh.link, _shape(mesh.vertices, mesh.faces, _ROBOT_COLOURS[mesh.kind]))
            for mesh in robot_meshes(self._robot.shapes)
        ]
        self._table = _table(plan.container, self._cell)
        self._around = _stage(self._cell)
        self.camera: Camera = camera_around(self._around, size, _AZIMUTH, _ELEVATION)

    def draw(self, frame: Frame) -> Image:
        """One moment.

        Returns:
            (height, width, 3) sRGB: what is there, and outlined where the plan wants the latest item.
        """
        surfaces = [self._table]
        surfaces += [shape.at(*pose) for shape, pose in zip(self._items, frame.poses, strict=False)]
        if frame.joints is not None:
            links = self._cell.poses_to_container(self._robot.link_frames(frame.joints))
            for link, shape in self._links:
                rotation, position = links[link, :3, :3], links[link, :3, 3]
                surfaces.append(shape.at(rotation, position))
        picture = paint(self._plan.container, surfaces, self.camera, _QUALITY, self._around)
        if frame.poses:
            latest = len(frame.poses) - 1
            placement = self._plan.placements[latest]
            ghost = self._items[latest].at(placement.rotation, placement.position)
            self._outline(picture, ghost)
        return picture

    def _outline(self, picture: Image, ghost: Surface) -> None:
        """Draw the edge of a silhouette over a picture."""
        inside = silhouette(ghost, self.camera)
        core = inside.copy()
        for axis in (0, 1):
            for step in (-1, 1):
                core &= np.roll(inside, step, axis)
        edge = inside & ~core
        picture[edge] = np.rint(0.25 * picture[edge] + 0.75 * _GHOST).astype(np.uint8)


def _shape(vertices: FloatArray, faces: IntArray, colour: tuple[int, int, int]) -> _Shape:
    from packenv.view.zbuffer_kernels import corner_normals

    whole = np.ascontiguousarray(faces, dtype=np.int64)
    return _Shape(vertices, whole, corner_normals(np.ascontiguousarray(vertices), whole, CREASE), colour)


def _stage(cell: Cell) -> FloatArray:
    """(16, 3) corners of what the camera looks at: the box, the gripper above it, the robot's column."""
    length, width, height = cell.container.size
    above = height + cell.robot.gripper.length + 0.04
    over_box = [(x, y, z) for x in (0.0, length) for y in (0.0, width) for z in (0.0, above)]
    middle = width / 2
    column = [(x, middle + y, z) for x in (-0.33, -0.2) for y in (-0.05, 0.1) for z in (0.05, 0.5)]
    return np.array(over_box + column)


def _table(container: Container, cell: Cell) -> Surface:
    """The table that robot and container stand on, a little lower than the container's floor."""
    base = cell.to_container(np.zeros(3))
    reach = 0.75 * math.hypot(*container.size[:2]) + 0.35
    middle = np.array([(base[0] + container.length) / 2, container.width / 2, 0.0])
    turns = 2 * math.pi * np.arange(48) / 48
    rim = middle + np.column_stack([reach * np.cos(turns), reach * np.sin(turns), np.full(48, -0.004)])
    vertices = np.concatenate([rim, [middle - [0.0, 0.0, 0.004]]])
    here = np.arange(48)
    faces = np.column_stack([np.full(48, 48), here, (here + 1) % 48]).astype(np.int64)
    up = np.tile(np.array([0.0, 0.0, 1.0], dtype=np.float32), (48, 3, 1))
    return Surface(vertices, faces, up, _TABLE_COLOUR, shadow=False)


def _step_text(plan: Plan, frame: Frame) -> str:
    step, count = len(frame.poses), len(plan.placements)
    return f"{step} / {count}   {plan.placements[step - 1].item}" if step else f"0 / {count}"


def _caption(picture: PillowPicture, text: str, ending: str) -> None:
    from PIL import ImageDraw, ImageFont

    pen = ImageDraw.Draw(picture)
    font = ImageFont.load_default(14)
    pen.text((10, 8), text, fill=_TEXT, font=font)
    if ending:
        pen.text((10, picture.height - 26), ending, fill=_TEXT, font=font)
