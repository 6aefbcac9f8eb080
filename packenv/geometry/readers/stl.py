"""STL, binary and text, read by trimesh. It has neither a unit nor shared vertices."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.by_trimesh import by_trimesh
from packenv.geometry.readers.raw import RawMesh, check_counts

_HEADER, _RECORD = 84, 50
_NAME = re.compile(rb"solid\b(?:(?!facet\s+normal)[^\r\n])*", re.IGNORECASE)
_VERTEX = re.compile(rb"\bvertex\s+(\S+\s+\S+\s+\S+)", re.IGNORECASE)


def read_stl(path: Path, data: bytes) -> RawMesh:
    """Read an STL file, binary or text; it has neither a unit nor shared vertices.

    Args:
        path: named in messages.
        data: the file's bytes.

    Returns:
        The triangles, three vertices of its own each. Corners say which side is outside, not normals.

    Raises:
        MeshError: the number of triangles and the length of the file do not agree, or the text breaks off.
    """
    notes: tuple[str, ...] = ()
    # Binary files may begin with the word "solid" too, but only they hold zero bytes.
    if data[:512].lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096].lower() and b"\0" not in data:
        faces, data = _stl_text(path, data)
    else:
        if len(data) < _HEADER:
            raise MeshError(
                f"{path}: {len(data)} bytes are too few for an STL file; it is truncated or something else"
            )
        faces = struct.unpack_from("<I", data, 80)[0]
        length = _HEADER + _RECORD * faces
        if len(data) < length:
            raise MeshError(
                f"{path}: not an STL file, or truncated: its header announces {faces:,} triangles, "
                f"{length:,} bytes, and the file has {len(data):,}; export it again"
            )
        check_counts(path, faces=faces)
        extra = len(data) - length
        if extra and extra % _RECORD == 0:
            raise MeshError(
                f"{path}: damaged STL file, its header announces {faces:,} triangles "
                f"and {faces + extra // _RECORD:,} are there; export it again"
            )
        if extra:
            notes = (f"{extra} bytes after the last triangle were ignored",)
        data = data[:length]
    meshes = by_trimesh(path, "stl", data).geometry.values()
    vertices = np.concatenate([np.empty((0, 3)), *(np.asarray(mesh.vertices) for mesh in meshes)])
    corners = np.arange(3 * faces, dtype=np.int64).reshape(-1, 3)
    if len(vertices) != corners.size:
        raise MeshError(f"{path}: damaged, {len(vertices)} vertices for {faces} facets; export it again")
    return RawMesh(vertices, corners, split=True, notes=notes)


def _stl_text(path: Path, data: bytes) -> tuple[int, bytes]:
    """The number of facets, and a text of vertices alone: names may hold any word."""
    text = _NAME.sub(b"solid", data).lower()
    facets = text.count(b"endfacet")
    check_counts(path, faces=facets)
    corners = _VERTEX.findall(text)
    opened = text.count(b"facet") - 2 * facets
    if opened != 0 or len(corners) != 3 * facets or not re.search(rb"end\s*solid", text[-1024:]):
        raise MeshError(
            f"{path}: truncated or damaged text STL: {len(corners)} vertices for {facets} finished facets, "
            "each facet has 3 and the file ends with 'endsolid'; export it again"
        )
    lines = b"".join(b"vertex " + b" ".join(corner.split()) + b"\n" for corner in corners)
    return facets, b"solid\n" + lines + b"endsolid\n"
