"""Points on a triangle surface with its normals there, dense enough that no contact falls between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packenv.kernels import compiled
from packenv.types import Float32Array, FloatArray, IntArray

FACE, EDGE, CORNER, END = 0, 1, 2, 3
"""Kinds of samples: on a face or smooth vertex, a sharp convex edge, a sharp vertex, an edge end."""

SHARP = float(np.cos(np.radians(30.0)))
"""Faces whose normals' product is below this meet in a sharp edge."""

_BLOCK = 0.009
_COVERED = 0.6  # share of the way to the next edge sample that a sample stands for; above half
_EDGE_SPACING = 0.5  # sharp samples of a noisy mesh may be this much of the spacing apart, not more


class Topology(NamedTuple):
    """Normals and neighbours of a surface.

    Attributes:
        normals: (m, 3) unit.
        neighbours: (m, 3) int32, the face across the edge from corner e to e + 1; -1 where there is not one.
        vertex_normals: (n, 3) unit, weighted by the faces' angles; zero where they cancel.
        sharp_vertices: (n,) bool, where some face is more than 30° off the vertex normal.
    """

    normals: FloatArray
    neighbours: NDArray[np.int32]
    vertex_normals: FloatArray
    sharp_vertices: NDArray[np.bool_]


class Samples(NamedTuple):
    """Surface samples in blocks.

    Attributes:
        records: (k, 12) float32: point, outward normal, the other face's normal, and the way along the sharp
            edge that the sample stands for, a bit more than half of that to the next sample; from an end it
            leads into the edge. On a face both normals are equal and there is no way. m, mesh frame.
        kinds: (k,) uint8: :data:`FACE`, :data:`EDGE`, :data:`CORNER` or :data:`END`.
        starts: (b + 1,) int64, first record of each block.
        spheres: (b, 4) float64, centre and radius of each block, m.
    """

    records: Float32Array
    kinds: NDArray[np.uint8]
    starts: IntArray
    spheres: FloatArray


def surface_topology(vertices: FloatArray, faces: IntArray) -> Topology:
    """Work out normals and neighbours.

    Args:
        vertices: (n, 3) m, no two equal.
        faces: (m, 3), none without area.
    """
    corner = vertices[faces]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normals = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ordered = np.sort(edges, axis=1)
    key = ordered[:, 0] * len(vertices) + ordered[:, 1]
    order = np.argsort(key, kind="stable")
    twin = key[order][1:] == key[order][:-1]
    # Runs of exactly two: an edge with one face or with more has no neighbour across it.
    alone_before = np.concatenate([[True], ~twin])[:-1]
    alone_after = np.concatenate([~twin, [True]])[1:]
    pair = np.flatnonzero(twin & alone_before & alone_after)
    a, b = order[pair], order[pair + 1]
    neighbours = np.full(len(edges), -1, np.int32)
    neighbours[a], neighbours[b] = b // 3, a // 3

    sums = np.zeros_like(vertices)
    for c in range(3):
        u = corner[:, (c + 1) % 3] - corner[:, c]
        v = corner[:, (c + 2) % 3] - corner[:, c]
        angle = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))
        np.add.at(sums, faces[:, c], normals * angle[:, None])
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    vertex_normals = np.divide(sums, length, out=np.zeros_like(sums), where=length > 1e-9)
    least = np.ones(len(vertices))
    along = np.einsum("mij,mj->mi", vertex_normals[faces], normals)
    np.minimum.at(least, faces.ravel(), along.ravel())
    return Topology(normals, neighbours.reshape(-1, 3), vertex_normals, least < SHARP)


def sample_surface(vertices: FloatArray, faces: IntArray, topology: Topology, spacing: float) -> Samples:
    """Sample faces, vertices and sharp convex edges; the same mesh always gives the same samples.

    A box that stands on an edge or a corner touches there and nowhere else, so sharp edges are sampled with
    both faces' normals and every vertex is a sample, as far as the spacing allows it.

    Args:
        vertices: (n, 3) m, no two equal.
        faces: (m, 3), none without area.
        topology: from :func:`surface_topology`.
        spacing: m; on a fine mesh no two face samples with like normals share a cube of this size.
    """
    edge_records, edge_kinds = _edge_samples(vertices, faces, topology, spacing)
    used = np.unique(faces)
    points, n = vertices[used], topology.vertex_normals[used]
    sharp = topology.sharp_vertices[used]
    no_edge = np.zeros((len(used), 3))
    vertex_records = np.concatenate([points, n, n, no_edge], axis=1)
    counts = _face_counts(vertices, faces, spacing)
    face_records = np.zeros((int(counts.sum()), 12))
    _fill_faces(vertices, faces, topology.normals, spacing, face_records)

    features = _thinned(
        np.concatenate([edge_records, vertex_records[sharp]]),
        np.concatenate([edge_kinds, np.full(int(sharp.sum()), CORNER)]),
        spacing * _EDGE_SPACING,
    )
    smooth = np.concatenate([vertex_records[~sharp], face_records])
    plain = _thinned(smooth, np.full(len(smooth), FACE), spacing)
    records = np.concatenate([features[0], plain[0]])
    kinds = np.concatenate([features[1], plain[1]])
    return _in_blocks(records, kinds)


def _edge_samples(
    vertices: FloatArray, faces: IntArray, topology: Topology, spacing: float
) -> tuple[FloatArray, IntArray]:
    """(k, 12) records on sharp convex edges and their kinds, edge ends first."""
    f, e = np.nonzero(np.ones_like(faces, bool))
    g = topology.neighbours[f, e].astype(np.int64)
    # Each edge once; an edge with no one neighbour is a border, sharp by itself.
    keep = (g < 0) | (f < g)
    f, e, g = f[keep], e[keep], g[keep]
    other = np.where(g < 0, f, g)
    n1, n2 = topology.normals[f], topology.normals[other]
    start, end = vertices[faces[f, e]], vertices[faces[f, (e + 1) % 3]]
    # In the neighbour, whichever corner is farthest from this face's plane is the one off the edge.
    height = np.einsum("kij,kj->ki", vertices[faces[other]] - start[:, None, :], n1)
    convex = height.min(axis=1) + height.max(axis=1) < 0.0
    sharp = (g < 0) | ((np.einsum("ij,ij->i", n1, n2) < SHARP) & convex)
    start, end, n1, n2 = start[sharp], end[sharp], n1[sharp], n2[sharp]
    way = end - start
    length = np.linalg.norm(way, axis=1)
    pieces = np.ceil(length / spacing).astype(np.int64)
    covered = way * (_COVERED / pieces)[:, None]
    rows = [np.stack([start, end], axis=1).reshape(-1, 3)]
    picked = [np.repeat(np.arange(len(start)), 2)]
    inner = np.repeat(np.arange(len(start)), pieces - 1)
    first = np.repeat(np.cumsum(pieces - 1) - (pieces - 1), pieces - 1)
    step = (np.arange(len(inner)) - first + 1) / pieces[inner]
    rows.append(start[inner] + way[inner] * step[:, None])
    picked.append(inner)
    of = np.concatenate(picked)
    along = covered[of]
    along[1 : 2 * len(start) : 2] *= -1.0
    kinds = np.full(len(of), EDGE)
    kinds[: 2 * len(start)] = END
    return np.concatenate([np.concatenate(rows), n1[of], n2[of], along], axis=1), kinds


@compiled
def _rows_of_face(vertices, faces, f, spacing):  # type: ignore[no-untyped-def]
    """Longest edge (its first corner), its length, and the height above it, m; and the number of rows."""
    best, longest = 0, -1.0
    for e in range(3):
        d = vertices[faces[f, (e + 1) % 3]] - vertices[faces[f, e]]
        length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        if length > longest:
            best, longest = e, length
    a = vertices[faces[f, best]]
    u = (vertices[faces[f, (best + 1) % 3]] - a) / longest
    w = vertices[faces[f, (best + 2) % 3]] - a
    along = w[0] * u[0] + w[1] * u[1] + w[2] * u[2]
    height = np.sqrt(max(0.0, w[0] * w[0] + w[1] * w[1] + w[2] * w[2] - along * along))
    return best, longest, max(1, int(np.ceil(height / spacing)))


@compiled
def _face_counts(vertices, faces, spacing):  # type: ignore[no-untyped-def]
    """(m,) samples that each face gets."""
    counts = np.zeros(len(faces), np.int64)
    for f in range(len(faces)):
        _, longest, rows = _rows_of_face(vertices, faces, f, spacing)
        for r in range(rows):
            counts[f] += max(1, int(np.ceil(longest * (1.0 - (r + 0.5) / rows) / spacing)))
    return counts


@compiled
def _fill_faces(vertices, faces, normals, spacing, records):  # type: ignore[no-untyped-def]
    """Rows of samples parallel to each face's longest edge, at most the spacing apart both ways."""
    k = 0
    for f in range(len(faces)):
        best, longest, rows = _rows_of_face(vertices, faces, f, spacing)
        a, b = vertices[faces[f, best]], vertices[faces[f, (best + 1) % 3]]
        c = vertices[faces[f, (best + 2) % 3]]
        for r in range(rows):
            t = (r + 0.5) / rows
            columns = max(1, int(np.ceil(longest * (1.0 - t) / spacing)))
            for q in range(columns):
                s = (q + 0.5) / columns * (1.0 - t)
                for axis in range(3):
                    records[k, axis] = a[axis] + s * (b[axis] - a[axis]) + t * (c[axis] - a[axis])
                    records[k, 3 + axis] = normals[f, axis]
                    records[k, 6 + axis] = normals[f, axis]
                k += 1


def _thinned(records: FloatArray, kinds: IntArray, size: float) -> tuple[FloatArray, NDArray[np.uint8]]:
    """The first record in every cube for each pair of the normals' main directions."""
    cell = np.floor((records[:, :3] - records[:, :3].min(axis=0, initial=0.0)) / size).astype(np.int64)
    key = (cell[:, 0] * 4096 + cell[:, 1]) * 4096 + cell[:, 2]
    for normal in (records[:, 3:6], records[:, 6:9]):
        axis = np.abs(normal).argmax(axis=1)
        key = key * 6 + axis * 2 + (normal[np.arange(len(normal)), axis] < 0)
    key = key * 4 + kinds
    first = np.sort(np.unique(key, return_index=True)[1])
    return records[first], kinds[first].astype(np.uint8)


def _in_blocks(records: FloatArray, kinds: NDArray[np.uint8]) -> Samples:
    """Sort the records by cubes and put a sphere around the records of each cube."""
    cell = np.floor((records[:, :3] - records[:, :3].min(axis=0)) / _BLOCK).astype(np.int64)
    key = (cell[:, 0] * 4096 + cell[:, 1]) * 4096 + cell[:, 2]
    fine = np.floor((records[:, :3] - records[:, :3].min(axis=0)) / (_BLOCK / 3)).astype(np.int64)
    order = np.lexsort((fine[:, 2], fine[:, 1], fine[:, 0], key))
    records, kinds, key = records[order], kinds[order], key[order]
    starts = np.concatenate([[0], np.flatnonzero(np.diff(key)) + 1, [len(key)]])
    low = np.minimum.reduceat(records[:, :3], starts[:-1], axis=0)
    high = np.maximum.reduceat(records[:, :3], starts[:-1], axis=0)
    spheres = np.concatenate([(low + high) / 2, np.linalg.norm(high - low, axis=1)[:, None] / 2], axis=1)
    spheres[:, 3] += 1e-7  # single precision of the records
    return Samples(records.astype(np.float32), kinds, starts.astype(np.int64), spheres)
