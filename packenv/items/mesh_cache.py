"""Meshes in the user's cache: a mesh file is read and mended once, and after that its arrays are read."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from packenv.errors import InputError
from packenv.geometry.mass import SolidProperties
from packenv.geometry.mesh_files import file_bytes, parsed_mesh
from packenv.geometry.meshes import FORMAT, LoadedMesh, check_unit, solid_mesh
from packenv.items.cache_files import default_folder, read_arrays, write_arrays


def kept_mesh(path: Path, unit: str | None, folder: Path | None = None) -> LoadedMesh:
    """Read, check and mend a mesh file, or read what was made of it before.

    A file is the same where its bytes, its extension and its unit are. Where the cache cannot be written,
    nothing is kept.

    Args:
        path: an stl, obj, ply, off, glb or 3mf file.
        unit: as for :func:`packenv.geometry.meshes.solid_mesh`.
        folder: the cache; the user's own where None.

    Raises:
        UnitError: an unknown unit, or an item too large or too small.
        MeshError: something is wrong with the file.
    """
    check_unit(unit)
    folder = folder or default_folder()
    data = file_bytes(path)
    recipe = hashlib.sha256(f"{FORMAT}|{path.suffix.lower()}|{unit}|".encode())
    recipe.update(data)
    kept = folder / "meshes" / f"{recipe.hexdigest()[:40]}.npz"
    mesh = read_arrays(kept, _unpack_mesh)
    if mesh is None:
        mesh = solid_mesh(path, parsed_mesh(path, data), unit)
        with contextlib.suppress(InputError):
            write_arrays(folder, kept, _pack_mesh(mesh))
    return mesh


def _pack_mesh(mesh: LoadedMesh) -> dict[str, np.ndarray]:
    return {
        "vertices": mesh.vertices,
        "faces": mesh.faces,
        # Volume, then centroid, then inertia.
        "solid": np.array([mesh.solid.volume, *mesh.solid.com, *mesh.solid.inertia.reshape(-1)]),
        "repairs": np.array(mesh.repairs, dtype=np.str_),
        "notes": np.array(mesh.notes, dtype=np.str_),
    }


def _unpack_mesh(arrays: Mapping[str, np.ndarray]) -> LoadedMesh:
    vertices, faces, solid = (arrays[name] for name in ("vertices", "faces", "solid"))
    repairs, notes = arrays["repairs"], arrays["notes"]
    shapes = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3
    if not shapes or vertices.dtype.str != "<f8" or faces.dtype.str != "<i8" or not faces.size:
        raise ValueError("arrays of a mesh have other shapes or types")
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError("arrays of a mesh do not fit together")
    if solid.dtype.str != "<f8" or solid.shape != (13,) or not (np.isfinite(solid).all() and solid[0] > 0):
        raise ValueError("mass properties of a mesh are none")
    if repairs.dtype.kind != "U" or notes.dtype.kind != "U":
        raise ValueError("words of a mesh are no text")
    properties = SolidProperties(float(solid[0]), solid[1:4], solid[4:].reshape(3, 3))
    return LoadedMesh(vertices, faces, properties, tuple(repairs.tolist()), tuple(notes.tolist()))
