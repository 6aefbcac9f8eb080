"""STL, binary and text. It has neither a unit nor shared vertices."""

from __future__ import annotations

import dataclasses
import re
import struct
from collections import Counter

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
        check_counts(faces=faces if extra > 0 else 0)
        plain = _without_attributes(data, faces) if extra > 0 else None
        if plain:
            notes, data, extra = (f"{extra:,} bytes of attributes were ignored",), plain, 0
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


def _without_attributes(data: bytes, faces: int) -> bytes | None:
    """Triangles without the bytes that their last field announces, or None where those do not fill the file."""
    at, records = _HEADER, []
    for _ in range(faces):
        if at + _RECORD > len(data):
            return None
        records.append(data[at : at + _RECORD])
        at += _RECORD + struct.unpack_from("<H", data, at + _RECORD - 2)[0]
    return data[:_HEADER] + b"".join(records) if at == len(data) else None


def _vertex_lines(data: bytes) -> tuple[int, bytes]:
    """The number of facets, and a text of vertices alone: names may hold any word."""
    text = _NAME.sub(b"solid", data).lower()
    facets = text.count(b"endfacet")
    check_counts(faces=facets)
    corners = _VERTEX.findall(text)
    opened = text.count(b"facet") - 2 * facets
    ended = re.search(rb"end\s*solid", text[-1024:]) or (
        text.rstrip().endswith(b"endfacet") and _closed(corners)
    )
    if opened != 0 or len(corners) != 3 * facets or not ended:
        raise MeshError(
            f"truncated or damaged text STL: {len(corners)} vertices for {facets} finished facets, "
            "each facet has 3 and the file ends with 'endsolid'; export it again"
        )
    lines = b"".join(b"vertex " + b" ".join(corner.split()) + b"\n" for corner in corners)
    return facets, b"solid\n" + lines + b"endsolid\n"


def _closed(corners: list[bytes]) -> bool:
    """Whether each edge of the triangles is passed as often one way as the other: none is missing."""
    names = [b" ".join(corner.split()) for corner in corners]
    edges = Counter((names[k], names[k - k % 3 + (k + 1) % 3]) for k in range(len(names) // 3 * 3))
    return all(edges[b, a] == n for (a, b), n in edges.items())
