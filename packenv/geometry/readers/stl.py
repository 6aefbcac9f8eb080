"""STL, binary and text. It has neither a unit nor shared vertices."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.raw import RawMesh, check_counts, numbers

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


def read_stl(path: Path, data: bytes) -> RawMesh:
    """Read an STL file.

    Normals are not read: the corners' order says which side is outside.

    Args:
        path: named in messages.
        data: the file's bytes.

    Returns:
        The triangles, three vertices of its own each.

    Raises:
        MeshError: the number of triangles and the length of the file do not agree, or the text breaks off.
    """
    announced = struct.unpack_from("<I", data, 80)[0] if len(data) >= _HEADER else 0
    whole = len(data) == _HEADER + _RECORD.itemsize * announced
    # Binary files may begin with the word "solid" too, so the length decides first.
    if not whole and data[:512].lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096].lower():
        return _read_text(path, data)
    return _read_binary(path, data, announced)


def _read_binary(path: Path, data: bytes, announced: int) -> RawMesh:
    if len(data) < _HEADER:
        raise MeshError(
            f"{path}: {len(data)} bytes are too few for an STL file; it is truncated or something else"
        )
    expected = _HEADER + _RECORD.itemsize * announced
    if len(data) < expected:
        raise MeshError(
            f"{path}: not an STL file, or truncated: its header announces {announced:,} triangles, "
            f"{expected:,} bytes, and the file has {len(data):,}; export it again"
        )
    check_counts(path, faces=announced)
    extra = len(data) - expected
    records = np.frombuffer(data, _RECORD, count=announced, offset=_HEADER)
    vertices = records["corners"].reshape(-1, 3).astype(np.float64)
    notes = (f"{extra} bytes after the last triangle were ignored",) if extra else ()
    return RawMesh(vertices, _own_corners(announced), split=True, notes=notes)


def _read_text(path: Path, data: bytes) -> RawMesh:
    lower = data.lower()
    facets = lower.count(b"endfacet")
    check_counts(path, faces=facets)
    corners = _VERTEX.findall(data)
    opened = lower.count(b"facet") - 2 * facets
    if opened != 0 or len(corners) != 3 * facets or b"endsolid" not in lower[-1024:]:
        raise MeshError(
            f"{path}: truncated or damaged text STL: {len(corners)} vertices for {facets} finished facets, "
            "each facet has 3 and the file ends with 'endsolid'; export it again"
        )
    flat = numbers(path, [token for corner in corners for token in corner], "a vertex")
    return RawMesh(flat.reshape(-1, 3), _own_corners(facets), split=True)


def _own_corners(n_faces: int) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    return np.arange(3 * n_faces, dtype=np.int64).reshape(-1, 3)
