"""Points and polygons as text: OBJ, OFF and text PLY. None of them has a unit."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.raw import RawMesh, brief, check_counts, check_indices, read_mesh
from packenv.types import FloatArray, IntArray

Words = Sequence[bytes]

_DENT = -1e-6
"""Share of a polygon's area that may lie the wrong way round: corners on one line are no dent."""

# Some collections glue the first count to the word: "OFF490 518 0".
_OFF = re.compile(rb"\s*(?:ST)?C?N?OFF\s*", re.IGNORECASE)


def read_off(data: bytes) -> RawMesh:
    """Read an OFF file (text), with or without colours and normals.

    Raises:
        MeshError: no OFF header, fewer lines than its counts announce, or what :func:`read_polygons` refuses.
    """
    head = _OFF.match(data)
    rest = data[head.end() :] if head else b""
    if head is None or rest[:6].upper() == b"BINARY":
        raise MeshError("not a text OFF file; export it as text OFF, PLY or STL")
    rows = (words for line in rest.splitlines() if (words := line.split(b"#", 1)[0].split()))
    n_vertices, n_faces = (int(word) for word in [*next(rows, ()), b"-1", b"-1"][:2])
    check_counts(vertices=n_vertices, faces=n_faces)
    # What follows the coordinates and the corners are colours.
    points = [row[:3] for row in itertools.islice(rows, n_vertices)]
    faces = [[int(word) for word in take(row, 0)[0]] for row in itertools.islice(rows, n_faces)]
    if (len(points), len(faces)) != (n_vertices, n_faces):
        raise MeshError(
            f"truncated, it announces {n_vertices:,} vertices and {n_faces:,} faces "
            f"and {len(points):,} and {len(faces):,} are there; export it again"
        )
    return read_polygons(points, faces)


def read_obj(data: bytes) -> RawMesh:
    """Read the ``v`` and ``f`` lines of an OBJ file; materials, normals and textures play no part.

    Raises:
        MeshError: no vertices, or what :func:`read_polygons` refuses.
    """
    check_counts(vertices=data.count(b"\nv "), faces=data.count(b"\nf "))
    points: list[Words] = []
    faces: list[list[int]] = []
    for line in data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines():
        words = line.split(b"#", 1)[0].split()
        if words[:1] == [b"v"]:
            points.append(words[1:4])
        elif words[:1] == [b"f"]:
            numbers = [int(corner.split(b"/", 1)[0]) for corner in words[1:]]
            # Counted from 1; from -1 back from the last vertex so far.
            if 0 in numbers or min(numbers, default=0) < -len(points):
                raise MeshError(f"a face index of {brief(min(numbers))}, it is damaged; export it again")
            faces.append([k - 1 if k > 0 else len(points) + k for k in numbers])
    if not points:
        raise MeshError("not an OBJ file, or an empty one: it has no vertex lines ('v x y z')")
    return read_polygons(points, faces)


def take(row: Words, at: int) -> tuple[Words, int]:
    """The list that begins at a word of a row with its length, and where the row goes on.

    Raises:
        ValueError: the row ends before the list does.
    """
    end = at + 1 + int(row[at])
    if not at < end <= len(row):
        raise ValueError(f"{len(row)} numbers in a row where at least {end} belong")
    return row[at + 1 : end], end


def read_polygons(points: Sequence[Words], polygons: Sequence[Sequence[int]]) -> RawMesh:
    """Have trimesh read points and polygons, in the one form of text that it reads strictly.

    Args:
        points: three words each.
        polygons: the corners of each, counted from 0.

    Raises:
        MeshError: a word is no number, a polygon has fewer than 3 corners, one outside the points, or a dent.
    """
    counts = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    if any(len(point) != 3 for point in points) or (counts < 3).any():
        raise MeshError("damaged, a vertex needs 3 numbers and a face 3 vertices; export it again")
    n_faces = int((counts - 2).sum())
    check_counts(vertices=len(points), faces=n_faces)
    check_indices(np.fromiter(itertools.chain.from_iterable(polygons), np.int64), len(points))
    fans = (b"3 %d %d %d" % (p[0], b, c) for p in polygons for b, c in itertools.pairwise(p[1:]))
    rows = [b"OFF\n%d %d 0" % (len(points), n_faces), *map(b" ".join, points), *fans]
    raw = read_mesh("off", b"\n".join(rows), len(points), n_faces)
    refuse_dents(raw.vertices, raw.faces, counts - 2)
    return raw


def refuse_dents(vertices: FloatArray, faces: IntArray, counts: IntArray) -> None:
    """Refuse polygons that the fan of triangles from their first corner does not cover once.

    Args:
        vertices: (n, 3).
        faces: (m, 3), fan after fan.
        counts: (p,) triangles of each fan, at least 1.

    Raises:
        MeshError: a triangle of a fan lies the other way round than the polygon.
    """
    if (counts > 1).any():
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        whole = np.repeat(np.add.reduceat(normals, np.cumsum(counts) - counts), counts, axis=0)
        dents = int(((normals * whole).sum(axis=1) < _DENT * (whole * whole).sum(axis=1)).sum())
        if dents:
            raise MeshError(f"{dents} dented (non-convex) faces; triangulate the mesh when exporting")
