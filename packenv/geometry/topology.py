"""Which faces share an edge, and what follows from it: closed, wound alike, how many bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packenv.types import BoolArray, FloatArray, IntArray


def directed_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """(3m,) from and to: the edges of all faces, along their winding, face after face."""
    return faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)


def is_solid(faces: IntArray) -> tuple[bool, bool]:
    """Whether every edge is passed as often one way as the other: the boundary of a solid.

    Returns:
        (closed and wound alike, some edge is passed twice the same way). The second is False for a
        plain manifold.
    """
    start, end = directed_edges(faces)
    n = int(faces.max()) + 1
    there, back = np.sort(start * n + end), np.sort(end * n + start)
    return bool(np.array_equal(there, back)), bool((there[1:] == there[:-1]).any())


def open_edges(faces: IntArray) -> int:
    """Number of edges with an odd number of faces: 0 for the boundary of a solid, however it is wound."""
    _, counts = _undirected(faces)
    return int((counts % 2 == 1).sum())


def crowded_edge(faces: IntArray) -> tuple[int, int] | None:
    """An edge where three, five ... faces meet, as its two vertices, or None."""
    keys, counts = _undirected(faces)
    crowded = np.flatnonzero((counts % 2 == 1) & (counts > 2))
    if crowded.size == 0:
        return None
    first, second = divmod(int(keys[crowded[0]]), int(faces.max()) + 1)
    return first, second


def boundary(faces: IntArray) -> IntArray:
    """(k, 2) edges that one face only has, along that face's winding."""
    start, end = directed_edges(faces)
    n = int(faces.max()) + 1
    _, inverse, counts = np.unique(
        np.minimum(start, end) * n + np.maximum(start, end), return_inverse=True, return_counts=True
    )
    single = counts[inverse.reshape(-1)] == 1
    return np.stack([start[single], end[single]], axis=1)


def body_labels(faces: IntArray) -> IntArray:
    """(m,) number of the body that each face belongs to, counted in the sequence of the faces.

    Faces are of one body when an edge that only they share links them. Bodies that touch in a vertex or
    in an edge of four faces stay two, so that each can be turned on its own.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    m = len(faces)
    one, two = _face_pairs(faces)
    graph = coo_matrix((np.ones(len(one), dtype=np.int8), (one // 3, two // 3)), shape=(m, m))
    _, labels = connected_components(graph, directed=False)
    if not labels.any():
        return np.zeros(m, dtype=np.int64)
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    return rank[inverse.reshape(-1)]


def faces_to_turn(faces: IntArray) -> BoolArray | None:
    """Find the faces that are wound against their neighbours.

    Every face stands twice in a graph, as it is and turned; neighbours are linked in the states that
    agree. The two halves of the graph are the two ways to wind a surface.

    Args:
        faces: (m, 3).

    Returns:
        (m,) True for the smaller share of each connected surface; None for a one-sided surface, which
        cannot be wound alike.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    m = len(faces)
    start, _ = directed_edges(faces)
    one, two = _face_pairs(faces)
    agree = start[one] != start[two]
    f, g = one // 3, two // 3
    rows = np.concatenate([f, f + m])
    columns = np.concatenate([np.where(agree, g, g + m), np.where(agree, g + m, g)])
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * m, 2 * m))
    _, labels = connected_components(graph, directed=False)
    kept, turned = labels[:m], labels[m:]
    if (kept == turned).any():
        return None
    turn: BoolArray = kept > turned
    surface = np.minimum(kept, turned)
    share = np.bincount(surface, weights=turn) / np.maximum(np.bincount(surface), 1)
    result: BoolArray = turn ^ (share[surface] > 0.5)
    return result


def merge_equal(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray, int]:
    """Make vertices with equal coordinates one; faces that lose a corner by it go.

    Returns:
        (vertices, faces, number of vertices that went). The vertices keep the sequence of their first.
    """
    points = np.ascontiguousarray(vertices) + 0.0  # -0.0 and 0.0 are one place but differ in bytes
    rows = points.view(np.dtype((np.void, points.dtype.itemsize * 3))).reshape(-1)
    _, first, inverse = np.unique(rows, return_index=True, return_inverse=True)
    return _renumbered(vertices, faces, first[inverse.reshape(-1)])


def merge_close(vertices: FloatArray, faces: IntArray, distance: float) -> tuple[FloatArray, IntArray, int]:
    """Make vertices within a distance one; faces that lose a corner by it go.

    Returns:
        (vertices, faces, number of vertices that went).
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(vertices).query_pairs(distance, output_type="ndarray")
    n = len(vertices)
    graph = coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, labels = connected_components(graph, directed=False)
    _, first = np.unique(labels, return_index=True)
    return _renumbered(vertices, faces, first[labels])


def compact(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Leave out vertices that no face names."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.reshape(-1)] = True
    if used.all():
        return vertices, faces
    number = np.cumsum(used) - 1
    return vertices[used], number[faces]


def without_repeats(faces: IntArray) -> IntArray:
    """Faces that have three different corners."""
    a, b, c = faces.T
    good = (a != b) & (b != c) & (c != a)
    return faces if good.all() else faces[good]


def _face_pairs(faces: IntArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The two directed edges, as their numbers, of every edge that exactly two faces share."""
    start, end = directed_edges(faces)
    keys = np.minimum(start, end) * (int(faces.max()) + 1) + np.maximum(start, end)
    order = np.argsort(keys, kind="stable")
    new = np.flatnonzero(np.diff(keys[order], prepend=-1, append=-1))
    pairs = new[:-1][np.diff(new) == 2]
    return order[pairs], order[pairs + 1]


def _undirected(faces: IntArray) -> tuple[IntArray, NDArray[np.int64]]:
    start, end = directed_edges(faces)
    n = int(faces.max()) + 1
    keys, counts = np.unique(np.minimum(start, end) * n + np.maximum(start, end), return_counts=True)
    return keys, counts


def _renumbered(
    vertices: FloatArray, faces: IntArray, representative: NDArray[np.integer]
) -> tuple[FloatArray, IntArray, int]:
    gone = int((representative != np.arange(len(vertices))).sum())
    if gone == 0:
        return vertices, faces, 0
    merged_vertices, merged_faces = compact(vertices, without_repeats(representative[faces].astype(np.int64)))
    return merged_vertices, merged_faces, gone
