"""Items from meshes in memory: trimesh objects by name, or the geometries of a trimesh scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from packenv.errors import CatalogueError, MeshError
from packenv.geometry.meshes import check_unit, make_item, solid_mesh
from packenv.geometry.readers.raw import RawMesh, check_counts, check_points
from packenv.types import Item

_METRES = {
    "m": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "cm": 0.01,
    "centimeter": 0.01,
    "centimeters": 0.01,
    "mm": 0.001,
    "millimeter": 0.001,
    "millimeters": 0.001,
    "in": 0.0254,
    "inch": 0.0254,
    "inches": 0.0254,
}
"""Words for units that trimesh objects state, in metres."""

_ALIKE = 1e-9
"""Shapes of one geometry at two nodes of a scene differ by at most this share."""


def items_of_meshes(source: Any, unit: str | None) -> dict[str, Item]:
    """Items of meshes in memory, checked and mended as mesh files are.

    Args:
        source: meshes by name, each with ``vertices`` (n, 3) and ``faces`` (m, 3), and perhaps ``units``, or
            an :class:`Item`; or a scene with ``geometry`` and ``graph``, as ``trimesh.Scene``.
        unit: of the numbers; None takes what a mesh states, else metres.

    Raises:
        InputError: there is no mesh, or one cannot be used.
    """
    check_unit(unit)
    if hasattr(source, "geometry") and hasattr(source, "graph"):
        source = _of_scene(source)
    if not isinstance(source, Mapping):
        raise CatalogueError(
            f"a catalogue of {type(source).__name__}: give a folder, 'builtin', meshes by name "
            "({'mug': trimesh.load_mesh('mug.stl')}) or a trimesh.Scene"
        )
    if not source:
        raise CatalogueError("the catalogue holds no mesh, give at least one")
    return {str(name): _item(str(name), mesh, unit) for name, mesh in source.items()}


def _item(name: str, mesh: Any, unit: str | None) -> Item:
    if isinstance(mesh, Item):
        return mesh if mesh.name == name else replace(mesh, name=name)
    where = Path(f"mesh {name!r}")
    if not (hasattr(mesh, "vertices") and hasattr(mesh, "faces")):
        raise MeshError(
            f"{where}: is of type {type(mesh).__name__}, give one with vertices and faces, such as trimesh.Trimesh"
        )
    try:
        vertices = np.array(mesh.vertices, dtype=np.float64)
        faces = np.array(mesh.faces, dtype=np.int64)
    except (TypeError, ValueError):
        raise MeshError(f"{where}: its vertices or faces are no numbers") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(
            f"{where}: vertices of shape {vertices.shape} and faces of {faces.shape}, give (n, 3) and (m, 3)"
        )
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise MeshError(f"{where}: a face names a vertex that is not among its {len(vertices)}")
    check_counts(where, vertices=len(vertices), faces=len(faces))
    check_points(where, vertices)
    stated = getattr(mesh, "units", None)
    raw = RawMesh(vertices, faces, split=True, metres=_METRES.get(str(stated).lower()))
    return make_item(name, solid_mesh(where, raw, unit), file=name, mass=None)


def _of_scene(scene: Any) -> dict[str, Any]:
    """Every geometry of a scene in the shape that its nodes give it; turns and places of nodes are no matter."""
    found: dict[str, Any] = {}
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not hasattr(mesh, "faces"):
            continue  # lines and points
        shape = np.array(matrix[:3, :3], dtype=np.float64)
        placed = mesh.copy()
        placed.apply_transform(matrix)
        if getattr(placed, "units", None) is None and getattr(scene, "units", None) is not None:
            placed.units = scene.units
        if name in found:
            known = found[name][0]
            if np.abs(known.T @ known - shape.T @ shape).max() > _ALIKE * np.abs(known).max() ** 2:
                raise CatalogueError(
                    f"scene: its nodes scale {name!r} in different ways, give each size a geometry of its own"
                )
            continue
        found[name] = shape, placed
    return {name: mesh for name, (_, mesh) in found.items()}
