"""What reading a mesh file gives, the limits that hold for every format, and the way to trimesh."""

from __future__ import annotations

import io
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

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
    """What a file or a library says, on one line and cut to what a message can hold."""
    whole = " ".join(str(text).split())
    return whole if len(whole) <= 80 else f"{whole[:77]}..."


def check_counts(path: Path, *, vertices: int = 0, faces: int = 0) -> None:
    """Refuse a mesh that is too large, before any memory is asked for it.

    Raises:
        MeshError: more vertices or faces than the limits, or a negative number of them.
    """
    if vertices < 0 or faces < 0:
        raise MeshError(f"{path}: damaged, it announces {brief(vertices)} vertices and {brief(faces)} faces")
    for count, what, limit in ((faces, "faces", MAX_FACES), (vertices, "vertices", MAX_VERTICES)):
        if count > limit:
            raise MeshError(
                f"{path}: {brief(f'{count:,}')} {what}, the limit is {limit:,}; decimate the mesh"
            )


def refuse_points(path: Path, vertices: int, faces: int) -> None:
    """Refuse what has no faces.

    Raises:
        MeshError: so it is.
    """
    if not faces:
        content = f"{vertices} points but no faces" if vertices else "no faces"
        raise MeshError(
            f"{path}: has {content}, an item needs a closed surface; export it as a triangle mesh"
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


def read_scene(path: Path, kind: str, data: bytes, **options: Any) -> Any:
    """What trimesh makes of a file's bytes, nothing merged or dropped.

    Args:
        path: named in messages.
        kind: ``stl``, ``off``, ``ply``, ``glb`` or ``3mf``.
        data: what the gate lets through.
        options: for trimesh's reader.

    Returns:
        A ``trimesh.Scene``.

    Raises:
        MeshError: trimesh cannot read it, or stops at a word that is no number.
    """
    import trimesh

    with warnings.catch_warnings():
        # NumPy ends at such a word and warns; the numbers up to it would be taken for all.
        warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
        try:
            return trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False, **options)
        except Exception as problem:  # trimesh lets the errors of many libraries through
            said = brief(f"{type(problem).__name__}: {problem}")
            hint = "write decimals with a point" if re.search(r"\d,\d", said) else "export it again"
            raise MeshError(f"{path}: truncated or damaged ({said}); {hint}") from None


def read_mesh(path: Path, kind: str, data: bytes, vertices: int, faces: int, **options: Any) -> RawMesh:
    """All meshes of a file in one, each moved to its place in the scene.

    Args:
        path: as for :func:`read_scene`, like ``kind``, ``data`` and ``options``.
        kind: see there.
        data: see there.
        vertices: how many the file announces.
        faces: how many triangles the file announces.
        options: see there.

    Raises:
        MeshError: as there; or a face names a vertex that is not there, or other counts are found.
    """
    refuse_points(path, vertices, faces)
    scene = read_scene(path, kind, data, **options)
    for mesh in scene.geometry.values():
        check_indices(path, getattr(mesh, "faces", np.empty(0, np.int64)), len(mesh.vertices))
    whole = scene.to_mesh()
    if (len(whole.vertices), len(whole.faces)) != (vertices, faces):
        raise MeshError(
            f"{path}: truncated or damaged, it announces {vertices:,} vertices and {faces:,} faces "
            f"and {len(whole.vertices):,} and {len(whole.faces):,} are there; export it again"
        )
    return RawMesh(np.asarray(whole.vertices, np.float64), np.asarray(whole.faces, np.int64))


def check_indices(path: Path, indices: IntArray, n_vertices: int) -> None:
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
