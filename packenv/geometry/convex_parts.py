"""An item as convex parts, and the envelope: the one shape that plan, audit and physics agree on.

A physics engine wants convex parts, and the parts of a real item reach a little outside its mesh. An item
planned on its mesh would start inside its neighbour. So everything is planned and checked on the
envelope, the union of mesh and parts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.ball_fit import Ball, fit_ball
from packenv.geometry.convex_split import split_solid
from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.meshes import mesh_hash
from packenv.geometry.outside_depth import OutsideDepth
from packenv.geometry.part_hulls import fewer_vertices, hull_of, surface_points
from packenv.kernels import compiled
from packenv.types import FloatArray, IntArray, Item

FORMAT = 3
"""Raise this when the parts of an item change."""

MAX_VERTICES = 64
"""Vertices that one of many parts may have."""

VERTEX_BUDGET = 1024
"""Vertices that an item's parts may have together without falling below :data:`MAX_VERTICES` each."""

INWARD = 0.0002
"""How far the mesh may stick out of a part whose vertices were thinned, m."""

SLIVER = 0.00001
"""Details of an envelope smaller than this are smoothed away, m."""

_SAMPLE = 0.001

_DOUBT = 0.0012
"""By how much an interpolated distance may be too small next to another, m."""


@dataclass(frozen=True, eq=False)
class ConvexParts:
    """Convex parts that stand for an item in physics.

    Attributes:
        parts: (k, 3) vertices of each convex part, mesh frame, m.
        ball: the true sphere that physics uses where the item is a ball; one part then surrounds it closely.
        bulge: largest distance of a point of the parts' surfaces from the mesh's solid, m (measured at points
            1 mm apart; closed cavities count as solid). Where there is a ball it may reach out as far.
        dent: largest distance of a point of the mesh from all parts, m (measured at vertices and middles of
            faces, by the parts' planes: off a sharp edge of a part it may be a little more).
    """

    parts: tuple[FloatArray, ...]
    ball: Ball | None
    bulge: float
    dent: float


def convex_parts(item: Item) -> ConvexParts:
    """Find the convex parts of an item: deterministic, seconds for a scan.

    Args:
        item: the item.
    """
    depth = OutsideDepth.of_field(SurfaceField.of_item(item))
    ball = fit_ball(item.vertices, item.faces)
    if ball is not None:
        return _measured(item, (_around(ball),), ball, depth)
    solid = _solid(item.vertices, item.faces)
    if solid is None:  # nothing to cut: the hull is the best that is certain to contain the item
        found = [hull_of(item.vertices).vertices]
    else:
        found = split_solid(solid.simplify(INWARD / 2), depth, _flat_sides(item))
    limit = max(MAX_VERTICES, VERTEX_BUDGET // len(found))
    return _measured(item, tuple(fewer_vertices(p, limit, INWARD) for p in found), None, depth)


def envelope(item: Item, parts: ConvexParts) -> Item:
    """The union of an item's mesh and its parts, with the mass properties of the real mesh.

    Args:
        item: the item.
        parts: its convex parts.

    Returns:
        The item with a closed surface that contains mesh and parts, up to :data:`SLIVER`, without cavities.
        Name, file, volume, mass, centre of mass and inertia stay; the hash is that of the new surface. Where
        the parts are exact, the item itself.

    Raises:
        MeshError: mesh and parts cannot be united.
    """
    import manifold3d

    if parts.bulge <= 1e-6:
        return item
    solid = _solid(item.vertices, item.faces)
    if solid is None:
        raise MeshError(f"item {item.name}: its mesh cannot be united with its convex parts; repair the mesh")
    # Flush surfaces would leave slivers, whose normals mislead every test for inside. So the parts are made
    # larger by next to nothing, and the union forgets the solids it came from, or it would keep their seams.
    hulls = [manifold3d.Manifold.hull_points(_swollen(p)) for p in parts.parts]
    union = manifold3d.Manifold.batch_boolean([solid, *hulls], manifold3d.OpType.Add)
    bodies = [b for b in union.as_original().simplify(SLIVER).decompose() if b.volume() > 0]
    mesh = manifold3d.Manifold.compose(bodies).to_mesh64()
    vertices = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    faces = np.array(mesh.tri_verts, dtype=np.int64)
    return replace(item, vertices=vertices, faces=faces, sha256=mesh_hash(vertices, faces))


def _swollen(part: FloatArray) -> FloatArray:
    outward = part - part.mean(axis=0)
    larger: FloatArray = part + outward * (2 * SLIVER / np.linalg.norm(outward, axis=1, keepdims=True))
    return larger


def _solid(vertices: FloatArray, faces: IntArray):  # type: ignore[no-untyped-def]
    """The mesh as a manifold3d.Manifold, or None where it is not one."""
    import manifold3d

    points, corners = np.array(vertices, np.float64, order="C"), np.array(faces, np.uint64, order="C")
    solid = manifold3d.Manifold(manifold3d.Mesh64(points, corners))
    return solid if solid.status() == manifold3d.Error.NoError and not solid.is_empty() else None


def _measured(
    item: Item, parts: tuple[FloatArray, ...], ball: Ball | None, depth: OutsideDepth
) -> ConvexParts:
    hulls = [hull_of(p) for p in parts]
    samples = np.concatenate([surface_points(h, _SAMPLE) for h in hulls])
    quick = depth.quick(samples)
    # Exact distances are expensive, and only those that may be the largest are of use.
    bulge = float(depth.exact(samples[quick >= quick.max() - _DOUBT]).max())
    points = np.concatenate([item.vertices, item.vertices[item.faces].mean(axis=1)])
    boxes = np.array([[*h.vertices.min(axis=0), *h.vertices.max(axis=0)] for h in hulls])
    starts = np.cumsum([0, *(len(h.planes) for h in hulls)])
    dent = _deepest_outside(points, np.concatenate([h.planes for h in hulls]), starts, boxes)
    return ConvexParts(parts, ball, max(0.0, bulge), dent)


@compiled
def _deepest_outside(points, planes, starts, boxes):  # type: ignore[no-untyped-def]
    """The largest distance of a point from all of several hulls, by their planes; 0 where all are inside.

    Args:
        points: (n, 3), m.
        planes: (p, 4) of all hulls.
        starts: (h + 1,) where those of each hull begin.
        boxes: (h, 6) smallest x, y, z and largest x, y, z of each hull, m.
    """
    deepest = 0.0
    last = 0
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        nearest = np.inf
        for turn in range(len(boxes)):
            # The hull that its neighbour is in comes first. No point that is in one can be the deepest.
            hull = (last + turn) % len(boxes)
            away = max(
                max(boxes[hull, 0] - x, x - boxes[hull, 3]),
                max(boxes[hull, 1] - y, y - boxes[hull, 4]),
                max(boxes[hull, 2] - z, z - boxes[hull, 5]),
            )
            for p in range(starts[hull], starts[hull + 1]):
                if away >= nearest:
                    break
                away = max(away, planes[p, 0] * x + planes[p, 1] * y + planes[p, 2] * z + planes[p, 3])
            if away < nearest:
                nearest = away
                if nearest <= deepest:
                    last = hull
                    break
        deepest = max(deepest, nearest)
    return deepest


def _around(ball: Ball) -> FloatArray:
    """Vertices of a polyhedron that contains the ball and reaches at most 0.1 mm out of it."""
    import manifold3d

    segments = 8
    while True:
        mesh = manifold3d.Manifold.sphere(1.0, segments).to_mesh64()
        hull = hull_of(np.array(mesh.vert_properties[:, :3], dtype=np.float64))
        scale = ball.radius / float(-hull.planes[:, 3].max())
        if scale - ball.radius <= 1e-4 or segments >= 128:
            return ball.centre + scale * hull.vertices
        segments += 8


def _flat_sides(item: Item) -> FloatArray:
    """(k, 3) unit normals, up to three, of the directions that much of the surface faces; may be none."""
    corner = item.vertices[item.faces]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    areas = np.linalg.norm(cross, axis=1)
    normals = cross / np.maximum(areas, 1e-30)[:, None]
    found: list[FloatArray] = []
    total, left = areas.sum(), areas.copy()
    for _ in range(3):
        cells = np.round(normals * 8).astype(np.int64)
        cells[_flipped(cells)] *= -1
        _, inverse = np.unique(cells, axis=0, return_inverse=True)
        inverse = inverse.reshape(-1)
        first = int(np.bincount(inverse, left).argmax())
        seed = normals[int(np.flatnonzero((inverse == first) & (left > 0))[0])] if left.max() > 0 else None
        if seed is None:
            break
        for _ in range(3):
            like = np.abs(normals @ seed) > 0.985
            signs = np.sign(normals[like] @ seed)
            seed = (normals[like] * (signs * left[like])[:, None]).sum(axis=0)
            seed /= max(float(np.linalg.norm(seed)), 1e-30)
        if left[like].sum() < 0.05 * total:
            break
        found.append(seed)
        left[like] = 0.0
    return np.array(found).reshape(-1, 3)


def _flipped(cells: IntArray) -> IntArray:
    """Which of (n, 3) integer directions have a negative first component that is not 0."""
    first = np.where(cells[:, 0] != 0, cells[:, 0], np.where(cells[:, 1] != 0, cells[:, 1], cells[:, 2]))
    return np.flatnonzero(first < 0)
