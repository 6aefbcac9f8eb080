"""Draws surfaces and the open box in software, with soft light, shadows and lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from packenv.types import Container, Float32Array, FloatArray, IntArray

Image: TypeAlias = NDArray[np.uint8]

_FIELD_OF_VIEW = math.radians(30.0)  # of the picture's longer side
_MARGIN = 0.04  # of the picture's shorter side left free on every side
CREASE = math.cos(math.radians(38.0))
"""Cosine of the angle between faces from which on an edge is hard."""
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
class Surface:
    """Something to draw.

    Attributes:
        vertices: (n, 3) container frame, m.
        faces: (m, 3) int64, counter-clockwise seen from outside.
        normals: (m, 3, 3) float32 at the corners, as from ``zbuffer_kernels.corner_normals``.
        colour: (red, green, blue), sRGB, 0 to 255.
        shadow: whether it throws one.
    """

    vertices: FloatArray
    faces: IntArray
    normals: Float32Array
    colour: tuple[int, int, int]
    shadow: bool = True


@dataclass(frozen=True)
class Quality:
    """How fine a picture is drawn.

    Attributes:
        samples: sub-pixels along each side of a pixel.
        skies: directions that skylight comes from.
        sky_map: side of the light map of each, px.
        sun_map: side of the light map of the sun, px.
    """

    samples: int = 3
    skies: int = 40
    sky_map: int = 256
    sun_map: int = 1024


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


def box_corners(container: Container) -> FloatArray:
    """(8, 3) corners of a container's inside, m."""
    corners: FloatArray = _CORNER_BITS * np.array(container.size)
    return corners


def camera_around(
    points: FloatArray, size: tuple[int, int], azimuth: float = -58.0, elevation: float = 32.0
) -> Camera:
    """The nearest camera that sees some points from a side.

    Args:
        points: (n, 3) m.
        size: (width, height) of the picture, px.
        azimuth: of the way to the eye, degrees from +x towards +y.
        elevation: degrees above the horizon, between -90 and 90.

    Returns:
        The camera; the points fill the picture but for a small margin.

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
    corners = points @ axes.T
    # |across - shift| <= slope * (distance - near) for all corners: the two extremes give both unknowns.
    high = np.max(corners[:, :2] + slopes * corners[:, 2:], axis=0)
    low = np.max(-corners[:, :2] + slopes * corners[:, 2:], axis=0)
    distance = float(np.max((high + low) / (2 * slopes)))
    shift = (high - low) / 2
    eye = np.array([shift[0], shift[1], distance]) @ axes
    return Camera(eye=eye, axes=axes, focal=focal, size=(width, height))


def paint(
    container: Container,
    surfaces: Sequence[Surface],
    camera: Camera,
    quality: Quality,
    around: FloatArray | None = None,
) -> Image:
    """Draw surfaces and the container.

    Args:
        container: the box; its far sides are filled, its front is open.
        surfaces: what else there is.
        camera: from where.
        quality: how finely.
        around: (n, 3) points between which shadows fall, m; None takes all that is drawn.

    Returns:
        (height, width, 3) sRGB.
    """
    from packenv.view import shading_kernels as shading, zbuffer_kernels as zbuffer

    samples, size = quality.samples, camera.size
    columns, rows = size[0] * samples, size[1] * samples
    nearness = np.zeros((rows, columns), dtype=np.float32)
    owners = np.full((rows, columns), zbuffer.NOTHING, dtype=np.int16)
    facing = np.zeros((rows, columns, 3), dtype=np.int16)

    def draw(vertices: FloatArray, faces: IntArray, normals: Float32Array, owner: int) -> None:
        points = camera.project(vertices)
        points[:, :2] *= samples
        zbuffer.draw_faces(points, faces, normals, owner, nearness, owners, facing)

    for owner, surface in enumerate(surfaces):
        draw(surface.vertices, surface.faces, surface.normals, owner)
    corners = box_corners(container)
    for wall, normal in _WALLS:
        # The front stays open: draw_faces skips what is turned away from the eye.
        triangles = np.array([[wall[0], wall[1], wall[2]], [wall[0], wall[2], wall[3]]], dtype=np.int64)
        draw(corners, triangles, np.tile(np.array(normal, dtype=np.float32), (2, 3, 1)), len(surfaces))

    gap = 0.02 * max(container.size)
    marks = shading.mark_edges(nearness, owners, facing, gap, math.cos(math.radians(32.0)), samples // 2)
    # The box has lines of its own, drawn below.
    marks[owners == len(surfaces)] = 0
    if around is None:
        around = np.concatenate([corners, *(surface.vertices for surface in surfaces)])
    dark = [surface for surface in surfaces if surface.shadow]
    skies, sky_axes = _light_maps(dark, around, _sky_directions(quality.skies), quality.sky_map)
    sun, sun_axes = _light_maps(dark, around, np.array([_SUN]), quality.sun_map)
    reach = float(np.linalg.norm(container.size))
    ray_axes = np.stack(
        [
            camera.axes[0] / (camera.focal * samples),
            -camera.axes[1] / (camera.focal * samples),
            -camera.axes[2]
            - camera.axes[0] * size[0] / 2 / camera.focal
            + camera.axes[1] * size[1] / 2 / camera.focal,
        ]
    )
    colours = linear([*(surface.colour for surface in surfaces), _BOX_COLOUR])
    picture = shading.shade(
        nearness,
        owners,
        facing,
        marks,
        samples,
        colours,
        linear([_BACKGROUND])[0],
        camera.eye,
        ray_axes,
        skies,
        sky_axes,
        2.5 * reach / quality.sky_map,
        sun[0],
        sun_axes[0],
        3.0 * reach / quality.sun_map,
        np.array([_SKYLIGHT, _SUNLIGHT, _CREASE_LIGHT, _SILHOUETTE_LIGHT, _WALL_SHADE, _FLOOR_SHADE]),
    )
    ends = camera.project(corners)
    width = max(1.0, min(size) / 640)
    line = linear([_LINE_COLOUR])[0]
    filled = [
        wall for wall, normal in _WALLS if _seen_from_inside(camera, corners[list(wall)], np.array(normal))
    ]
    for first, second in _EDGES:
        behind = any(first in wall and second in wall for wall in filled)
        opacity = 1.0 if behind else _FRONT_EDGE_OPACITY
        shading.draw_line(picture, nearness, samples, ends[first], ends[second], width, line, opacity, 2e-3)
    return _encode_srgb(picture)


def silhouette(surface: Surface, camera: Camera) -> NDArray[np.bool_]:
    """Which pixels a surface would cover if nothing were before it: (height, width)."""
    from packenv.view import zbuffer_kernels as zbuffer

    columns, rows = camera.size
    nearness = np.zeros((rows, columns), dtype=np.float32)
    owners = np.full((rows, columns), zbuffer.NOTHING, dtype=np.int16)
    facing = np.zeros((rows, columns, 3), dtype=np.int16)
    points = camera.project(surface.vertices)
    zbuffer.draw_faces(points, surface.faces, surface.normals, 0, nearness, owners, facing)
    covered: NDArray[np.bool_] = owners == 0
    return covered


def _seen_from_inside(camera: Camera, wall: FloatArray, normal: FloatArray) -> bool:
    """Whether the eye is on the inner side of a wall, given its corners and its inward normal."""
    return float((camera.eye - wall[0]) @ normal) > 0.0


def _light_maps(
    surfaces: Sequence[Surface], around: FloatArray, directions: FloatArray, size: int
) -> tuple[Float32Array, FloatArray]:
    """Light maps of distant lights; what is outside them is in full light.

    Args:
        surfaces: what throws shadows.
        around: (n, 3) points that the maps cover, m.
        directions: (d, 3) to the lights.
        size: side of each map, px.

    Returns:
        (d, size, size) maps and (d, 3, 4) transforms from points to column, row and height, all in px.
    """
    from packenv.view.zbuffer_kernels import draw_light_map

    low, high = around.min(axis=0), around.max(axis=0)
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
        for surface in surfaces:
            draw_light_map(surface.vertices @ axes.T + offset, surface.faces, maps[index])
    return maps, transforms


def _sky_directions(count: int) -> FloatArray:
    """(d, 3) unit vectors evenly over the upper half sphere."""
    index = np.arange(count)
    z = 0.08 + 0.92 * (index + 0.5) / count
    turn = index * math.pi * (3.0 - math.sqrt(5.0))
    flat = np.sqrt(1.0 - z * z)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


def linear(colours: list[tuple[int, int, int]]) -> FloatArray:
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
