"""A picture of a plan, drawn in software: no graphics card, no display, the same bytes every time."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from packenv.io.colours import item_colour
from packenv.io.files import write_whole
from packenv.io.scene import Scene
from packenv.types import Container, Float32Array, FloatArray, IntArray

Image: TypeAlias = NDArray[np.uint8]

_FIELD_OF_VIEW = math.radians(30.0)  # of the picture's longer side
_MARGIN = 0.04  # of the picture's shorter side left free on every side
_SAMPLES = 3
_CREASE = math.cos(math.radians(38.0))
_SKY_DIRECTIONS = 40
_SKY_MAP = 256
_SUN_MAP = 1024
_SUN = (0.25, -0.75, 1.15)
_SKYLIGHT, _SUNLIGHT = 0.68, 0.66
_CREASE_LIGHT, _SILHOUETTE_LIGHT = 0.72, 0.34
# The box shows only a share of its shade: its walls are there to be glanced past.
_WALL_SHADE, _FLOOR_SHADE = 0.4, 0.75
_BOX_COLOUR = (226, 230, 236)
_LINE_COLOUR = (74, 86, 102)
_FRONT_EDGE_OPACITY = 0.55
_BACKGROUND = (255, 255, 255)

_CORNER_BITS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
# The box's faces seen from inside, as corners of the unit cube, with the normal that points inwards.
_WALLS = (
    ((0, 1, 3, 2), (0.0, 0.0, 1.0)),
    ((0, 2, 6, 4), (1.0, 0.0, 0.0)),
    ((1, 5, 7, 3), (-1.0, 0.0, 0.0)),
    ((0, 4, 5, 1), (0.0, 1.0, 0.0)),
    ((2, 3, 7, 6), (0.0, -1.0, 0.0)),
)
_EDGES = ((0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7))


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera.

    Attributes:
        eye: (3,) m.
        axes: (3, 3) rows: unit vectors to the right, upwards, and from the scene back to the eye.
        focal: distance of the picture plane, px.
        size: (width, height) of the picture, px.
    """

    eye: FloatArray
    axes: FloatArray
    focal: float
    size: tuple[int, int]

    def project(self, points: FloatArray) -> FloatArray:
        """Where points appear.

        Args:
            points: (n, 3) in the container frame, m.

        Returns:
            (n, 3) column and row in px, rows downwards, and nearness = 1 / depth in 1/m; a point behind the
            eye has a nearness of 0 or less and no meaningful column and row.
        """
        local = (points - self.eye) @ self.axes.T
        depth = -local[:, 2]
        nearness = 1.0 / np.where(np.abs(depth) < 1e-12, -1e-12, depth)
        column = self.size[0] / 2 + self.focal * local[:, 0] * nearness
        row = self.size[1] / 2 - self.focal * local[:, 1] * nearness
        return np.column_stack([column, row, nearness])


def fit_camera(
    container: Container, size: tuple[int, int] = (1280, 960), azimuth: float = -58.0, elevation: float = 32.0
) -> Camera:
    """The nearest camera that sees the whole container from a side.

    Args:
        container: the box.
        size: (width, height) of the picture, px.
        azimuth: from the container's middle to the eye, degrees from +x towards +y.
        elevation: degrees above the horizon, between -90 and 90.

    Returns:
        The camera; the container fills the picture but for a small margin.

    Raises:
        ValueError: the size or the elevation is out of range.
    """
    width, height = size
    if width < 16 or height < 16:
        raise ValueError(f"size {width} x {height}: give at least 16 x 16 pixels")
    if not -90.0 <= elevation <= 90.0:
        raise ValueError(f"elevation {elevation:g}: give degrees between -90 and 90")
    turn, rise = math.radians(azimuth), math.radians(elevation)
    back = np.array([math.cos(turn) * math.cos(rise), math.sin(turn) * math.cos(rise), math.sin(rise)])
    right = np.array([-math.sin(turn), math.cos(turn), 0.0])
    axes = np.stack([right, np.cross(back, right), back])
    focal = max(size) / 2 / math.tan(_FIELD_OF_VIEW / 2)
    free = 1.0 - 2 * _MARGIN * min(size) / np.array(size)
    slopes = np.array(size) / 2 * free / focal
    corners = _CORNER_BITS * np.array(container.size) @ axes.T
    # |across - shift| <= slope * (distance - near) for all corners: the two extremes give both unknowns.
    high = np.max(corners[:, :2] + slopes * corners[:, 2:], axis=0)
    low = np.max(-corners[:, :2] + slopes * corners[:, 2:], axis=0)
    distance = float(np.max((high + low) / (2 * slopes)))
    shift = (high - low) / 2
    eye = np.array([shift[0], shift[1], distance]) @ axes
    return Camera(eye=eye, axes=axes, focal=focal, size=(width, height))


def render_image(
    scene: Scene,
    *,
    size: tuple[int, int] = (1280, 960),
    step: int | None = None,
    azimuth: float = -58.0,
    elevation: float = 32.0,
) -> Image:
    """Draw a scene.

    Args:
        scene: what to show.
        size: (width, height), px.
        step: number of placed items to show; all by default.
        azimuth: as in :func:`fit_camera`.
        elevation: as in :func:`fit_camera`.

    Returns:
        (height, width, 3) sRGB.

    Raises:
        ValueError: ``step``, ``size`` or ``elevation`` is out of range.
    """
    from packenv.io import raster_render as kernels

    shown = len(scene.steps) if step is None else step
    if not 0 <= shown <= len(scene.steps):
        raise ValueError(f"step {shown}: the scene has steps 0 to {len(scene.steps)}")
    camera = fit_camera(scene.container, size, azimuth, elevation)
    columns, rows = size[0] * _SAMPLES, size[1] * _SAMPLES
    nearness = np.zeros((rows, columns), dtype=np.float32)
    owners = np.full((rows, columns), kernels.NOTHING, dtype=np.int16)
    facing = np.zeros((rows, columns, 3), dtype=np.int16)

    def draw(vertices: FloatArray, faces: IntArray, normals: Float32Array, owner: int) -> None:
        points = camera.project(vertices)
        points[:, :2] *= _SAMPLES
        kernels.draw_faces(points, faces, normals, owner, nearness, owners, facing)

    steps = scene.steps[:shown]
    meshes = [
        (np.ascontiguousarray(s.vertices), np.ascontiguousarray(s.item.faces, dtype=np.int64)) for s in steps
    ]
    for owner, (vertices, faces) in enumerate(meshes):
        draw(vertices, faces, kernels.corner_normals(vertices, faces, _CREASE), owner)
    corners = _CORNER_BITS * np.array(scene.container.size)
    for wall, normal in _WALLS:
        # The front stays open: draw_faces skips what is turned away from the eye.
        triangles = np.array([[wall[0], wall[1], wall[2]], [wall[0], wall[2], wall[3]]], dtype=np.int64)
        draw(corners, triangles, np.tile(np.array(normal, dtype=np.float32), (2, 3, 1)), len(meshes))

    gap = 0.02 * max(scene.container.size)
    marks = kernels.mark_edges(nearness, owners, facing, gap, math.cos(math.radians(32.0)), _SAMPLES // 2)
    # The box has lines of its own, drawn below.
    marks[owners == len(meshes)] = 0
    skies, sky_axes = _light_maps(meshes, corners, _sky_directions(), _SKY_MAP)
    sun, sun_axes = _light_maps(meshes, corners, np.array([_SUN]), _SUN_MAP)
    reach = float(np.linalg.norm(scene.container.size))
    ray_axes = np.stack(
        [
            camera.axes[0] / (camera.focal * _SAMPLES),
            -camera.axes[1] / (camera.focal * _SAMPLES),
            -camera.axes[2]
            - camera.axes[0] * size[0] / 2 / camera.focal
            + camera.axes[1] * size[1] / 2 / camera.focal,
        ]
    )
    colours = _linear([*(item_colour(i) for i in range(len(meshes))), _BOX_COLOUR])
    picture = kernels.shade(
        nearness,
        owners,
        facing,
        marks,
        _SAMPLES,
        colours,
        _linear([_BACKGROUND])[0],
        camera.eye,
        ray_axes,
        skies,
        sky_axes,
        2.5 * reach / _SKY_MAP,
        sun[0],
        sun_axes[0],
        3.0 * reach / _SUN_MAP,
        np.array([_SKYLIGHT, _SUNLIGHT, _CREASE_LIGHT, _SILHOUETTE_LIGHT, _WALL_SHADE, _FLOOR_SHADE]),
    )
    ends = camera.project(corners)
    width = max(1.0, min(size) / 640)
    line = _linear([_LINE_COLOUR])[0]
    filled = [
        wall for wall, normal in _WALLS if _seen_from_inside(camera, corners[list(wall)], np.array(normal))
    ]
    for first, second in _EDGES:
        behind = any(first in wall and second in wall for wall in filled)
        opacity = 1.0 if behind else _FRONT_EDGE_OPACITY
        kernels.draw_line(picture, nearness, _SAMPLES, ends[first], ends[second], width, line, opacity, 2e-3)
    return _encode_srgb(picture)


def render_plan_png(
    path: Path,
    scene: Scene,
    *,
    size: tuple[int, int] = (1280, 960),
    step: int | None = None,
    azimuth: float = -58.0,
    elevation: float = 32.0,
) -> None:
    """Write a picture of a scene as PNG.

    Args:
        path: the file to write; an older one is replaced only when the new one is complete.
        scene: as in :func:`render_image`, like all further arguments.
        size: (width, height), px.
        step: number of placed items to show; all by default.
        azimuth: degrees.
        elevation: degrees.

    Raises:
        ValueError: an argument is out of range.
        InputError: the file cannot be written.
    """
    from PIL import Image as PillowImage

    image = render_image(scene, size=size, step=step, azimuth=azimuth, elevation=elevation)
    buffer = io.BytesIO()
    PillowImage.fromarray(image).save(buffer, format="PNG")
    write_whole(Path(path), buffer.getvalue())


def _seen_from_inside(camera: Camera, wall: FloatArray, normal: FloatArray) -> bool:
    """Whether the eye is on the inner side of a wall, given its corners and its inward normal."""
    return float((camera.eye - wall[0]) @ normal) > 0.0


def _light_maps(
    meshes: list[tuple[FloatArray, IntArray]], corners: FloatArray, directions: FloatArray, size: int
) -> tuple[Float32Array, FloatArray]:
    """Light maps of distant lights that together cover the box and all items.

    Args:
        meshes: (vertices, faces) of the items, m.
        corners: (8, 3) of the box, m.
        directions: (d, 3) to the lights.
        size: side of each map, px.

    Returns:
        (d, size, size) maps and (d, 3, 4) transforms from points to column, row and height, all in px.
    """
    from packenv.io.raster_render import draw_light_map

    everything = np.concatenate([corners, *(vertices for vertices, _ in meshes)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale = (size - 2) / float(np.linalg.norm(high - low))
    middle = (low + high) / 2
    maps = np.full((len(directions), size, size), -np.inf, dtype=np.float32)
    transforms = np.empty((len(directions), 3, 4))
    for index, direction in enumerate(directions):
        toward = direction / np.linalg.norm(direction)
        across = np.cross([0.0, 1.0, 0.0] if abs(toward[1]) < 0.9 else [1.0, 0.0, 0.0], toward)
        across /= np.linalg.norm(across)
        axes = np.stack([across, np.cross(toward, across), toward]) * scale
        offset = np.array([size / 2, size / 2, 0.0]) - axes @ middle
        transforms[index] = np.column_stack([axes, offset])
        for vertices, faces in meshes:
            draw_light_map(vertices @ axes.T + offset, faces, maps[index])
    return maps, transforms


def _sky_directions() -> FloatArray:
    """(d, 3) unit vectors evenly over the upper half sphere."""
    index = np.arange(_SKY_DIRECTIONS)
    z = 0.08 + 0.92 * (index + 0.5) / _SKY_DIRECTIONS
    turn = index * math.pi * (3.0 - math.sqrt(5.0))
    flat = np.sqrt(1.0 - z * z)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


def _linear(colours: list[tuple[int, int, int]]) -> FloatArray:
    """(k, 3) sRGB, 0 to 255, as linear light, 0 to 1."""
    share = np.array(colours, dtype=np.float64) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _encode_srgb(light: Float32Array) -> Image:
    """Linear light as sRGB, 0 to 255."""
    levels = np.arange(4096) / 4095
    table = np.where(levels <= 0.0031308, 12.92 * levels, 1.055 * levels ** (1 / 2.4) - 0.055)
    table = np.rint(table * 255).astype(np.uint8)
    image: Image = table[np.rint(np.clip(light, 0.0, 1.0) * 4095).astype(np.int64)]
    return image
