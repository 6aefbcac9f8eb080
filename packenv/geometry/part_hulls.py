"""Convex hulls of points: facets, surface samples, and hulls with fewer vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from packenv.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex polytope.

    Attributes:
        vertices: (n, 3) its corners, m.
        faces: (m, 3) triangles, counter-clockwise seen from outside.
        planes: (m, 4) unit outward normal and offset: normal · p + offset is at most 0 inside.
    """

    vertices: FloatArray
    faces: IntArray
    planes: FloatArray


def hull_of(points: FloatArray) -> Hull:
    """Convex hull of points that are not all in one plane.

    Args:
        points: (k, 3), m.

    Raises:
        ValueError: the points span no volume.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        raise ValueError(f"{len(points)} points span no volume") from None
    number = np.full(len(points), -1, np.int64)
    number[hull.vertices] = np.arange(len(hull.vertices))
    vertices = np.ascontiguousarray(hull.points[hull.vertices])
    faces = number[hull.simplices]
    corner = vertices[faces]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = np.einsum("ij,ij->i", cross, hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Hull(vertices, faces, np.ascontiguousarray(hull.equations))


def hull_planes(points: FloatArray) -> FloatArray:
    """(m, 4) the planes of :func:`hull_of`, in half the time.

    Raises:
        ValueError: the points span no volume.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        planes: FloatArray = ConvexHull(points).equations
    except QhullError:
        raise ValueError(f"{len(points)} points span no volume") from None
    return planes


def surface_points(hull: Hull, spacing: float) -> FloatArray:
    """(k, 3) points on every facet, corners included, about ``spacing`` apart, m."""
    corner = hull.vertices[hull.faces]
    longest = np.linalg.norm(corner - corner[:, [1, 2, 0]], axis=2).max(axis=1)
    pieces = np.maximum(1, np.ceil(longest / spacing)).astype(np.int64)
    found = [hull.vertices]
    for n in np.unique(pieces):
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        use = i + j <= n
        weights = np.stack([i[use], j[use], (n - i - j)[use]], axis=1) / n
        found.append((weights @ corner[pieces == n]).reshape(-1, 3))
    return np.concatenate(found)


def fewer_vertices(points: FloatArray, limit: int, error: float) -> FloatArray:
    """Vertices of a hull inside the hull of the points that no point is farther outside of than ``error``.

    Args:
        points: (k, 3), m.
        limit: vertices at most; reaching it ends the search with a larger error.
        error: m.

    Returns:
        (n, 3) a choice of the points.
    """
    outer = hull_of(points).vertices
    if len(outer) <= 8:
        return outer
    middle = outer.mean(axis=0)
    _, axes = np.linalg.eigh((outer - middle).T @ (outer - middle))
    along = outer @ axes
    chosen = list(dict.fromkeys([*along.argmin(axis=0), *along.argmax(axis=0)]))
    farthest = int(np.linalg.norm(outer - middle, axis=1).argmax())
    if farthest not in chosen:
        chosen.append(farthest)
    while len(chosen) < limit:
        try:
            planes = hull_of(outer[chosen]).planes
        except ValueError:
            rest = [k for k in range(len(outer)) if k not in chosen]
            chosen.append(rest[0])
            continue
        out = outer @ planes[:, :3].T + planes[:, 3]
        apart = out.max(axis=1)
        if apart.max() <= error:
            break
        chosen.append(int(apart.argmax()))
    return hull_of(outer[chosen]).vertices
