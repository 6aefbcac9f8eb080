"""OFF (text), with or without colours and normals. It has no unit."""

from __future__ import annotations

import re
from pathlib import Path

from packenv.errors import MeshError
from packenv.geometry.polygons import triangulated
from packenv.geometry.readers.raw import RawMesh, check_counts, check_indices, check_points, integers, numbers

# Some collections glue the first count to the word: "OFF490 518 0".
_HEADER = re.compile(rb"(?:ST)?C?N?OFF\s*", re.IGNORECASE)


def read_off(path: Path, data: bytes) -> RawMesh:
    """Read an OFF file.

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
    lines = [row for line in rest.splitlines() if (row := line.split(b"#", 1)[0].split())]
    if not lines or len(lines[0]) < 2:
        raise MeshError(f"{path}: truncated OFF file, the counts of vertices and faces are missing")
    n_vertices, n_faces = integers(path, lines[0][:2], "the line of counts").tolist()
    check_counts(path, vertices=n_vertices, faces=n_faces)
    body = lines[1:]
    if len(body) < n_vertices + n_faces:
        raise MeshError(
            f"{path}: truncated, it announces {n_vertices} vertices and {n_faces} faces "
            f"but has {len(body)} lines of them; export it again"
        )
    points = body[:n_vertices]
    if any(len(row) < 3 for row in points):
        raise MeshError(f"{path}: damaged OFF file, a vertex has fewer than 3 coordinates")
    vertices = numbers(path, [token for row in points for token in row[:3]], "a vertex").reshape(-1, 3)

    polygons = body[n_vertices : n_vertices + n_faces]
    counts = integers(path, [row[0] for row in polygons], "a face")
    if any(n < 3 or len(row) <= n for n, row in zip(counts.tolist(), polygons, strict=True)):
        raise MeshError(f"{path}: damaged OFF file, a face has fewer vertices than it announces, or under 3")
    corners = [token for n, row in zip(counts.tolist(), polygons, strict=True) for token in row[1 : n + 1]]
    flat = integers(path, corners, "a face")
    check_indices(path, flat, len(vertices))
    check_points(path, vertices)
    faces = triangulated(path, vertices, counts, flat)
    check_counts(path, faces=len(faces))
    return RawMesh(vertices, faces)
