"""Items from meshes in memory: trimesh objects by name, or the geometries of a trimesh scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from packenv.errors import CatalogueError
from packenv.geometry.meshes import check_unit
from packenv.types import Item, normal_name

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
    named = [(normal_name(str(name)), mesh) for name, mesh in source.items()]
    return {name: _item(name, mesh, unit) for name, mesh in named}


def _item(name: str, mesh: Any, unit: str | None) -> Item:
    if isinstance(mesh, Item):
        return mesh if mesh.name == name else replace(mesh, name=name)
    return Item.from_trimesh(mesh, name, unit=unit)


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
