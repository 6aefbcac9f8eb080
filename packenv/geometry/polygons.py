"""Cutting polygons into triangles without moving or adding a vertex."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from packenv.errors import MeshError
from packenv.types import FloatArray, IntArray

MAX_CORNERS = 400
"""Corners up to which the least-area cut, which costs their cube, is searched."""


def triangulated(path: Path, vertices: FloatArray, counts: IntArray, corners: IntArray) -> IntArray:
    """Cut every polygon of a mesh into triangles.

    A polygon that its first corner sees whole becomes a fan; any other is cut so that the area is
    least, which for a flat polygon is a cut that stays inside it.

    Args:
        path: the mesh file, named in messages.
        vertices: (n, 3).
        counts: (p,) corners of each polygon, at least 3.
        corners: (sum of counts,) vertex indices, polygon after polygon.

    Returns:
        (m, 3) int64, in the order of the polygons.

    Raises:
        MeshError: a polygon has too many corners to search for its cut.
    """
    if counts.size == 0:
        return np.empty((0, 3), dtype=np.int64)
    if (counts == 3).all():
        return np.ascontiguousarray(corners.reshape(-1, 3), dtype=np.int64)
    starts = np.concatenate(([0], np.cumsum(counts)[:-1]))
    blocks: list[IntArray] = []
    owners: list[NDArray[np.int64]] = []
    for n in np.unique(counts).tolist():
        owner = np.flatnonzero(counts == n)
        polygons = corners[starts[owner, None] + np.arange(n)]
        fan = np.stack(
            [np.broadcast_to(polygons[:, :1], (len(owner), n - 2)), polygons[:, 1:-1], polygons[:, 2:]],
            axis=-1,
        ).astype(np.int64)
        for k in np.flatnonzero(~_fan_is_valid(vertices, fan)).tolist():
            if n > MAX_CORNERS:
                raise MeshError(
                    f"{path}: a dented face with {n} corners; triangulate the mesh when exporting"
                )
            fan[k] = polygons[k][least_area_cut(vertices[polygons[k]])]
        blocks.append(fan.reshape(-1, 3))
        owners.append(np.repeat(owner, n - 2))
    order = np.argsort(np.concatenate(owners), kind="stable")
    faces: IntArray = np.concatenate(blocks)[order]
    return faces


def _fan_is_valid(vertices: FloatArray, fan: IntArray) -> NDArray[np.bool_]:
    """(p,) True where no triangle of the fan, (p, k, 3), faces away from the polygon's mean normal."""
    a, b, c = (vertices[fan[:, :, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    along = np.einsum("pkc,pc->pk", normals, normals.sum(axis=1))
    valid: NDArray[np.bool_] = (along >= 0).all(axis=1)
    return valid


def least_area_cut(points: FloatArray) -> IntArray:
    """Cut one closed polygon in space into triangles of the least total area.

    Dynamic programming over all cuts (Barequet and Sharir 1995). For a flat simple polygon every
    cut that leaves the polygon has a larger area, so the result stays inside.

    Args:
        points: (n, 3) corners in order, 3 ≤ n ≤ ``MAX_CORNERS``.

    Returns:
        (n - 2, 3) indices into ``points``, same winding as the polygon.

    Raises:
        ValueError: fewer than 3 corners or more than ``MAX_CORNERS``.
    """
    n = len(points)
    if not 3 <= n <= MAX_CORNERS:
        raise ValueError(f"a polygon of {n} corners, 3 to {MAX_CORNERS} can be cut")
    cost = np.zeros((n, n))
    choice = np.zeros((n, n), dtype=np.int64)
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            middle = np.arange(i + 1, j)
            area = np.linalg.norm(np.cross(points[middle] - points[i], points[j] - points[i]), axis=1)
            total = cost[i, middle] + cost[middle, j] + area
            best = int(np.argmin(total))
            cost[i, j] = total[best]
            choice[i, j] = middle[best]
    faces: list[tuple[int, int, int]] = []
    pending = [(0, n - 1)]
    while pending:
        i, j = pending.pop()
        if j - i >= 2:
            m = int(choice[i, j])
            faces.append((i, m, j))
            pending += [(i, m), (m, j)]
    return np.array(faces, dtype=np.int64)
