"""Convex hulls of points: facets, surface samples, and hulls with fewer vertices."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from packenv.kernels import compiled
from packenv.types import FloatArray, IntArray

_FLAT = 1e-6
"""A facet of a rough hull has no vertex farther outside of its plane than this, m."""

_AT_ONCE = 32
"""Of so many vertices that a thinned hull has, one more is added each time."""

_BLOCK = 64
"""Points that are looked at together."""


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


def rough_planes(points: FloatArray) -> FloatArray:
    """(m, 4) planes of a polytope that contains the points' hull and exceeds it by next to nothing.

    It takes a third of the time of :func:`hull_planes`.

    Raises:
        ValueError: the points span no volume.
    """
    import manifold3d

    mesh = manifold3d.Manifold.hull_points(np.ascontiguousarray(points)).to_mesh64()
    vertices, faces = np.array(mesh.vert_properties[:, :3]), np.array(mesh.tri_verts, np.int64)
    planes = np.empty((len(faces), 4))
    count = _bounding_planes(vertices, faces, planes)
    if count < 4:
        raise ValueError(f"{len(points)} points span no volume")
    return planes[:count]


@compiled
def _bounding_planes(vertices, faces, planes):  # type: ignore[no-untyped-def]
    """Planes (m, 4) of those (m, 3) triangles that no vertex is outside of; filled from the front, and counted.

    Where many vertices are in one plane, some triangles are slivers, turned by anything.
    """
    count = 0
    for k in range(len(faces)):
        a, b, c = faces[k, 0], faces[k, 1], faces[k, 2]
        ax, ay, az = vertices[a, 0], vertices[a, 1], vertices[a, 2]
        bx, by, bz = vertices[b, 0] - ax, vertices[b, 1] - ay, vertices[b, 2] - az
        cx, cy, cz = vertices[c, 0] - ax, vertices[c, 1] - ay, vertices[c, 2] - az
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        size = math.sqrt(nx * nx + ny * ny + nz * nz)
        if size == 0.0:
            continue
        nx, ny, nz = nx / size, ny / size, nz / size
        offset = nx * ax + ny * ay + nz * az
        bounds = True
        for v in range(len(vertices)):
            if nx * vertices[v, 0] + ny * vertices[v, 1] + nz * vertices[v, 2] > offset + _FLAT:
                bounds = False
                break
        if bounds:
            planes[count, 0], planes[count, 1], planes[count, 2], planes[count, 3] = nx, ny, nz, -offset
            count += 1
    return count


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
    apart = np.full(len(outer), np.inf)
    while len(chosen) < limit:
        try:
            planes = hull_planes(outer[chosen])
        except ValueError:
            rest = [k for k in range(len(outer)) if k not in chosen]
            chosen.append(rest[0])
            continue
        apart[chosen] = 0.0
        more = min(1 + len(chosen) // _AT_ONCE, limit - len(chosen))
        outside = [k for k in _farthest(outer, planes, apart, more) if apart[k] > error]
        if not outside:
            break
        chosen += outside
    return hull_of(outer[chosen]).vertices


def _farthest(points: FloatArray, planes: FloatArray, apart: FloatArray, count: int) -> list[int]:
    """The points that are farthest outside of a hull, each outside of a plane of its own, the farthest first.

    Args:
        points: (n, 3), m.
        planes: (m, 4) of the hull.
        apart: (n,) how far each was outside of a smaller hull, m; made smaller for those that come into question.
            A hull that grows leaves no point farther outside.
        count: how many, at most.
    """
    order = np.argsort(-apart, kind="stable")
    found: list[int] = []
    used: set[int] = set()
    done = 0
    known = np.full(len(points), -1, np.int64)
    while True:
        block = order[done : done + _BLOCK]
        out = points[block] @ planes[:, :3].T + planes[:, 3]
        known[block] = out.argmax(axis=1)
        apart[block] = out[np.arange(len(block)), known[block]]
        done += len(block)
        rest = apart[order[done]] if done < len(order) else -np.inf
        found.clear()
        used.clear()
        seen = order[:done]
        for k in seen[np.argsort(-apart[seen], kind="stable")]:
            if apart[k] < rest:
                break
            if known[k] not in used:
                used.add(int(known[k]))
                found.append(int(k))
                if len(found) == count:
                    return found
        if done == len(order):
            return found
