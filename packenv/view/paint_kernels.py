"""Compiled kernels of the software renderer: z-buffer, drawn edges, light.

Screen coordinates are (column, row) in pixels, rows downwards; the centre of pixel (c, r) is at
(c + 0.5, r + 0.5). Depth is kept as *nearness* = 1 / distance along the view axis, because that is what is
linear over a triangle in a perspective picture; 0 is infinitely far. A light map is the same picture of the
scene as a distant light sees it, with the height towards the light in place of nearness.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from packenv.kernels import compiled_like_numpy
from packenv.types import Float32Array, FloatArray, IntArray

NOTHING = -1
"""What a pixel shows where no face is."""


@compiled_like_numpy
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


@compiled_like_numpy
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


@compiled_like_numpy
def _arrives(
    maps: Float32Array,
    axes: FloatArray,
    d: int,
    at: FloatArray,
    normal: FloatArray,
    bias: float,
    aside: float,
    below: float,
) -> float:
    """Share of light d that arrives at a place, 0 to 1: between the four nearest places of its map."""
    x, y, z = at[0] + bias * normal[0], at[1] + bias * normal[1], at[2] + bias * normal[2]
    across = axes[d, 0, 0] * x + axes[d, 0, 1] * y + axes[d, 0, 2] * z + axes[d, 0, 3] + aside - 0.5
    down = axes[d, 1, 0] * x + axes[d, 1, 1] * y + axes[d, 1, 2] * z + axes[d, 1, 3] + below - 0.5
    height = axes[d, 2, 0] * x + axes[d, 2, 1] * y + axes[d, 2, 2] * z + axes[d, 2, 3]
    c, r = math.floor(across), math.floor(down)
    if r < 0 or c < 0 or r + 1 >= maps.shape[1] or c + 1 >= maps.shape[2]:
        return 1.0
    u, v = across - c, down - r
    upper = (1.0 - u) * (maps[d, r, c] <= height) + u * (maps[d, r, c + 1] <= height)
    lower = (1.0 - u) * (maps[d, r + 1, c] <= height) + u * (maps[d, r + 1, c + 1] <= height)
    share: float = (1.0 - v) * upper + v * lower
    return share


@compiled_like_numpy
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
    rays: FloatArray,
    skies: Float32Array,
    sky_axes: FloatArray,
    sun: Float32Array,
    sun_axes: FloatArray,
    biases: FloatArray,
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
        rays: (3, 3) as from ``Camera.rays``.
        skies: (d, s, s) light maps of skylight from d directions.
        sky_axes: (d, 3, 4) to each map's column, row and height.
        sun: (1, s', s') light map of the sun.
        sun_axes: (1, 3, 4).
        biases: (2,) m along the normal under skylight and sun, to keep a surface from shading itself.

    Returns:
        (rows, columns, 3) linear light; the background is white.
    """
    rows, columns = nearness.shape[0] // samples, nearness.shape[1] // samples
    picture = np.zeros((rows, columns, 3), dtype=np.float32)
    size = math.sqrt(sun_axes[0, 2, 0] ** 2 + sun_axes[0, 2, 1] ** 2 + sun_axes[0, 2, 2] ** 2)
    at, n = np.empty(3), np.empty(3)
    for pixel in range(rows * columns):
        row, column = pixel // columns, pixel % columns
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
            r = top + (samples // 2 if same else s // samples)
            c = left + (samples // 2 if same else s % samples)
            face = shown[r, c]
            if face < 0:
                for k in range(3):
                    picture[row, column, k] += 1.0 / count
                continue
            owner, light = parts[face, 0], 1.0
            if looks[owner, 3] > 0.0:
                i, j, h = faces[face, 0], faces[face, 1], faces[face, 2]
                ax, ay, bx, by = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
                cx, cy, x, y = points[h, 0], points[h, 1], c + 0.5, r + 0.5
                area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
                share_a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                share_b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                for k in range(3):
                    ray = rays[2, k] + x * rays[0, k] + y * rays[1, k]
                    at[k] = eye[k] + ray / nearness[r, c]
                    n[k] = share_a * normals[i, k] + share_b * normals[j, k]
                    n[k] += (1.0 - share_a - share_b) * normals[h, k]
                length = max(math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]), 1e-12)
                for k in range(3):
                    n[k] /= length
                arrived = possible = 0.0
                for d in range(skies.shape[0]):
                    # The third axis is the direction to the light times the map's scale.
                    slope = n[0] * sky_axes[d, 2, 0] + n[1] * sky_axes[d, 2, 1] + n[2] * sky_axes[d, 2, 2]
                    if slope > 0.0:
                        possible += slope
                        arrived += slope * _arrives(skies, sky_axes, d, at, n, biases[0], 0.0, 0.0)
                open_sky = arrived / possible if possible > 0.0 else 0.5
                # What faces down gets its light back from the floor.
                light = 0.68 * (0.6 + 0.4 * n[2]) * (0.12 + 0.88 * open_sky)
                slope = n[0] * sun_axes[0, 2, 0] + n[1] * sun_axes[0, 2, 1] + n[2] * sun_axes[0, 2, 2]
                if slope > 0.0:
                    # Soft: nine places around, 1.6 px of the map apart.
                    for tap in range(9):
                        u, v = 1.6 * (tap % 3 - 1), 1.6 * (tap // 3 - 1)
                        arrived = _arrives(sun, sun_axes, 0, at, n, biases[1], u, v)
                        light += 0.66 / 9.0 * slope / size * arrived
                if marks[r, c] > 0:
                    light *= 0.34 if marks[r, c] == 2 else 0.72
                light = 1.0 - looks[owner, 3] * (1.0 - light)
            for k in range(3):
                picture[row, column, k] += light * looks[owner, k] / count
    return picture
