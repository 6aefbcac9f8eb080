"""STL, binary and text. It has neither a unit nor shared vertices."""

from __future__ import annotations

import dataclasses
import re
import struct

from packenv.errors import MeshError
from packenv.geometry.readers.raw import RawMesh, check_counts, read_mesh

_HEADER, _RECORD = 84, 50
_NAME = re.compile(rb"solid\b(?:(?!facet\s+normal)[^\r\n])*", re.IGNORECASE)
_VERTEX = re.compile(rb"\bvertex\s+(\S+\s+\S+\s+\S+)", re.IGNORECASE)


def read_stl(data: bytes) -> RawMesh:
    """Read an STL file, binary or text; corners say which side is outside, not normals.

    Raises:
        MeshError: the number of triangles and the length of the file do not agree, or the text breaks off.
    """
    notes: tuple[str, ...] = ()
    # Binary files may begin with the word "solid" too, but only they hold zero bytes.
    if data[:512].lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096].lower() and b"\0" not in data:
        faces, data = _vertex_lines(data)
    else:
        faces = struct.unpack_from("<I", data.ljust(_HEADER, b"\0"), 80)[0]
        extra = len(data) - _HEADER - _RECORD * faces
        if extra < 0 or (extra and extra % _RECORD == 0):
            found = max(len(data) - _HEADER, 0) // _RECORD
            raise MeshError(
                f"not an STL file, truncated or damaged: its header announces {faces:,} triangles "
                f"and {found:,} are there; export it again"
            )
        check_counts(faces=faces)
        if extra:
            notes = (f"{extra} bytes after the last triangle were ignored",)
            data = data[:-extra]
    return dataclasses.replace(read_mesh("stl", data, 3 * faces, faces), split=True, notes=notes)


def _vertex_lines(data: bytes) -> tuple[int, bytes]:
    """The number of facets, and a text of vertices alone: names may hold any word."""
    text = _NAME.sub(b"solid", data).lower()
    facets = text.count(b"endfacet")
    check_counts(faces=facets)
    corners = _VERTEX.findall(text)
    opened = text.count(b"facet") - 2 * facets
    if opened != 0 or len(corners) != 3 * facets or not re.search(rb"end\s*solid", text[-1024:]):
        raise MeshError(
            f"truncated or damaged text STL: {len(corners)} vertices for {facets} finished facets, "
            "each facet has 3 and the file ends with 'endsolid'; export it again"
        )
    lines = b"".join(b"vertex " + b" ".join(corner.split()) + b"\n" for corner in corners)
    return facets, b"solid\n" + lines + b"endsolid\n"
