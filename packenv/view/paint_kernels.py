"""Compiled kernels of the software renderer: z-buffer, drawn edges, light.

Screen coordinates are (column, row) in pixels, rows downwards; the centre of pixel (c, r) is at
(c + 0.5, r + 0.5). Depth is kept as *nearness* = 1 / distance along the view axis, because that is what is
linear over a triangle in a perspective picture; 0 is infinitely far. A light map is the same picture of the
scene as a distant light sees it, with the height towards the light in place of nearness.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from packenv.types import Float32Array, FloatArray, IntArray

NOTHING = -1
"""What a pixel shows where no face is."""


@njit(cache=True, error_model="numpy")
def rasterize(points: FloatArray, faces: IntArray, nearness: Float32Array, shown: NDArray[np.int32]) -> None:
    """Draw the faces that are turned to the eye into a z-buffer.

    Args:
        points: (n, 3) column, row and nearness of each vertex.
        faces: (m, 3), counter-clockwise seen from outside.
        nearness: (rows, columns), changed in place.
        shown: (rows, columns) index of the nearest face, changed in place.
    """
    rows, columns = nearness.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = points[a, 0], points[a, 1], points[a, 2]
        bx, by, bz = points[b, 0], points[b, 1], points[b, 2]
        cx, cy, cz = points[c, 0], points[c, 1], points[c, 2]
        # Rows run downwards, so what is counter-clockwise in space has a negative area here.
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        # A vertex behind the eye has no place on the screen.
        if area >= -1e-12 or az <= 0.0 or bz <= 0.0 or cz <= 0.0:
            continue
        first_row, last_row = max(0, math.ceil(min(ay, by, cy) - 0.5)), math.floor(max(ay, by, cy) - 0.5)
        first, last = max(0, math.ceil(min(ax, bx, cx) - 0.5)), math.floor(max(ax, bx, cx) - 0.5)
        if first_row > last_row or first > last:
            continue
        step_a, step_b = (by - cy) / area, (cy - ay) / area
        for row in range(first_row, min(rows - 1, last_row) + 1):
            x, y = first + 0.5, row + 0.5
            share_a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
            share_b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
            for column in range(first, min(columns - 1, last) + 1):
                share_c = 1.0 - share_a - share_b
                if share_a >= 0.0 and share_b >= 0.0 and share_c >= 0.0:
                    near = share_a * az + share_b * bz + share_c * cz
                    if near > nearness[row, column]:
                        nearness[row, column] = near
                        shown[row, column] = f
                share_a += step_a
                share_b += step_b


@njit(cache=True, error_model="numpy")
def mark_edges(
    nearness: Float32Array,
    shown: NDArray[np.int32],
    parts: IntArray,
    looks: FloatArray,
    gap: float,
    radius: int,
) -> NDArray[np.uint8]:
    """Find where a drawing would have a line.

    Args:
        nearness: (rows, columns).
        shown: (rows, columns), from :func:`rasterize`.
        parts: (m, 2) of each face its owner and its smooth part.
        looks: (k, 4) as for :func:`shade`; only owners whose whole shade is seen get lines.
        gap: smallest step in distance along the view axis that is an edge of its own, m.
        radius: lines are 2 radius + 1 pixels wide at most.

    Returns:
        (rows, columns): 2 on a silhouette, 1 on a crease, else 0.
    """
    rows, columns = nearness.shape
    marks = np.zeros((rows, columns), dtype=np.uint8)
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            face = shown[row, column]
            if face < 0 or looks[parts[face, 0], 3] < 1.0:
                continue
            own, near, mark = parts[face, 0], nearness[row, column], 0
            for down, right in ((0, 1), (1, 0)):
                bend, alone = -2.0 * near, False
                for sign in (-1, 1):
                    r, c = row + sign * down, column + sign * right
                    other = shown[r, c]
                    bend += nearness[r, c]
                    if other < 0 or parts[other, 0] != own:
                        alone = True
                        # The nearer of the two owns the line between them.
                        if nearness[r, c] < near:
                            mark = 2
                    elif parts[other, 1] != parts[face, 1]:
                        mark = max(mark, 1)
                # Nearness is linear over a plane, however slanted: only a step or a bend has a second
                # difference.
                if not alone and bend < -gap * near * near:
                    mark = 2
            if mark == 0:
                continue
            for r in range(max(0, row - radius), min(rows, row + radius + 1)):
                for c in range(max(0, column - radius), min(columns, column + radius + 1)):
                    # A line never bleeds onto the background or onto the box.
                    other = shown[r, c]
                    if other >= 0 and looks[parts[other, 0], 3] == 1.0 and marks[r, c] < mark:
                        marks[r, c] = mark
    return marks


@njit(cache=True, error_model="numpy")
def _arrives(maps: Float32Array, axes: FloatArray, d: int, x: float, y: float, z: float) -> float:
    """Share of light d that arrives at a place, 0 to 1: between the four nearest places of its map."""
    across = axes[d, 0, 0] * x + axes[d, 0, 1] * y + axes[d, 0, 2] * z + axes[d, 0, 3] - 0.5
    down = axes[d, 1, 0] * x + axes[d, 1, 1] * y + axes[d, 1, 2] * z + axes[d, 1, 3] - 0.5
    height = axes[d, 2, 0] * x + axes[d, 2, 1] * y + axes[d, 2, 2] * z + axes[d, 2, 3]
    c, r = math.floor(across), math.floor(down)
    if r < 0 or c < 0 or r + 1 >= maps.shape[1] or c + 1 >= maps.shape[2]:
        return 1.0
    u, v = across - c, down - r
    upper = (1.0 - u) * (maps[d, r, c] <= height) + u * (maps[d, r, c + 1] <= height)
    lower = (1.0 - u) * (maps[d, r + 1, c] <= height) + u * (maps[d, r + 1, c + 1] <= height)
    share: float = (1.0 - v) * upper + v * lower
    return share


@njit(cache=True, error_model="numpy")
def _light(
    x: float,
    y: float,
    z: float,
    nx: float,
    ny: float,
    nz: float,
    skies: Float32Array,
    sky_axes: FloatArray,
    sky_bias: float,
    sun: Float32Array,
    sun_axes: FloatArray,
    sun_bias: float,
) -> float:
    """Light at one place of a surface with a unit normal; 1 is a good deal of it."""
    arrived = possible = 0.0
    px, py, pz = x + sky_bias * nx, y + sky_bias * ny, z + sky_bias * nz
    for d in range(skies.shape[0]):
        # The third axis is the direction to the light times the map's scale.
        slope = nx * sky_axes[d, 2, 0] + ny * sky_axes[d, 2, 1] + nz * sky_axes[d, 2, 2]
        if slope > 0.0:
            possible += slope
            arrived += slope * _arrives(skies, sky_axes, d, px, py, pz)
    open_sky = arrived / possible if possible > 0.0 else 0.5
    # What faces down gets its light back from the floor.
    light = 0.68 * (0.6 + 0.4 * nz) * (0.12 + 0.88 * open_sky)
    axes = sun_axes[0]
    scale = math.sqrt(axes[2, 0] ** 2 + axes[2, 1] ** 2 + axes[2, 2] ** 2)
    slope = (nx * axes[2, 0] + ny * axes[2, 1] + nz * axes[2, 2]) / scale
    if slope > 0.0:
        px, py, pz = x + sun_bias * nx, y + sun_bias * ny, z + sun_bias * nz
        share, step = 0.0, 1.6 / (scale * scale)
        for i in range(-1, 2):
            for j in range(-1, 2):
                # Soft: nine places around, 1.6 px of the map apart.
                dx = step * (i * axes[0, 0] + j * axes[1, 0])
                dy = step * (i * axes[0, 1] + j * axes[1, 1])
                dz = step * (i * axes[0, 2] + j * axes[1, 2])
                share += _arrives(sun, sun_axes, 0, px + dx, py + dy, pz + dz)
        light += 0.66 * slope * share / 9.0
    return light


@njit(cache=True, error_model="numpy")
def shade(
    nearness: Float32Array,
    shown: NDArray[np.int32],
    marks: NDArray[np.uint8],
    samples: int,
    points: FloatArray,
    faces: IntArray,
    normals: FloatArray,
    parts: IntArray,
    looks: FloatArray,
    eye: FloatArray,
    ray_axes: FloatArray,
    skies: Float32Array,
    sky_axes: FloatArray,
    sky_bias: float,
    sun: Float32Array,
    sun_axes: FloatArray,
    sun_bias: float,
) -> Float32Array:
    """Light the z-buffer and average it to the picture's pixels.

    Args:
        nearness: (rows · samples, columns · samples).
        shown: as ``nearness``; from :func:`rasterize`.
        marks: as ``nearness``, from :func:`mark_edges`.
        samples: sub-pixels along each side of a pixel.
        points: (n, 3) column, row and nearness of each vertex.
        faces: (m, 3).
        normals: (n, 3) unit.
        parts: (m, 2) of each face its owner and its smooth part.
        looks: (k, 4) linear red, green and blue of each owner, 0 to 1, and the share of its shade that is seen.
        eye: (3,) m.
        ray_axes: (3, 3) rows: change of the view ray (of unit depth) for a column, for a row, and the ray
            through the corner (0, 0).
        skies: (d, s, s) light maps of skylight from d directions.
        sky_axes: (d, 3, 4) to each map's column, row and height.
        sky_bias: m along the normal, to keep a surface from shading itself.
        sun: (1, s', s') light map of the sun.
        sun_axes: (1, 3, 4).
        sun_bias: as ``sky_bias``.

    Returns:
        (rows, columns, 3) linear light; the background is white.
    """
    rows, columns = nearness.shape[0] // samples, nearness.shape[1] // samples
    picture = np.zeros((rows, columns, 3), dtype=np.float32)
    middle = samples // 2
    for row in range(rows):
        for column in range(columns):
            top, left = row * samples, column * samples
            first = shown[top, left]
            # Light changes slowly inside a surface: one value serves the pixel unless an edge crosses it.
            same = True
            for r in range(top, top + samples):
                for c in range(left, left + samples):
                    other = shown[r, c]
                    alike = other == first or (first >= 0 <= other and parts[other, 0] == parts[first, 0])
                    same = same and alike and marks[r, c] == marks[top, left]
            count = 1 if same else samples * samples
            for s in range(count):
                r = top + (middle if same else s // samples)
                c = left + (middle if same else s % samples)
                face = shown[r, c]
                if face < 0:
                    for k in range(3):
                        picture[row, column, k] += 1.0 / count
                    continue
                owner, light = parts[face, 0], 1.0
                share = looks[owner, 3]
                if share > 0.0:
                    a, b, d = faces[face, 0], faces[face, 1], faces[face, 2]
                    ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
                    cx, cy, x, y = points[d, 0], points[d, 1], c + 0.5, r + 0.5
                    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
                    share_a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                    share_b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                    share_c = 1.0 - share_a - share_b
                    nx = share_a * normals[a, 0] + share_b * normals[b, 0] + share_c * normals[d, 0]
                    ny = share_a * normals[a, 1] + share_b * normals[b, 1] + share_c * normals[d, 1]
                    nz = share_a * normals[a, 2] + share_b * normals[b, 2] + share_c * normals[d, 2]
                    length = max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
                    depth = 1.0 / nearness[r, c]
                    light = _light(
                        eye[0] + depth * (ray_axes[2, 0] + x * ray_axes[0, 0] + y * ray_axes[1, 0]),
                        eye[1] + depth * (ray_axes[2, 1] + x * ray_axes[0, 1] + y * ray_axes[1, 1]),
                        eye[2] + depth * (ray_axes[2, 2] + x * ray_axes[0, 2] + y * ray_axes[1, 2]),
                        nx / length,
                        ny / length,
                        nz / length,
                        skies,
                        sky_axes,
                        sky_bias,
                        sun,
                        sun_axes,
                        sun_bias,
                    )
                    if marks[r, c] == 2:
                        light *= 0.34
                    elif marks[r, c] == 1:
                        light *= 0.72
                    light = 1.0 - share * (1.0 - light)
                for k in range(3):
                    picture[row, column, k] += light * looks[owner, k] / count
    return picture
