"""What every reader returns, and the limits that every reader keeps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from packenv.errors import MeshError, UnitError
from packenv.types import FloatArray, IntArray

MAX_FACES = 1_000_000
"""Faces that a mesh may have. Beyond it, heightmaps take minutes and gain nothing at 2 mm cells."""

MAX_VERTICES = 3 * MAX_FACES
"""Vertices that a mesh may have: every face with three of its own."""

MAX_COORDINATE = 1e12
"""Distance from the origin, in any unit, that is still read."""

MAX_FILE_BYTES = 400 * 2**20
"""Size of a mesh file, packed or unpacked, that is still read."""


@dataclass(frozen=True, eq=False)
class RawMesh:
    """The content of a mesh file, nothing mended.

    Attributes:
        vertices: (n, 3) float64, the file's unit.
        faces: (m, 3) int64, every index within ``vertices``.
        split: True where the format gives faces or patches vertices of their own (STL, glTF), so that
            equal vertices are one.
        metres: length of the file's own unit in metres, or None where the format has no unit.
        notes: what a user should know about the reading.
    """

    vertices: FloatArray
    faces: IntArray
    split: bool = False
    metres: float | None = None
    notes: tuple[str, ...] = ()


def brief(text: object) -> str:
    """What a file or a library says, cut to what a message can hold."""
    whole = str(text)
    return whole if len(whole) <= 80 else f"{whole[:77]}..."


def check_counts(path: Path, *, vertices: int = 0, faces: int = 0) -> None:
    """Refuse a mesh that is too large, before any memory is asked for it.

    Raises:
        MeshError: more vertices or faces than the limits, or a negative number of them.
    """
    if vertices < 0 or faces < 0:
        raise MeshError(f"{path}: damaged, it announces {brief(vertices)} vertices and {brief(faces)} faces")
    if faces > MAX_FACES:
        raise MeshError(f"{path}: {brief(f'{faces:,}')} faces, the limit is {MAX_FACES:,}; decimate the mesh")
    if vertices > MAX_VERTICES:
        raise MeshError(
            f"{path}: {brief(f'{vertices:,}')} vertices, the limit is {MAX_VERTICES:,}; decimate the mesh"
        )


def check_points(path: Path, vertices: FloatArray) -> None:
    """Refuse coordinates that are no numbers, or so large that products of three overflow.

    Args:
        path: named in messages.
        vertices: (n, 3), the file's unit.

    Raises:
        MeshError: a coordinate is not finite.
        UnitError: a coordinate is beyond anything that a unit makes an item of.
    """
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        k = int(np.argmin(finite))
        raise MeshError(
            f"{path}: vertex {k + 1} is ({', '.join(f'{x:g}' for x in vertices[k])}), "
            "coordinates must be finite numbers; export it again"
        )
    largest = float(np.abs(vertices).max(initial=0.0))
    if largest > MAX_COORDINATE:
        raise UnitError(
            f"{path}: a coordinate of {largest:.3g}, items are 2 mm to 2 m; "
            "no --unit makes it so, it is damaged or needs scaling"
        )


def check_indices(path: Path, indices: NDArray[np.integer], n_vertices: int) -> None:
    """Refuse faces that name a vertex that is not there.

    Raises:
        MeshError: an index is outside 0 to ``n_vertices - 1``.
    """
    if indices.size and not (indices.min() >= 0 and indices.max() < n_vertices):
        wrong = int(indices.max() if indices.max() >= n_vertices else indices.min())
        raise MeshError(
            f"{path}: a face names vertex {wrong} (counted from 0) but the file has {n_vertices}; "
            "it is damaged or truncated, export it again"
        )


def numbers(path: Path, tokens: list[bytes], what: str) -> FloatArray:
    """Numbers from their text; the first that is none is named.

    Raises:
        MeshError: a token is not a number.
    """
    try:
        return np.array(tokens, dtype=np.float64)
    except ValueError:
        for token in tokens:
            try:
                float(token)
            except ValueError:
                text = token[:40].decode("utf-8", "replace")
                hint = " (decimals take a point)" if "," in text else ""
                raise MeshError(f"{path}: {what} holds {text!r}, which is not a number{hint}") from None
        raise


def integers(path: Path, tokens: list[bytes], what: str) -> IntArray:
    """Integers from their text; the first that is none is named.

    Raises:
        MeshError: a token is not an integer, or does not fit into 64 bits.
    """
    try:
        return np.array([int(token) for token in tokens], dtype=np.int64)
    except (ValueError, OverflowError):
        for token in tokens:
            digits = token.removeprefix(b"-")
            if not (digits.isdigit() and len(digits) < 19):
                text = token[:40].decode("utf-8", "replace")
                raise MeshError(f"{path}: {what} holds {text!r}, which is not a whole number") from None
        raise
