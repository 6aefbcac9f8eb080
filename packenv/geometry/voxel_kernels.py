"""Compiled kernel that finds the voxels which a triangle mesh touches."""

from __future__ import annotations

import math

import numpy as np

from packenv.geometry.raster_kernels import cell_range, clip_triangle
from packenv.kernels import compiled


@compiled
def touch(vertices, faces, pitch, grid):  # type: ignore[no-untyped-def]
    """Set every voxel that a face reaches into by more than the tolerance of the heightmaps.

    Each triangle is clipped to each column of voxels that it touches; what is left of it there is connected, so it
    touches every voxel between its lowest and its highest point and no other.

    Args:
        vertices: (n, 3) smallest x, y and z at 0, m.
        faces: (m, 3) vertex indices, counter-clockwise from outside.
        pitch: side of a voxel, m.
        grid: (w, d, h) bool, set in place.
    """
    w, d, h = grid.shape
    high = np.full((w, d), -np.inf)
    low = np.full((w, d), np.inf)
    triangle = np.empty((3, 3))
    a, b, c = np.empty((12, 3)), np.empty((12, 3)), np.empty((12, 3))
    for f in range(faces.shape[0]):
        for corner in range(3):
            for k in range(3):
                triangle[corner, k] = vertices[faces[f, corner], k]
        clip_triangle(triangle, pitch, high, low, a, b, c)
        up = (triangle[1, 0] - triangle[0, 0]) * (triangle[2, 1] - triangle[0, 1])
        up -= (triangle[1, 1] - triangle[0, 1]) * (triangle[2, 0] - triangle[0, 0])
        # One column more on either side: on a line between two, the clipping chooses by the normal.
        i0 = max(math.floor(min(triangle[0, 0], triangle[1, 0], triangle[2, 0]) / pitch) - 1, 0)
        i1 = min(math.floor(max(triangle[0, 0], triangle[1, 0], triangle[2, 0]) / pitch) + 1, w - 1)
        j0 = max(math.floor(min(triangle[0, 1], triangle[1, 1], triangle[2, 1]) / pitch) - 1, 0)
        j1 = min(math.floor(max(triangle[0, 1], triangle[1, 1], triangle[2, 1]) / pitch) + 1, d - 1)
        for i in range(min(i0, w - 1), i1 + 1):
            for j in range(min(j0, d - 1), j1 + 1):
                if low[i, j] == np.inf:
                    continue
                first, last = cell_range(low[i, j], high[i, j], pitch, h, up)
                for k in range(first, last + 1):
                    grid[i, j, k] = True
                low[i, j] = np.inf
                high[i, j] = -np.inf
