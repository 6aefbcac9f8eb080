"""From point clouds to convex parts and the one solid that they make together.

Coordinates are whole micrometres while the geometry is made: a decimal with six places names such a number
in metres exactly, so the parts file holds the very solids that the mesh is the union of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
from numpy.typing import NDArray

from .solids import Points

MICRO_PER_MM = 1000.0
#: What the union leaves of nearly equal surfaces is flattened as long as it moves nothing by more, um.
SLIVER_TOLERANCE = 0.1
#: A solid smaller than this is a trace of rounding where two parts touch, um3.
DUST_VOLUME = 1e3


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed triangle mesh.

    Attributes:
        vertices: (n, 3) float64, m.
        faces: (m, 3) int64, counter-clockwise from outside.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Geometry:
    """An item's surface and the convex parts that it is the union of, in one frame (z up, resting on z = 0).

    Attributes:
        mesh: the surface.
        parts: convex solids whose union is the mesh.
    """

    mesh: Solid
    parts: tuple[Solid, ...]


def build(clouds: Sequence[Points]) -> Geometry:
    """Hull every cloud, unite the hulls.

    Args:
        clouds: (n, 3) points of each part, mm.

    Returns:
        Mesh and parts, moved so that the bounding box is centred on the z axis and stands on z = 0.

    Raises:
        ValueError: a cloud is flat, or the union is not one connected solid.
    """
    everything = np.concatenate(clouds)
    low, high = everything.min(axis=0), everything.max(axis=0)
    origin = np.array(((low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, low[2]))
    hulls = []
    for number, cloud in enumerate(clouds):
        points = np.unique(np.rint((cloud - origin) * MICRO_PER_MM), axis=0)
        hull = manifold3d.Manifold.hull_points(points)
        if hull.is_empty() or hull.volume() < 1e6:
            raise ValueError(f"part {number} is flat: its points span no volume of 0.001 mm3")
        hulls.append(hull)
    solids = [
        piece
        for piece in manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add).decompose()
        if abs(piece.volume()) > DUST_VOLUME
    ]
    if len(solids) != 1:
        raise ValueError(f"the parts make {len(solids)} solids or enclose a void, they must make one solid")
    # As an original its faces forget which part they came from, so that seams can be flattened too.
    vertices, faces = _arrays(solids[0].as_original().simplify(SLIVER_TOLERANCE))
    return Geometry(
        _metres(*_weld(vertices, faces, SLIVER_TOLERANCE)), tuple(_metres(*_arrays(h)) for h in hulls)
    )


def _arrays(solid: manifold3d.Manifold) -> tuple[Points, NDArray[np.int64]]:
    """Vertices and faces of a solid."""
    mesh = solid.to_mesh64()
    return np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3], np.asarray(
        mesh.tri_verts, dtype=np.int64
    )


def _weld(vertices: Points, faces: NDArray[np.int64], shortest: float) -> tuple[Points, NDArray[np.int64]]:
    """Collapse edges shorter than ``shortest``, shortest first, wherever the surface stays a manifold."""
    while True:
        edges = np.concatenate((faces[:, :2], faces[:, 1:], faces[:, ::2]))
        edges = np.unique(np.sort(edges, axis=1), axis=0)
        lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
        short = edges[lengths < shortest][np.argsort(lengths[lengths < shortest], kind="stable")]
        for keep, drop in short:
            around = [set(faces[(faces == v).any(axis=1)].ravel().tolist()) - {v} for v in (keep, drop)]
            if len(around[0] & around[1]) == 2:
                faces = faces[~((faces == keep).any(axis=1) & (faces == drop).any(axis=1))]
                faces = np.where(faces == drop, keep, faces)
                break
        else:
            used, index = np.unique(faces, return_inverse=True)
            return vertices[used], index.reshape(faces.shape)


def _metres(vertices: Points, faces: NDArray[np.int64]) -> Solid:
    """Vertices in metres and faces, both in an order that depends on the shape alone."""
    order = np.lexsort((vertices[:, 2], vertices[:, 1], vertices[:, 0]))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    faces = rank[faces]
    first = np.argmin(faces, axis=1)
    faces = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    faces = faces[np.lexsort((faces[:, 2], faces[:, 1], faces[:, 0]))]
    return Solid(vertices[order] / 1e6, faces)
