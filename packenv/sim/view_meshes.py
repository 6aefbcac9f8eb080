"""Items' surfaces as pictures need them: coarse where nobody would see more, with normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from packenv.types import FloatArray, IntArray, Item

_FINE = 1500
"""Meshes of no more faces than this are drawn as they are."""
_CELLS = 56
"""Vertices of finer ones are joined in cells of the longest side over this."""
_SMOOTH = 0.8
"""Cosine of the angle from which on two faces meet in an edge that is seen."""


@dataclass(frozen=True, eq=False)
class ViewMesh:
    """A surface whose every corner has a normal of its own.

    Attributes:
        vertices: (n, 3) mesh frame, m.
        faces: (m, 3) vertex indices, counter-clockwise seen from outside.
        normals: (m, 3, 3) unit, outward, of each face's corners.
    """

    vertices: FloatArray
    faces: IntArray
    normals: FloatArray

    def obj_text(self) -> str:
        """The surface as a Wavefront OBJ file."""
        directions, which = np.unique(
            np.round(self.normals.reshape(-1, 3), 3) + 0.0, axis=0, return_inverse=True
        )
        corners = np.column_stack([self.faces.reshape(-1) + 1, which.reshape(-1) + 1]).reshape(-1, 6)
        lines = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in self.vertices.tolist()]
        lines += [f"vn {x:.3f} {y:.3f} {z:.3f}" for x, y, z in directions.tolist()]
        lines += [f"f {a}//{i} {b}//{j} {c}//{k}" for a, i, b, j, c, k in corners.tolist()]
        return "\n".join(lines) + "\n"


def view_mesh(item: Item) -> ViewMesh:
    """Simplify and shade an item's surface.

    Vertices that share a cell become their mean (Rossignac and Borrel 1993), which moves the surface by no
    more than a cell: 1/56 of the item's longest side.
    """
    vertices, faces = item.vertices, item.faces
    if len(faces) > _FINE:
        vertices, faces = _clustered(vertices, faces)
    return ViewMesh(vertices, faces, _normals(vertices, faces))


def _normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m, 3, 3) mean normal, by area, of the faces around each corner that are not past an edge."""
    corners = vertices[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = _unit(areas)
    # All pairs of corners that share a vertex: corner k is of face k // 3.
    home = faces.reshape(-1)
    by_vertex = np.argsort(home, kind="stable")
    degrees = np.bincount(home, minlength=len(vertices))
    starts = np.cumsum(degrees) - degrees
    partners = degrees[home]
    one = np.repeat(np.arange(len(home)), partners)
    within = np.arange(len(one)) - np.repeat(np.cumsum(partners) - partners, partners)
    other = by_vertex[starts[home[one]] + within]
    alike = (flat[one // 3] * flat[other // 3]).sum(axis=1) > _SMOOTH
    one, other = one[alike], other[alike]
    sums = [np.bincount(one, weights=areas[other // 3, k], minlength=len(home)) for k in range(3)]
    return _unit(np.column_stack(sums)).reshape(-1, 3, 3)


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    units: FloatArray = vectors / np.where(lengths > 0.0, lengths, 1.0)
    return units


def _clustered(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    cell = float(np.ptp(vertices, axis=0).max()) / _CELLS
    keys = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
    _, home, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    home = home.reshape(-1)
    means = np.zeros((len(counts), 3))
    np.add.at(means, home, vertices)
    means /= counts[:, None]
    joined = home[faces]
    distinct = (
        (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    )
    joined = joined[distinct]
    # The two sides of a wall thinner than a cell fall together; one face of each is enough.
    _, first = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
    return means, joined[np.sort(first)]
