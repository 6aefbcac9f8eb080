"""PLY, text and binary in both byte orders. It has no unit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from packenv.errors import MeshError
from packenv.geometry.polygons import triangulated
from packenv.geometry.readers.ply_header import Element, check_length, read_header
from packenv.geometry.readers.raw import RawMesh, check_counts, check_indices, check_points, integers, numbers
from packenv.types import FloatArray, IntArray

_FACE_LISTS = ("vertex_indices", "vertex_index")


class _Data(Protocol):
    """Takes the elements one after the other."""

    def vertices(self, element: Element) -> FloatArray:
        """The (n, 3) coordinates of a vertex element."""

    def polygons(self, element: Element) -> tuple[IntArray, IntArray]:
        """Corners of each polygon, and all their vertex indices."""

    def skip(self, element: Element) -> None:
        """Pass over an element that plays no part."""

    def left_over(self) -> int:
        """How much follows the last element that was taken, in bytes or words."""


def read_ply(path: Path, data: bytes) -> RawMesh:
    """Read a PLY file.

    Args:
        path: named in messages.
        data: the file's bytes.

    Returns:
        The mesh, polygons cut into triangles.

    Raises:
        MeshError: a damaged header, fewer data than it announces, or an index out of range.
    """
    header = read_header(path, data)
    body = data[header.length :]
    check_length(path, header, len(body))
    source: _Data = _Binary(path, body, header.order) if header.order else _Text(path, body)
    vertices: FloatArray = np.empty((0, 3))
    counts, corners = np.empty(0, np.int64), np.empty(0, np.int64)
    for element in header.elements:
        if element.name == "vertex":
            vertices = source.vertices(element)
        elif element.name == "face":
            counts, corners = source.polygons(element)
        else:
            source.skip(element)
    if source.left_over():
        raise MeshError(
            f"{path}: damaged PLY file, more data follow than its header announces; export it again"
        )
    if (counts < 3).any():
        raise MeshError(f"{path}: a face has {counts.min()} vertices, it needs at least 3")
    check_indices(path, corners, len(vertices))
    check_points(path, vertices)
    faces = triangulated(path, vertices, counts, corners)
    check_counts(path, faces=len(faces))
    return RawMesh(vertices, faces)


class _Binary:
    def __init__(self, path: Path, body: bytes, order: str) -> None:
        self.path = path
        self.body = body
        self.order = order
        self.at = 0

    def vertices(self, element: Element) -> FloatArray:
        columns = [element.index(self.path, axis, is_list=False) for axis in "xyz"]
        rows = self._table(element)
        if rows is not None:
            return np.stack([rows[f"p{k}"].reshape(-1).astype(np.float64) for k in columns], axis=1)
        points = [[row[k][0] for k in columns] for row in self._rows(element)]
        return np.array(points, dtype=np.float64).reshape(-1, 3)

    def polygons(self, element: Element) -> tuple[IntArray, IntArray]:
        column = element.index(self.path, *_FACE_LISTS, is_list=True)
        rows = self._table(element)
        if rows is not None:
            lists = rows[f"p{column}"].astype(np.int64)
            return np.full(len(lists), lists.shape[1], np.int64), lists.reshape(-1)
        parts = [row[column] for row in self._rows(element)]
        corners: IntArray = np.concatenate(parts).astype(np.int64)
        return np.array([len(part) for part in parts], np.int64), corners

    def skip(self, element: Element) -> None:
        if self._table(element) is None:
            for _ in self._rows(element):
                pass

    def left_over(self) -> int:
        return len(self.body[self.at :].strip())

    def _table(self, element: Element) -> NDArray[np.void] | None:
        """All rows at once where their lists are as long as those of the first row, else None."""
        start = self.at
        lengths = [3] * len(element.properties)
        for row in self._rows(element):
            lengths = [len(values) for values in row]
            break
        self.at = start
        fields: list[tuple[str, str, tuple[int, ...]]] = []
        for k, prop in enumerate(element.properties):
            if prop.count_kind:
                fields.append((f"n{k}", self.order + prop.count_kind, (1,)))
            fields.append((f"p{k}", self.order + prop.kind, (lengths[k],)))
        row_type = np.dtype(fields)
        end = start + element.count * row_type.itemsize
        if end > len(self.body):
            return None
        rows = np.frombuffer(self.body, row_type, count=element.count, offset=start)
        for k, prop in enumerate(element.properties):
            if prop.count_kind and not (rows[f"n{k}"] == lengths[k]).all():
                return None
        self.at = end
        return rows

    def _rows(self, element: Element) -> Iterator[list[NDArray[np.generic]]]:
        """Row after row: slow, but takes lists of different lengths."""
        for _ in range(element.count):
            row = []
            for prop in element.properties:
                count = int(self._take(prop.count_kind, 1)[0]) if prop.count_kind else 1
                row.append(self._take(prop.kind, count))
            yield row

    def _take(self, kind: str, count: int) -> NDArray[np.generic]:
        dtype = np.dtype(self.order + kind)
        end = self.at + count * dtype.itemsize
        if count < 0 or end > len(self.body):
            raise MeshError(
                f"{self.path}: truncated or damaged PLY file, its data end in the middle of an element"
            )
        values: NDArray[np.generic] = np.frombuffer(self.body, dtype, count=count, offset=self.at)
        self.at = end
        return values


class _Text:
    def __init__(self, path: Path, body: bytes) -> None:
        self.path = path
        self.words = body.split()
        self.at = 0

    def vertices(self, element: Element) -> FloatArray:
        columns = [element.index(self.path, axis, is_list=False) for axis in "xyz"]
        rows = list(self._rows(element))
        return numbers(self.path, [row[k][0] for row in rows for k in columns], "a vertex").reshape(-1, 3)

    def polygons(self, element: Element) -> tuple[IntArray, IntArray]:
        column = element.index(self.path, *_FACE_LISTS, is_list=True)
        lists = [row[column] for row in self._rows(element)]
        corners = integers(self.path, [word for part in lists for word in part], "a face")
        return np.array([len(part) for part in lists], np.int64), corners

    def skip(self, element: Element) -> None:
        for _ in self._rows(element):
            pass

    def left_over(self) -> int:
        return len(self.words) - self.at

    def _rows(self, element: Element) -> Iterator[list[list[bytes]]]:
        for _ in range(element.count):
            row = []
            for prop in element.properties:
                count = 1
                if prop.count_kind:
                    count = int(integers(self.path, self._take(1), "the length of a list")[0])
                row.append(self._take(count))
            yield row

    def _take(self, count: int) -> list[bytes]:
        end = self.at + count
        if count < 0 or end > len(self.words):
            raise MeshError(f"{self.path}: truncated or damaged PLY file, its numbers end too early")
        words = self.words[self.at : end]
        self.at = end
        return words
