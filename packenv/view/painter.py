"""Draws surfaces and the open box in software, with soft light, shadows and lines: no display, no graphics card."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from packenv.types import Container, Float32Array, FloatArray, IntArray
from packenv.view.camera import Camera, in_axes
from packenv.view.surfaces import Surface, box_corners, box_surfaces

Image: TypeAlias = NDArray[np.uint8]

_SUN = (0.25, -0.75, 1.15)
_LINE_COLOUR = (74, 86, 102)
_EDGES = np.array([(a, a | bit) for bit in (1, 2, 4) for a in range(8) if not a & bit])
"""(12, 2) corners of the box, as of ``box_corners``, that an edge joins."""


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


FINE = Quality()
"""For a picture to keep."""
QUICK = Quality(samples=2, skies=16, sky_map=128, sun_map=512)
"""For one of many."""


def paint(
    container: Container, surfaces: Sequence[Surface], camera: Camera, quality: Quality, around: FloatArray
) -> Image:
    """Draw surfaces and the container, whose front is open.

    Args:
        container: the box.
        surfaces: what else there is, in the container frame.
        camera: from where.
        quality: how finely.
        around: (n, 3) points between which shadows fall, m.

    Returns:
        (height, width, 3) sRGB.
    """
    from packenv.view import paint_kernels as kernels

    samples = quality.samples
    drawn = [*surfaces, *box_surfaces(container)]
    vertices, faces = _joined([surface.vertices for surface in drawn], [surface.faces for surface in drawn])
    strips, strip_faces = _box_lines(container, camera)
    points, all_faces = _joined([camera.project(vertices), strips], [faces, strip_faces])
    points[:, :2] *= samples
    sizes = [len(surface.faces) for surface in drawn]
    owners = np.repeat(np.arange(len(drawn) + 1), [*sizes, len(strip_faces)])
    parts = np.zeros((len(all_faces), 2), dtype=np.int64)
    parts[:, 0], parts[: len(faces), 1] = owners, np.concatenate([surface.parts for surface in drawn])
    colours = _linear([*(surface.colour for surface in drawn), _LINE_COLOUR])
    looks = np.column_stack([colours, [*(surface.shade for surface in drawn), 0.0]])
    nearness, shown = _rasterized(points, all_faces, (camera.size[1] * samples, camera.size[0] * samples))
    gap = 0.02 * max(container.size)
    marks = kernels.mark_edges(nearness, shown, parts, looks, gap, samples // 2)
    dark = faces[np.repeat([surface.shadow for surface in drawn], sizes)]
    skies, sky_axes = _light_maps(vertices, dark, around, _sky_directions(quality.skies), quality.sky_map)
    sun, sun_axes = _light_maps(vertices, dark, around, np.array([_SUN]), quality.sun_map)
    texels = float(np.linalg.norm(np.ptp(around, axis=0))) / np.array([quality.sky_map, quality.sun_map])
    picture = kernels.shade(
        nearness,
        shown,
        marks,
        samples,
        points,
        all_faces,
        np.concatenate([surface.normals for surface in drawn]),
        parts,
        looks,
        camera.eye,
        camera.rays(samples),
        skies,
        sky_axes,
        sun,
        sun_axes,
        np.array([2.5, 3.0]) * texels,
    )
    return _encode_srgb(picture)


def silhouette(surface: Surface, camera: Camera) -> NDArray[np.bool_]:
    """Which pixels a surface would cover if nothing were before it: (height, width)."""
    _, shown = _rasterized(camera.project(surface.vertices), surface.faces, camera.size[::-1])
    covered: NDArray[np.bool_] = shown >= 0
    return covered


def _joined(points: Sequence[FloatArray], faces: Sequence[IntArray]) -> tuple[FloatArray, IntArray]:
    """Several meshes as one."""
    first = np.cumsum([0, *(len(some) for some in points)])
    moved = [some + start for some, start in zip(faces, first[:-1], strict=True)]
    return np.concatenate(points), np.concatenate(moved)


def _rasterized(
    points: FloatArray, faces: IntArray, shape: tuple[int, int]
) -> tuple[Float32Array, NDArray[np.int32]]:
    """(rows, columns) nearness, 0 where nothing is, and the face that is seen."""
    from packenv.view.paint_kernels import NOTHING, rasterize

    nearness, shown = np.zeros(shape, dtype=np.float32), np.full(shape, NOTHING, dtype=np.int32)
    rasterize(points, faces, nearness, shown)
    return nearness, shown


def _box_lines(container: Container, camera: Camera) -> tuple[FloatArray, IntArray]:
    """The box's edges as strips of equal width on the screen, thinner before the items.

    Returns:
        (48, 3) column, row in px and nearness of the strips' corners, and (24, 3) faces.
    """
    corners = box_corners(container)
    ends = camera.project(corners)[_EDGES]
    along = ends[:, 1, :2] - ends[:, 0, :2]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    # An edge belongs to two sides of the box; it is before the items if the eye is beyond both, or the lid's.
    outer = (camera.eye < corners) == (corners == 0.0)
    outer[corners[:, 2] > 0.0, 2] = True
    first, second = _EDGES.T
    before = (outer[first] | (corners[first] != corners[second])).all(axis=1)
    across *= np.where(before, 0.6, 1.0)[:, None] * max(1.0, min(camera.size) / 640) / 2
    strips = np.repeat(ends, 2, axis=1)
    strips[:, [0, 3], :2] -= across[:, None]
    strips[:, [1, 2], :2] += across[:, None]
    # Slightly nearer than the wall that it lies on.
    strips[:, :, 2] *= 1.002
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(len(strips))[:, None, None]
    return strips.reshape(-1, 3), faces.reshape(-1, 3)


def _light_maps(
    vertices: FloatArray, faces: IntArray, around: FloatArray, directions: FloatArray, size: int
) -> tuple[Float32Array, FloatArray]:
    """Light maps of distant lights; what is outside them is in full light.

    Args:
        vertices: (n, 3) m.
        faces: (m, 3) that throw shadows.
        around: (k, 3) points that the maps cover, m.
        directions: (d, 3) to the lights.
        size: side of each map, px.

    Returns:
        (d, size, size) maps and (d, 3, 4) transforms from points to column, row and height, all in px.
    """
    low, high = around.min(axis=0), around.max(axis=0)
    scale = (size - 2) / float(np.linalg.norm(high - low))
    maps = np.empty((len(directions), size, size), dtype=np.float32)
    transforms = np.empty((len(directions), 3, 4))
    for index, direction in enumerate(directions):
        toward = direction / np.linalg.norm(direction)
        across = np.cross([0.0, 1.0, 0.0] if abs(toward[1]) < 0.9 else [1.0, 0.0, 0.0], toward)
        across /= np.linalg.norm(across)
        axes = np.stack([across, -np.cross(toward, across), toward]) * scale
        # Heights are positive: 0 is where nothing is.
        offset = np.array([size / 2, size / 2, 4.0 * size]) - axes @ ((low + high) / 2)
        transforms[index] = np.column_stack([axes, offset])
        maps[index], _ = _rasterized(in_axes(vertices, axes) + offset, faces, (size, size))
    return maps, transforms


def _sky_directions(count: int) -> FloatArray:
    """(d, 3) unit vectors evenly over the upper half sphere."""
    index = np.arange(count)
    z = 0.08 + 0.92 * (index + 0.5) / count
    turn = index * math.pi * (3.0 - math.sqrt(5.0))
    flat = np.sqrt(1.0 - z * z)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


def _linear(colours: Sequence[tuple[int, int, int]]) -> FloatArray:
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
