"""What reading a mesh file gives, the limits that hold for every format, and the way to trimesh.

The readers' messages say what is wrong and what to do; the file is named where they are called.
"""

from __future__ import annotations

import io
import re
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from packenv.errors import MeshError
from packenv.types import FloatArray, IntArray

MAX_FACES = 1_000_000
"""Faces that a mesh may have. Beyond it, heightmaps take minutes and gain nothing at 2 mm cells."""

MAX_VERTICES = 3 * MAX_FACES
"""Vertices that a mesh may have: every face with three of its own."""

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


def check_counts(*, vertices: int = 0, faces: int = 0) -> None:
    """Refuse a mesh that is too large, before any memory is asked for it.

    Raises:
        MeshError: more vertices or faces than the limits, or a negative number of them.
    """
    for count, what, limit in ((faces, "faces", MAX_FACES), (vertices, "vertices", MAX_VERTICES)):
        if count < 0:
            raise MeshError(f"damaged, it announces {brief(count)} {what}; export it again")
        if count > limit:
            raise MeshError(f"{brief(f'{count:,}')} {what}, the limit is {limit:,}; decimate the mesh")


def check_indices(indices: IntArray, n_vertices: int) -> None:
    """Refuse faces that name a vertex that is not there.

    Raises:
        MeshError: an index is outside 0 to ``n_vertices - 1``.
    """
    if indices.size and not (indices.min() >= 0 and indices.max() < n_vertices):
        wrong = int(indices.max() if indices.max() >= n_vertices else indices.min())
        raise MeshError(
            f"a face names vertex {wrong} (counted from 0) but the file has {n_vertices}; "
            "it is damaged or truncated, export it again"
        )


def read_scene(kind: str, data: bytes, **options: Any) -> Any:
    """What trimesh makes of a file's bytes, nothing merged or dropped.

    Args:
        kind: ``stl``, ``off``, ``ply`` or ``glb``.
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
            raise MeshError(f"truncated or damaged ({said}); {hint}") from None


def read_mesh(kind: str, data: bytes, vertices: int, faces: int, **options: Any) -> RawMesh:
    """All meshes of a file in one, each moved to its place in the scene.

    Args:
        kind: as for :func:`read_scene`, like ``data`` and ``options``.
        data: see there.
        vertices: how many the file announces.
        faces: how many triangles the file announces.
        options: see there.

    Raises:
        MeshError: as there; or a face names a vertex that is not there, or other counts are found.
    """
    if not faces:
        return RawMesh(np.zeros((vertices, 3)), np.empty((0, 3), np.int64))
    scene = read_scene(kind, data, **options)
    for mesh in scene.geometry.values():
        check_indices(getattr(mesh, "faces", np.empty(0, np.int64)), len(mesh.vertices))
    whole = scene.to_mesh()
    if (len(whole.vertices), len(whole.faces)) != (vertices, faces):
        raise MeshError(
            f"truncated or damaged, it announces {vertices:,} vertices and {faces:,} faces "
            f"and {len(whole.vertices):,} and {len(whole.faces):,} are there; export it again"
        )
    return RawMesh(np.asarray(whole.vertices, np.float64), np.asarray(whole.faces, np.int64))
