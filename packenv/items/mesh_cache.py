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
from packenv.items.cache_files import CacheFile, default_folder


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
    content = hashlib.sha256(data).hexdigest()
    kept = CacheFile(folder, "meshes", repr((FORMAT, path.suffix.lower(), unit, content)))
    arrays = kept.read()
    if arrays is not None:
        return _unpack_mesh(arrays)
    mesh = solid_mesh(path, parsed_mesh(path, data), unit)
    with contextlib.suppress(InputError):
        kept.write(_pack_mesh(mesh))
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
    solid = arrays["solid"]
    properties = SolidProperties(float(solid[0]), solid[1:4], solid[4:].reshape(3, 3))
    repairs, notes = (tuple(arrays[name].tolist()) for name in ("repairs", "notes"))
    return LoadedMesh(arrays["vertices"], arrays["faces"], properties, repairs, notes)
