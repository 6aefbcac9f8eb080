"""The paper's rule for contacts (Sec. III-A), for comparison: scale by 1.03, take what meets, merge in cells.

The enlargement depends on an item's size, normals at the edges of patches are unreliable, and merging draws
the hull of contacts inwards, so :mod:`packenv.planning.stability.contacts` is what the planner uses.
"""

from __future__ import annotations

from collections.abc import Sequence

import fcl
import numpy as np

from packenv.geometry.collision import BoundedCache, Surface
from packenv.geometry.distance_grids import SurfaceField
from packenv.planning.stability.contacts import Body, join, no_contacts
from packenv.types import BoolArray, Contacts, Container, FloatArray, Pose

_FCL_CONTACTS = 20_000
_SURFACES: BoundedCache[tuple[SurfaceField, Surface]] = BoundedCache(32)


def paper_contacts(
    new: Body,
    others: Sequence[Body],
    container: Container,
    *,
    index: int,
    scale: float = 1.03,
    cell: float = 0.01,
) -> Contacts:
    """The paper's rule (Sec. III-A), for comparison: scale, take what overlaps, merge in cells.

    Every item is scaled about its centre of volume; python-fcl says where the triangles of two scaled items
    meet and which way; vertices that the scaling takes through a wall or the floor touch it. Contacts of one
    pair in one cell become their mean. Overlap depth is unknown, so ``gaps`` are 0.

    Args:
        new: the item.
        others: items 1 to ``index - 1``, in packing sequence.
        container: the box.
        index: number of ``new`` in the packing sequence, from 1.
        scale: the paper's 1.03.
        cell: edge of the cells, m.

    Returns:
        Contacts as from :func:`item_contacts`.
    """
    if index != len(others) + 1:
        raise ValueError(f"index is {index}, give {len(others) + 1}: one more than the items before it")
    surface = _scaled(new.field, scale)
    parts = []
    placed = surface.vertices @ new.rotation.T + new.position
    for axis in range(3):
        for bound, sign in ((0.0, 1.0), (container.size[axis], -1.0)):
            if axis == 2 and sign < 0:
                continue
            points = placed[sign * (placed[:, axis] - bound) <= 0.0]
            points[:, axis] = bound
            parts.append(_merged(points, np.tile(np.eye(3)[axis] * sign, (len(points), 1)), 0, index, cell))
    pose = Pose(new.rotation, new.position)
    for i, other in enumerate(others):
        points, normals = _meeting_triangles(
            _scaled(other.field, scale), Pose(other.rotation, other.position), surface, pose
        )
        parts.append(_merged(points, normals, i + 1, index, cell))
    return join(parts)


def _scaled(field: SurfaceField, scale: float) -> Surface:
    """The field's surface, scaled about its centre of volume."""

    def make() -> Surface:
        a, b, c = (field.vertices[field.faces[:, k]] for k in range(3))
        volumes = np.einsum("ij,ij->i", a, np.cross(b, c))
        centre = ((a + b + c) * volumes[:, None]).sum(axis=0) / (4.0 * volumes.sum())
        return Surface(centre + scale * (field.vertices - centre), field.faces.astype(np.int64))

    # An id may be used again once its field is gone, so the field is kept beside its surface.
    kept = _SURFACES.get((id(field), scale), lambda: (field, make()), lambda pair: pair[0] is field)
    return kept[1]


def _meeting_triangles(a: Surface, pose_a: Pose, b: Surface, pose_b: Pose) -> tuple[FloatArray, FloatArray]:
    """(k, 3) points where triangles meet and (k, 3) FCL's normals there, from ``a`` into ``b``.

    FCL's own points are no use: they can be any corner of the triangles, on the far side of an item.
    """
    request = fcl.CollisionRequest(num_max_contacts=_FCL_CONTACTS, enable_contact=True)
    result = fcl.CollisionResult()
    fcl.collide(a.posed(pose_a), b.posed(pose_b), request, result)
    normals = np.array([contact.normal for contact in result.contacts]).reshape(-1, 3)
    one = pose_a.apply(a.vertices)[a.faces[[contact.b1 for contact in result.contacts]]]
    two = pose_b.apply(b.vertices)[b.faces[[contact.b2 for contact in result.contacts]]]
    sums, hits = np.zeros((len(one), 3)), np.zeros(len(one))
    for edges, triangles in ((one, two), (two, one)):
        for k in range(3):
            points, crosses = _edge_crossings(edges[:, k], edges[:, (k + 1) % 3], triangles)
            sums[crosses] += points[crosses]
            hits += crosses
    met = hits > 0
    return sums[met] / hits[met, None], normals[met]


def _edge_crossings(
    start: FloatArray, end: FloatArray, triangles: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """(k, 3) where edges cross their triangles' planes, and (k,) whether they do so within the triangle."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    way = end - start
    rise = np.einsum("ij,ij->i", way, normal)
    level = np.abs(rise) < 1e-18
    t = np.einsum("ij,ij->i", a - start, normal) / np.where(level, 1.0, rise)
    points = start + t[:, None] * way
    inside = ~level & (t >= 0.0) & (t <= 1.0)
    for u, v in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("ij,ij->i", np.cross(v - u, points - u), normal) >= 0.0
    return points, inside


def _merged(points: FloatArray, normals: FloatArray, first: int, second: int, cell: float) -> Contacts:
    """The mean of all contacts in each cell; cells whose normals cancel are left out."""
    if not len(points):
        return no_contacts()
    _, label = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_inverse=True)
    label = label.reshape(-1)
    counts = np.bincount(label)
    means = np.stack([np.bincount(label, points[:, k]) for k in range(3)], axis=1) / counts[:, None]
    sums = np.stack([np.bincount(label, normals[:, k]) for k in range(3)], axis=1)
    length = np.linalg.norm(sums, axis=1)
    kept = length > 1e-6 * counts
    n = int(kept.sum())
    return Contacts(
        means[kept],
        sums[kept] / length[kept, None],
        np.full(n, first, np.int64),
        np.full(n, second, np.int64),
        np.zeros(n),
    )
