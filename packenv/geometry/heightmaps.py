"""Oriented items: a mesh at one orientation with its conservative heightmaps."""

from __future__ import annotations

import math

import numpy as np

from packenv.config import HEIGHT_QUANTUM
from packenv.geometry.raster_kernels import TOUCH_TOLERANCE, rasterize
from packenv.types import FloatArray, Item, OrientedItem

_NOISE = 1e-12
"""Heights this far (m) past a quantum are rounding noise of the rotation, not material."""


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
    rotated = item.vertices @ np.asarray(rotation, dtype=np.float64).T
    low = rotated.min(axis=0)
    rotated -= low
    extents = rotated.max(axis=0)
    w, h = (max(1, math.ceil((e - TOUCH_TOLERANCE) / cell_size)) for e in extents[:2])
    top = np.full((w, h), -np.inf)
    bottom = np.full((w, h), np.inf)
    rasterize(rotated, item.faces, cell_size, top, bottom)
    footprint = np.isfinite(bottom)
    quanta_up = np.ceil((top - _NOISE) / HEIGHT_QUANTUM, where=footprint, out=np.zeros((w, h)))
    quanta_down = np.floor((bottom + _NOISE) / HEIGHT_QUANTUM, where=footprint, out=np.full((w, h), np.inf))
    return OrientedItem(
        item=item.name,
        pose_index=pose_index,
        yaw=yaw,
        rotation=np.asarray(rotation, dtype=np.float64),
        offset=-low,
        extents=extents,
        com=np.asarray(rotation, dtype=np.float64) @ item.com - low,
        top=(quanta_up * HEIGHT_QUANTUM).astype(np.float32),
        bottom=(quanta_down * HEIGHT_QUANTUM).astype(np.float32),
        cell_size=cell_size,
    )
