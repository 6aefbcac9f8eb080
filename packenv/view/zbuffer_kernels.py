"""Compiled kernels of the software renderer that draw faces: corner normals, z-buffer, light maps.

Screen coordinates are (column, row) in pixels, rows downwards; the centre of pixel (c, r) is at
(c + 0.5, r + 0.5). Depth is kept as *nearness* = 1 / distance along the view axis, because that is what is
linear over a triangle in a perspective picture; 0 is infinitely far.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from packenv.types import Float32Array, FloatArray, IntArray

NOTHING = -1
"""Owner of a pixel that shows the background."""

NORMAL_SCALE = 32767.0
"""By which unit normals are multiplied to be kept as whole numbers."""


@njit(cache=True)
def corner_normals(vertices: FloatArray, faces: IntArray, crease: float) -> Float32Array:
    """Normals for shading: smooth over curved faces, hard over creases.

    Args:
        vertices: (n, 3).
        faces: (m, 3).
        crease: cosine of the angle; faces that meet at a larger angle do not share their normals.

    Returns:
        (m, 3, 3) unit normal at each corner of each face.
    """
    face_count, vertex_count = faces.shape[0], vertices.shape[0]
    normals = np.empty((face_count, 3))
    lengths = np.empty(face_count)
    start = np.zeros(vertex_count + 1, dtype=np.int64)
    for f in range(face_count):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy, uz = (
            vertices[b, 0] - vertices[a, 0],
            vertices[b, 1] - vertices[a, 1],
            vertices[b, 2] - vertices[a, 2],
        )
        vx, vy, vz = (
            vertices[c, 0] - vertices[a, 0],
            vertices[c, 1] - vertices[a, 1],
            vertices[c, 2] - vertices[a, 2],
        )
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        normals[f, 0], normals[f, 1], normals[f, 2] = nx, ny, nz
        lengths[f] = max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
        for k in range(3):
            start[faces[f, k] + 1] += 1
    for i in range(vertex_count):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    around = np.empty(3 * face_count, dtype=np.int64)
    for f in range(face_count):
        for k in range(3):
            around[fill[faces[f, k]]] = f
            fill[faces[f, k]] += 1
    result = np.empty((face_count, 3, 3), dtype=np.float32)
    for f in range(face_count):
        for k in range(3):
            x = y = z = 0.0
            for at in range(start[faces[f, k]], start[faces[f, k] + 1]):
                g = around[at]
                dot = (
                    normals[f, 0] * normals[g, 0]
                    + normals[f, 1] * normals[g, 1]
                    + normals[f, 2] * normals[g, 2]
                )
                if dot >= crease * lengths[f] * lengths[g]:
                    # Not divided by its length: a large face counts for more than a sliver.
                    x += normals[g, 0]
                    y += normals[g, 1]
                    z += normals[g, 2]
            length = max(math.sqrt(x * x + y * y + z * z), 1e-300)
            result[f, k, 0], result[f, k, 1], result[f, k, 2] = x / length, y / length, z / length
    return result


@njit(cache=True)
def _covered(a: float, b: float, c: float, count: int) -> tuple[int, int]:
    """First and last pixel, of ``count``, whose centre is between the least and the largest of three."""
    return max(0, math.ceil(min(a, b, c) - 0.5)), min(count - 1, math.floor(max(a, b, c) - 0.5))


@njit(cache=True)
def draw_faces(
    points: FloatArray,
    faces: IntArray,
    normals: Float32Array,
    owner: int,
    nearness: Float32Array,
    owners: NDArray[np.int16],
    facing: NDArray[np.int16],
) -> None:
    """Draw the faces that are turned to the eye into a z-buffer.

    Args:
        points: (n, 3) column, row and nearness of each vertex.
        faces: (m, 3), counter-clockwise seen from outside.
        normals: (m, 3, 3) as from :func:`corner_normals`.
        owner: what the pixels are marked with.
        nearness: (rows, columns), changed in place.
        owners: (rows, columns), changed in place.
        facing: (rows, columns, 3) normals times 32767, changed in place.
    """
    rows, columns = nearness.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay = points[a, 0], points[a, 1]
        bx, by = points[b, 0], points[b, 1]
        cx, cy = points[c, 0], points[c, 1]
        # Rows run downwards, so what is counter-clockwise in space has a negative area here.
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        # A vertex behind the eye has no place on the screen.
        if area >= -1e-12 or points[a, 2] <= 0.0 or points[b, 2] <= 0.0 or points[c, 2] <= 0.0:
            continue
        first_row, last_row = _covered(ay, by, cy, rows)
        first_column, last_column = _covered(ax, bx, cx, columns)
        inverse = 1.0 / area
        step_a, step_b = (by - cy) * inverse, (cy - ay) * inverse
        for row in range(first_row, last_row + 1):
            y, x = row + 0.5, first_column + 0.5
            share_a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) * inverse
            share_b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) * inverse
            for column in range(first_column, last_column + 1):
                share_c = 1.0 - share_a - share_b
                if share_a >= 0.0 and share_b >= 0.0 and share_c >= 0.0:
                    near = share_a * points[a, 2] + share_b * points[b, 2] + share_c * points[c, 2]
                    if near > nearness[row, column]:
                        nearness[row, column] = near
                        owners[row, column] = owner
                        nx = (
                            share_a * normals[f, 0, 0]
                            + share_b * normals[f, 1, 0]
                            + share_c * normals[f, 2, 0]
                        )
                        ny = (
                            share_a * normals[f, 0, 1]
                            + share_b * normals[f, 1, 1]
                            + share_c * normals[f, 2, 1]
                        )
                        nz = (
                            share_a * normals[f, 0, 2]
                            + share_b * normals[f, 1, 2]
                            + share_c * normals[f, 2, 2]
                        )
                        scale = NORMAL_SCALE / max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
                        facing[row, column, 0] = np.int16(nx * scale)
                        facing[row, column, 1] = np.int16(ny * scale)
                        facing[row, column, 2] = np.int16(nz * scale)
                share_a += step_a
                share_b += step_b


@njit(cache=True)
def draw_light_map(points: FloatArray, faces: IntArray, reach: Float32Array) -> None:
    """Record how far towards a distant light the surface reaches, for shadows.

    Args:
        points: (n, 3) column, row and height towards the light of each vertex.
        faces: (m, 3).
        reach: (rows, columns) largest height, changed in place.
    """
    rows, columns = reach.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay = points[a, 0], points[a, 1]
        bx, by = points[b, 0], points[b, 1]
        cx, cy = points[c, 0], points[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area <= 1e-12:
            continue
        first_row, last_row = _covered(ay, by, cy, rows)
        first_column, last_column = _covered(ax, bx, cx, columns)
        inverse = 1.0 / area
        for row in range(first_row, last_row + 1):
            y = row + 0.5
            for column in range(first_column, last_column + 1):
                x = column + 0.5
                share_a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) * inverse
                share_b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) * inverse
                share_c = 1.0 - share_a - share_b
                if share_a >= 0.0 and share_b >= 0.0 and share_c >= 0.0:
                    height = share_a * points[a, 2] + share_b * points[b, 2] + share_c * points[c, 2]
                    if height > reach[row, column]:
                        reach[row, column] = height
