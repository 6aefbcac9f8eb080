"""Files of convex parts: an OBJ with one ``o`` a part, beside a mesh that was made of exactly these parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from packenv.errors import CatalogueError
from packenv.geometry.ball_fit import fit_ball
from packenv.geometry.convex_parts import ConvexParts
from packenv.geometry.meshes import UNITS
from packenv.io.tables import read_text
from packenv.items.catalogue import Catalogue
from packenv.types import FloatArray, Item

_AGREE = 1e-4
"""Largest difference between the bounding boxes of a mesh and of its exact parts, m."""


def exact_parts(catalogue: Catalogue, name: str) -> ConvexParts | None:
    """The convex parts that a catalogue's item is made of, or None where the catalogue has no file of them.

    Raises:
        CatalogueError: no such item, or something is wrong with the file.
        MeshError: the item's mesh cannot be used.
    """
    path = catalogue.parts_file(name)
    if path is None:
        return None
    item = catalogue.item(name)
    scale = UNITS[catalogue.entries[name].unit or "m"]
    return ConvexParts(
        read_parts(path, item, scale), fit_ball(item.vertices, item.faces), bulge=0.0, dent=0.0
    )


def read_parts(path: Path, item: Item, scale: float = 1.0) -> tuple[FloatArray, ...]:
    """Read the exact convex parts of an item.

    Args:
        path: the OBJ; its faces are not read, a part is the hull of its vertices.
        item: the item that is made of them.
        scale: metres in the file's unit.

    Returns:
        (k, 3) vertices of each part, mesh frame, m.

    Raises:
        CatalogueError: the file cannot be read, a part has no volume, or the parts are not those of the mesh.
    """
    parts: list[list[list[float]]] = []
    for number, line in enumerate(
        read_text(path, CatalogueError, "an OBJ file of convex parts").splitlines(), 1
    ):
        words = line.split()
        if words[:1] == ["o"]:
            parts.append([])
        elif words[:1] == ["v"]:
            vertex = _vertex(words[1:4])
            if vertex is None or not parts:
                raise CatalogueError(f"{path}, line {number}: {line[:40]!r} should be 'v X Y Z' after an 'o'")
            parts[-1].append(vertex)
    arrays = tuple(np.array(part, dtype=np.float64).reshape(-1, 3) * scale for part in parts)
    if not arrays:
        raise CatalogueError(f"{path}: holds no part, give an OBJ with one 'o' a convex part")
    for k, part in enumerate(arrays):
        if len(part) < 4 or np.linalg.matrix_rank(part - part[0], tol=1e-7) < 3:
            raise CatalogueError(f"{path}: part {k + 1} of {len(arrays)} has no volume, give convex solids")
    everything = np.concatenate(arrays)
    for bound in (np.min, np.max):
        apart = float(np.abs(bound(everything, axis=0) - bound(item.vertices, axis=0)).max())
        if not apart <= _AGREE:
            raise CatalogueError(
                f"{path}: bounding box is {apart * 1e3:.2f} mm off that of {item.file}, "
                "give the parts that the mesh is made of, in its frame and unit"
            )
    return arrays


def _vertex(words: list[str]) -> list[float] | None:
    try:
        vertex = [float(word) for word in words]
    except ValueError:
        return None
    return vertex if len(vertex) == 3 and all(abs(x) < 1e9 for x in vertex) else None
