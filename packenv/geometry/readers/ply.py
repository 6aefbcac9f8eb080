"""PLY, text and binary in both byte orders. It has no unit."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.by_trimesh import by_trimesh
from packenv.geometry.readers.raw import RawMesh, check_counts
from packenv.geometry.readers.rows import CORNERS, Column, Element, cut, read_rows

_TYPES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H",
    "uint16": "H", "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f",
    "double": "d", "float64": "d",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read_ply(path: Path, data: bytes) -> RawMesh:
    """Read a PLY file, text or binary in both byte orders; it has no unit.

    trimesh reads binary files whose lists are of one length; rows of the others are taken one by one.

    Args:
        path: named in messages.
        data: the file's bytes.

    Returns:
        The mesh, polygons cut into triangles.

    Raises:
        MeshError: a damaged header, fewer or more data than it announces, or an index out of range.
    """
    end = data.find(b"end_header")
    start = data.find(b"\n", end) + 1
    if not data.startswith(b"ply") or end < 0 or start == 0:
        raise MeshError(
            f"{path}: not a PLY file, or truncated: its header from 'ply' to 'end_header' is not there"
        )
    order, elements = _header(path, data[:end].decode("latin-1").splitlines()[1:])
    body = data[start:]
    least = sum(
        e.count * sum(struct.calcsize(order + (c.count or c.kind)) if order else 2 for c in e.columns)
        for e in elements
    )
    if len(body) + (not order) < least:
        announced = " and ".join(f"{e.count:,} of element {e.name}" for e in elements)
        raise MeshError(
            f"{path}: truncated, its header announces {announced}, at least {least:,} bytes, "
            f"and {len(body):,} follow; export it again"
        )
    if not order:
        return read_rows(path, elements, (row for line in body.splitlines() if (row := line.split())))
    mesh = _table(path, data, elements)
    if mesh is None:
        mesh = read_rows(path, elements, _unpacked(path, order, elements, body))
    return mesh


def _header(path: Path, lines: Sequence[str]) -> tuple[str, list[Element]]:
    """The byte order, empty for text, and the tables. A line that trimesh would pass over is an error."""
    order = None
    found: dict[str, tuple[int, list[Column]]] = {}
    name = ""
    for line in lines:
        try:
            match line.split():
                case [] | ["comment" | "obj_info", *_]:
                    pass
                case ["format", word, _]:
                    order = _ORDERS[word]
                case ["element", name, count] if name not in found:
                    found[name] = int(count), []
                case ["property", "list", count, kind, column]:
                    found[name][1].append(Column(column, _TYPES[kind], _TYPES[count]))
                case ["property", kind, column] if column not in (c.name for c in found[name][1]):
                    found[name][1].append(Column(column, _TYPES[kind]))
                case _:
                    raise ValueError
        except (KeyError, ValueError):
            raise MeshError(f"{path}: damaged PLY header, cannot read the line {line[:60]!r}") from None
    elements = [Element(name, count, tuple(columns)) for name, (count, columns) in found.items()]
    counts = {e.name: e.count for e in elements}
    check_counts(path, vertices=counts.get("vertex", 0), faces=counts.get("face", 0))
    if order is None or "vertex" not in counts or any(e.count < 0 or not e.columns for e in elements):
        raise MeshError(
            f"{path}: damaged PLY header, it announces no format, no vertices, or an element of nothing"
        )
    if "tristrips" in counts and "face" not in counts:
        raise MeshError(f"{path}: its surface is in triangle strips (tristrips); export it with faces")
    for element in elements:
        needed = {"vertex": ["x", "y", "z"], "face": [""]}.get(element.name, [])
        names = [c.name if not c.count else "" if c.name in CORNERS else None for c in element.columns]
        if any(names.count(name) != 1 for name in needed):
            raise MeshError(
                f"{path}: damaged PLY header, its {element.name} element needs one each of "
                f"{'x, y and z' if needed[0] else 'the lists vertex_indices'}"
            )
    return order, elements


def _table(path: Path, data: bytes, elements: Sequence[Element]) -> RawMesh | None:
    """A binary file as trimesh reads it, or None where lists of different lengths keep it from that."""
    if not all(e.count for e in elements):
        return None
    try:
        scene = by_trimesh(path, "ply", data, fix_texture=False, skip_materials=True)
    except MeshError:
        return None
    # The columns as they are in the file: what trimesh makes of them depends on colours, textures and edges.
    (mesh,) = scene.geometry.values()
    tables = mesh.metadata.get("_ply_raw")
    if tables is None:
        return None
    counts, corners = np.empty(0, np.int64), np.empty(0, np.int64)
    for element in elements:
        table = tables[element.name]["data"]
        for column in element.columns:
            if not column.count:
                continue
            lengths, values = table[column.name]["f0"], table[column.name]["f1"]
            # trimesh takes every list for as long as the first.
            if (lengths != lengths[0]).any():
                return None
            if element.name == "face" and column.name in CORNERS:
                counts, corners = lengths.astype(np.int64), values.reshape(-1).astype(np.int64)
    table = tables["vertex"]["data"]
    vertices = np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
    return cut(path, vertices, counts, corners)


def _unpacked(path: Path, order: str, elements: Sequence[Element], body: bytes) -> Iterator[list[bytes]]:
    """Rows of a binary file as words of a text one, which give back the very numbers."""
    at = 0
    try:
        for element in elements:
            for _ in range(element.count):
                row: list[Any] = []
                for column in element.columns:
                    count = 1
                    if column.count:
                        (count,) = struct.unpack_from(order + column.count, body, at)
                        at += struct.calcsize(order + column.count)
                        row.append(count)
                    row += struct.unpack_from(f"{order}{count}{column.kind}", body, at)
                    at += struct.calcsize(f"{order}{count}{column.kind}")
                yield [repr(value).encode() for value in row]
    except struct.error:
        raise MeshError(
            f"{path}: truncated or damaged PLY file, its data end in the middle of an element"
        ) from None
    if body[at:].strip():
        raise MeshError(
            f"{path}: damaged PLY file, more data follow than its header announces; export it again"
        )
