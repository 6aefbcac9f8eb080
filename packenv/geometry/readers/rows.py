"""Tables of a mesh file (PLY, OFF): points, and polygons of any number of corners."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.polygons import triangulated
from packenv.geometry.readers.raw import (
    RawMesh,
    brief,
    check_counts,
    check_indices,
    check_points,
    integers,
    numbers,
)
from packenv.types import FloatArray, IntArray

CORNERS = ("vertex_indices", "vertex_index")
"""Names of the list of a face's corners."""


@dataclass(frozen=True)
class Column:
    """A property of a PLY element: ``kind`` is a code of :mod:`struct`, ``count`` that of a list's length."""

    name: str
    kind: str
    count: str = ""


@dataclass(frozen=True)
class Element:
    """A table of a PLY file: ``count`` rows of ``columns``."""

    name: str
    count: int
    columns: tuple[Column, ...]


def read_rows(path: Path, elements: Sequence[Element], rows: Iterable[Sequence[bytes]]) -> RawMesh:
    """Read tables from the words of their rows.

    Args:
        path: named in messages.
        elements: the tables that are announced; the columns x, y and z of ``vertex`` and one list of
            :data:`CORNERS` of ``face`` are there.
        rows: words of each row, table after table.

    Returns:
        The mesh, polygons cut into triangles.

    Raises:
        MeshError: rows or words are missing or too many, or are no numbers.
    """
    points: list[bytes] = []
    sizes: list[int] = []
    corners: list[bytes] = []
    remaining = iter(rows)
    n_rows = 0
    for element in elements:
        for row in itertools.islice(remaining, element.count):
            n_rows += 1
            at = 0
            point: dict[str, Sequence[bytes]] = {}
            for column in element.columns:
                count = 1
                if column.count:
                    count = max(int(integers(path, [*row[at : at + 1]], "the length of a list").sum()), 0)
                    at += 1
                else:
                    point[column.name] = row[at : at + 1]
                if element.name == "face" and column.count and column.name in CORNERS:
                    sizes.append(count)
                    corners += row[at : at + count]
                at += count
            if at != len(row):
                raise MeshError(
                    f"{path}: truncated or damaged, {len(row)} numbers in a row of {brief(element.name)} "
                    f"where {at} belong; export it again"
                )
            if element.name == "vertex":
                for axis in "xyz":
                    points += point[axis]
    announced = sum(element.count for element in elements)
    if n_rows < announced or next(remaining, None) is not None:
        raise MeshError(
            f"{path}: truncated or damaged, it announces {announced:,} rows and has "
            f"{'more' if n_rows == announced else f'{n_rows:,}'}; export it again"
        )
    vertices = numbers(path, points, "a vertex").reshape(-1, 3)
    return cut(path, vertices, np.array(sizes, dtype=np.int64), integers(path, corners, "a face"))


def cut(path: Path, vertices: FloatArray, counts: IntArray, corners: IntArray) -> RawMesh:
    """Check polygons and cut them into triangles.

    Args:
        path: named in messages.
        vertices: (n, 3).
        counts: (p,) corners of each polygon.
        corners: (sum of counts,) vertex indices, polygon after polygon.

    Raises:
        MeshError: a polygon of fewer than 3 corners, an index out of range, or a point that is not finite.
    """
    if (counts < 3).any():
        raise MeshError(f"{path}: a face has {counts.min()} vertices, it needs at least 3")
    check_indices(path, corners, len(vertices))
    check_points(path, vertices)
    faces = triangulated(path, vertices, counts, corners)
    check_counts(path, faces=len(faces))
    return RawMesh(vertices, faces)
