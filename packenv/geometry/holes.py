"""Small holes in a surface are closed; a large one is an error, for its surface would be invented."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.topology import boundary
from packenv.types import FloatArray, IntArray

SMALL_HOLE = 0.05
"""A hole is closed when it is at most this share of the item's diagonal across ..."""

SMALL_TRIANGLE = 0.25
"""... or when three edges bound it, so that one face is missing, and it is at most this share ..."""

NO_AREA = 1e-9
"""... or when it is a slit: the patch has less than this share of the diagonal squared."""

MAX_CORNERS = 400
"""Corners up to which the least-area cut, which costs their cube, is searched."""


def fill_small_holes(path: Path, vertices: FloatArray, faces: IntArray) -> tuple[IntArray, tuple[str, ...]]:
    """Close every small hole with the least area that its own edge spans; no vertex is added.

    Args:
        path: the mesh file, named in messages.
        vertices: (n, 3), m.
        faces: (m, 3), wound alike, no edge with more than two faces.

    Returns:
        (faces with the patches, repairs).

    Raises:
        MeshError: a hole is too large to be closed without inventing a surface, or has no simple edge.
    """
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    patches: list[IntArray] = []
    refused: list[float] = []
    filled: list[float] = []
    for loop in _loops(path, vertices, boundary(faces)):
        points = vertices[loop]
        across = float(np.linalg.norm(np.ptp(points, axis=0)))
        if len(loop) > MAX_CORNERS:
            refused.append(across)
            continue
        patch = least_area_cut(points)
        a, b, c = (points[patch[:, k]] for k in range(3))
        size = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
        small = across <= (SMALL_TRIANGLE if len(loop) == 3 else SMALL_HOLE) * diagonal
        if small or size <= NO_AREA * diagonal**2:
            patches.append(loop[patch])
            filled.append(across)
        else:
            refused.append(across)
    if refused:
        more = f" (and {len(refused) - 1} more)" if len(refused) > 1 else ""
        raise MeshError(
            f"{path}: has a hole {_mm(max(refused))} across{more}; holes up to {_mm(SMALL_HOLE * diagonal)}, "
            f"{SMALL_HOLE:.0%} of the item's size, are closed on loading: close it in a modelling program"
        )
    word = "hole" if len(filled) == 1 else "holes"
    return np.concatenate([faces, *patches]), (
        f"{len(filled)} {word} closed, up to {_mm(max(filled))} across",
    )


def _loops(path: Path, vertices: FloatArray, edges: IntArray) -> list[IntArray]:
    """The closed rings of boundary edges, against the faces' winding, each vertex once a ring."""
    following: dict[int, list[int]] = {}
    for start, end in edges.tolist():
        following.setdefault(end, []).append(start)
    loops: list[IntArray] = []
    while following:
        walk = [next(iter(following))]
        place = {walk[0]: 0}
        while walk:
            here = walk[-1]
            if here not in following:
                if len(walk) > 1:
                    x, y, z = vertices[here]
                    raise MeshError(
                        f"{path}: the edge of a hole at ({x:.4g}, {y:.4g}, {z:.4g}) m is not a closed ring; "
                        "mend the mesh in a modelling program"
                    )
                break
            there = following[here].pop()
            if not following[here]:
                del following[here]
            if there in place:
                # Rings that touch in a vertex are told apart by closing each as soon as it can be.
                k = place[there]
                loops.append(np.array(walk[k:], dtype=np.int64))
                for gone in walk[k + 1 :]:
                    del place[gone]
                del walk[k + 1 :]
            else:
                place[there] = len(walk)
                walk.append(there)
    return loops


def _mm(length: float) -> str:
    return f"{length * 1000:.3g} mm"


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
