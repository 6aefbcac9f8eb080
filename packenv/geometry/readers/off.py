"""OFF (text), with or without colours and normals. It has no unit."""

from __future__ import annotations

import re
from pathlib import Path

from packenv.errors import MeshError
from packenv.geometry.readers.raw import RawMesh, check_counts, integers
from packenv.geometry.readers.rows import Column, Element, read_rows

# Some collections glue the first count to the word: "OFF490 518 0".
_HEADER = re.compile(rb"(?:ST)?C?N?OFF\s*", re.IGNORECASE)


def read_off(path: Path, data: bytes) -> RawMesh:
    """Read an OFF file (text), with or without colours and normals; it has no unit.

    Args:
        path: named in messages.
        data: the file's bytes.

    Returns:
        The mesh, polygons cut into triangles.

    Raises:
        MeshError: no OFF header, fewer lines than its counts announce, or an index out of range.
    """
    head = _HEADER.match(data.lstrip())
    if head is None:
        raise MeshError(f"{path}: not an OFF file, its first word is not OFF")
    rest = data.lstrip()[head.end() :]
    if rest[:6].upper() == b"BINARY":
        raise MeshError(f"{path}: binary OFF is not read; export it as text OFF, PLY or STL")
    rows = [row for line in rest.splitlines() if (row := line.split(b"#", 1)[0].split())]
    if not rows or len(rows[0]) < 2:
        raise MeshError(f"{path}: truncated OFF file, the counts of vertices and faces are missing")
    n_vertices, n_faces = integers(path, rows[0][:2], "the line of counts").tolist()
    check_counts(path, vertices=n_vertices, faces=n_faces)
    if len(rows) <= n_vertices + n_faces:
        raise MeshError(
            f"{path}: truncated, it announces {n_vertices} vertices and {n_faces} faces "
            f"but has {len(rows) - 1} lines of them; export it again"
        )
    # What follows the coordinates and the corners are colours.
    points = [row[:3] for row in rows[1 : n_vertices + 1]]
    polygons = rows[n_vertices + 1 : n_vertices + n_faces + 1]
    sizes = integers(path, [row[0] for row in polygons], "a face").tolist()
    polygons = [row[: max(n, 0) + 1] for n, row in zip(sizes, polygons, strict=True)]
    axes = tuple(Column(axis, "d") for axis in "xyz")
    corners = (Column("vertex_index", "q", "q"),)
    elements = [Element("vertex", n_vertices, axes), Element("face", n_faces, corners)]
    return read_rows(path, elements, [*points, *polygons])
