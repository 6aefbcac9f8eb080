"""PLY, text and binary in both byte orders. It has no unit."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.polygons import Words, read_polygons, refuse_dents, take
from packenv.geometry.readers.raw import RawMesh, brief, check_counts, check_indices, read_scene

_INTEGERS = {u + kind for u in ("", "u") for kind in ("char", "int8", "short", "int16", "int", "int32")}
_TYPES = _INTEGERS | {"float", "float32", "double", "float64"}
_FORMATS = ("ascii", "binary_little_endian", "binary_big_endian")


class _Element(NamedTuple):
    """A table: how many rows, and the type of each column by its name; ``list`` before that of a list."""

    rows: int
    columns: dict[str, str]


def read_ply(data: bytes) -> RawMesh:
    """Read a PLY file.

    Raises:
        MeshError: a damaged header, fewer or more data than it announces, an index out of range, dented
            polygons, or a binary file whose lists are not all of one length.
    """
    head, word, body = data.partition(b"end_header")
    if not data.startswith(b"ply") or not word or b"\n" not in body:
        raise MeshError("not a PLY file, or truncated: its header from 'ply' to 'end_header' is not there")
    form, elements = _header(head.decode("latin-1").splitlines()[1:])
    vertex, face = elements.get("vertex", _Element(0, {})), elements.get("face", _Element(0, {}))
    corners = [name for name in ("vertex_indices", "vertex_index") if name in face.columns]
    kinds = [face.columns[name].removeprefix("list ") in _INTEGERS for name in corners]
    if not form or not {"x", "y", "z"} <= set(vertex.columns) or kinds != [True][: "face" in elements]:
        raise MeshError(
            "damaged PLY header, it needs a format, x, y and z of element vertex and one list "
            "vertex_indices of element face; export it again"
        )
    if not face.rows:
        return RawMesh(np.zeros((vertex.rows, 3)), np.empty((0, 3), np.int64))
    if form == "ascii":
        lines = body[body.index(b"\n") :].splitlines()
        return _read_text(elements, corners[0], (words for line in lines if (words := line.split())))
    return _read_binary(data, elements, corners[0])


def _header(lines: Sequence[str]) -> tuple[str, dict[str, _Element]]:
    """The format and the tables. A line that trimesh would pass over is an error."""
    form = name = ""
    found: dict[str, _Element] = {}
    for line in lines:
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", word, _] if word in _FORMATS:
                form = word
                continue
            case ["element", name, count] if name not in found:
                found[name] = _Element(int(count), {})
                check_counts(vertices=int(count), faces=int(count) if name == "face" else 0)
                continue
            case ["property", "list", length, kind, column] if length in _INTEGERS:
                kind = f"list {kind}"
            case ["property", kind, column]:
                pass
            case _:
                kind = column = ""
        if kind.removeprefix("list ") not in _TYPES or name not in found or column in found[name].columns:
            raise MeshError(f"damaged PLY header, cannot read the line {brief(line)!r}")
        found[name].columns[column] = kind
    if "tristrips" in found and found["tristrips"].rows:
        raise MeshError("its surface is in triangle strips (tristrips); export it with faces")
    return form, found


def _read_text(elements: dict[str, _Element], corners: str, rows: Iterator[Words]) -> RawMesh:
    cells: dict[str, dict[str, list[Words]]] = {}
    missing = sum(element.rows for element in elements.values())
    for name, element in elements.items():
        columns = cells[name] = {column: [] for column in element.columns}
        for row in itertools.islice(rows, element.rows):
            missing -= 1
            at = 0
            for column, kind in element.columns.items():
                word, at = take(row, at) if kind.startswith("list") else (row[at : at + 1], at + 1)
                columns[column].append(word)
            if at != len(row):
                raise ValueError(f"{len(row)} numbers in a row of {name} where {at} belong")
    if missing or next(rows, None):
        wrong = f"{missing:,} rows are missing" if missing else "it has more rows than it announces"
        raise MeshError(f"truncated or damaged, {wrong}; export it again")
    axes = [itertools.chain.from_iterable(cells["vertex"][axis]) for axis in "xyz"]
    polygons = [[int(word) for word in polygon] for polygon in cells["face"][corners]]
    return read_polygons(list(zip(*axes, strict=True)), polygons)


def _read_binary(data: bytes, elements: dict[str, _Element], corners: str) -> RawMesh:
    # trimesh takes every list of a column for as long as the first.
    other = "truncated or damaged, or its lists are of different lengths; export triangles, or text"
    try:
        (mesh,) = read_scene("ply", data, fix_texture=False, skip_materials=True).geometry.values()
    except MeshError as problem:
        raise MeshError(other if "unexpected length" in str(problem) else str(problem)) from None
    # The columns as they are in the file: what trimesh makes of faces depends on colours, textures and edges.
    tables = mesh.metadata["_ply_raw"]
    for name, element in elements.items():
        for column, kind in element.columns.items():
            if element.rows and kind.startswith("list") and np.ptp(tables[name]["data"][column]["f0"]):
                raise MeshError(other)
    polygons = tables["face"]["data"][corners]["f1"].astype(np.int64).reshape(elements["face"].rows, -1)
    vertices = np.asarray(mesh.vertices, np.float64)
    fans = polygons.shape[1] - 2
    if fans < 1:
        raise MeshError(f"a face has {fans + 2} vertices, it needs at least 3")
    check_counts(faces=len(polygons) * fans)
    check_indices(polygons, len(vertices))
    faces = np.stack([polygons[:, [0, k, k + 1]] for k in range(1, fans + 1)], axis=1).reshape(-1, 3)
    refuse_dents(vertices, faces, np.full(len(polygons), fans))
    return RawMesh(vertices, faces)
