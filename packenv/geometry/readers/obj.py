"""Wavefront OBJ: its ``v`` and ``f`` lines. It has no unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.raw import RawMesh, brief, check_counts, numbers
from packenv.geometry.readers.rows import cut


def read_obj(path: Path, data: bytes) -> RawMesh:
    """Read an OBJ file; groups, materials, normals and texture coordinates play no part.

    Args:
        path: named in messages.
        data: the file's bytes.

    Returns:
        The mesh, polygons cut into triangles.

    Raises:
        MeshError: no vertices, a vertex or face line that is damaged, or an index out of range.
    """
    check_counts(path, vertices=data.count(b"\nv "), faces=data.count(b"\nf "))
    coordinates: list[bytes] = []
    corners: list[int] = []
    counts: list[int] = []
    lines = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    for number, text in enumerate(lines, start=1):
        line = text.lstrip()
        kind = line[:2]
        if kind in (b"v ", b"v\t"):
            values = line.split()[1:4]
            if len(values) != 3:
                raise MeshError(
                    f"{path}, line {number}: a vertex needs x y z, here are {len(values)} numbers"
                )
            coordinates += values
        elif kind in (b"f ", b"f\t"):
            face = _face(path, number, line, len(coordinates) // 3)
            corners += face
            counts.append(len(face))
    if not coordinates:
        raise MeshError(f"{path}: not an OBJ file, or an empty one: it has no vertex lines ('v x y z')")
    vertices = numbers(path, coordinates, "a vertex line").reshape(-1, 3)
    # OBJ lets a face name a vertex that comes later, so the range is checked at the end.
    flat = np.array(corners, dtype=np.int64)
    if flat.size and flat.max() >= len(vertices):
        raise MeshError(
            f"{path}: a face names vertex {flat.max() + 1} but the file has {len(vertices)}; "
            "it is damaged or truncated, export it again"
        )
    return cut(path, vertices, np.array(counts, dtype=np.int64), flat)


def _face(path: Path, number: int, line: bytes, n_vertices: int) -> list[int]:
    """Indices from 0 of the face in a line; negative ones count back from the last vertex so far."""
    try:
        raw = [int(corner.split(b"/", 1)[0]) for corner in line.split(b"#", 1)[0].split()[1:]]
    except ValueError:
        text = line[:60].decode("utf-8", "replace").strip()
        raise MeshError(
            f"{path}, line {number}: {text!r} is not a face; it needs vertex numbers, as in 'f 1 2 3'"
        ) from None
    if len(raw) < 3:
        raise MeshError(f"{path}, line {number}: a face needs at least 3 vertices, here are {len(raw)}")
    face = [index - 1 if index > 0 else n_vertices + index for index in raw]
    for index, given in zip(face, raw, strict=True):
        if given == 0 or index < 0 or given > 2**62:
            raise MeshError(
                f"{path}, line {number}: face index {brief(given)} is out of range, "
                f"the {n_vertices} vertices up to here are 1 to {n_vertices} or -1 to -{n_vertices}"
            )
    return face
