"""Oriented items: a mesh at one orientation with its conservative heightmaps."""

from __future__ import annotations

import math
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from packenv.config import HEIGHT_QUANTUM
from packenv.geometry.raster_kernels import (
    TOUCH_TOLERANCE,
    rasterize,
    round_outward,
    settle,
    spread_back,
)
from packenv.types import FloatArray, IntArray, Item, OrientedItem

NOISE = 1e-12
"""Heights this far (m) past a quantum are rounding noise of the rotation, not material."""

_EDGES: WeakKeyDictionary[Item, tuple[IntArray, IntArray]] = WeakKeyDictionary()
"""Edges of each mesh, which do not turn with it: as long as the item lives."""


def edges_of(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Every edge once, and which edges bound each face.

    Args:
        faces: (m, 3) vertex indices.

    Returns:
        (k, 2) vertex indices, the smaller first, and (m, 3) indices of those edges.
    """
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    count = int(faces.max(initial=-1)) + 1
    keys, inverse = np.unique(ends[:, 0] * count + ends[:, 1], return_inverse=True)
    return np.column_stack(np.divmod(keys, max(count, 1))), inverse.reshape(-1, 3)


def orient_item(
    item: Item, rotation: FloatArray, *, cell_size: float, pose_index: int = 0, yaw: float = 0.0
) -> OrientedItem:
    """Rotate an item and build its top and bottom heightmaps and footprint.

    The top heightmap of a cell is the largest z of the surface over the *whole* cell, rounded up to the
    height quantum; the bottom heightmap the smallest, rounded down; the footprint every touched cell.
    Two items whose maps do not overlap at translations by whole cells can therefore not overlap.

    Args:
        item: the item.
        rotation: (3, 3) mesh frame to container axes, stable pose and yaw together.
        cell_size: m.
        pose_index: kept for the record.
        yaw: kept for the record, rad.

    Returns:
        The oriented item, smallest x, y and z at 0.
    """
    rotation = np.asarray(rotation, dtype=np.float64)
    rotated = item.vertices @ rotation.T
    low, extents = np.empty(3), np.empty(3)
    settle(rotated, low, extents)
    w, h = (max(1, math.ceil((e - TOUCH_TOLERANCE) / cell_size)) for e in extents[:2])
    edges = _EDGES.get(item)
    if edges is None:
        edges = _EDGES[item] = edges_of(item.faces)
    highest, lowest = np.full((w, h), -np.inf), np.full((w, h), np.inf)
    rasterize(rotated, item.faces, *edges, cell_size, highest, lowest)
    top, bottom = np.empty((w, h), dtype=np.float32), np.empty((w, h), dtype=np.float32)
    round_outward(highest, lowest, HEIGHT_QUANTUM, NOISE, top, bottom)
    return OrientedItem(
        item=item.name,
        pose_index=pose_index,
        yaw=yaw,
        rotation=rotation,
        offset=-low,
        extents=extents,
        com=rotation @ item.com - low,
        top=top,
        bottom=bottom,
        cell_size=cell_size,
    )


def at_phase(oriented: OrientedItem, phase: tuple[float, float]) -> OrientedItem:
    """The same item, beginning within a cell instead of at its edge.

    A cell then meets parts of up to four of the cells before, and tells the extremes of all of them: no mesh is
    read, and the maps stay conservative.

    Args:
        oriented: the item at the edge of its first cell.
        phase: (2,) how far behind that edge it begins, less than a cell, m.
    """
    w, h = oriented.top.shape
    cells = [w, h]
    for axis, inside in enumerate(phase):
        if inside > 0.0:
            size = inside + float(oriented.extents[axis]) - TOUCH_TOLERANCE
            cells[axis] = min(max(1, math.ceil(size / oriented.cell_size)), cells[axis] + 1)
    top, bottom = np.empty(cells, dtype=np.float32), np.empty(cells, dtype=np.float32)
    spread_back(oriented.top, oriented.bottom, phase[0] > 0.0, phase[1] > 0.0, top, bottom)
    return replace(oriented, top=top, bottom=bottom, phase=phase, whole=oriented)
