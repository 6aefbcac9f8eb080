"""The container heightmap of items where they really lie: any pose, no whole cells."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from packenv.config import HEIGHT_QUANTUM
from packenv.geometry.heightmaps import NOISE, edges_of
from packenv.geometry.raster_kernels import rasterize
from packenv.planning.search.contact_height import ExactPile
from packenv.planning.search.container_map import ContainerMap
from packenv.types import Container, FloatArray, Item


@dataclass(frozen=True, eq=False)
class Resting:
    """An item that lies in the container.

    Attributes:
        item: the item, of the geometry that is planned with.
        rotation: (3, 3) mesh frame to container frame.
        position: (3,) m.
    """

    item: Item
    rotation: FloatArray
    position: FloatArray


def measured_map(
    container: Container,
    cell_size: float,
    resting: Iterable[Resting],
    beneath: ContainerMap | None = None,
    exact: ExactPile | None = None,
) -> ContainerMap:
    """The conservative heightmap of items at measured poses.

    As in :func:`packenv.geometry.heightmaps.orient_item` every cell tells the largest height over the whole
    cell, here of the container's own grid. What lies outside the container is left out.

    Args:
        container: the box.
        cell_size: m.
        resting: what lies in it.
        beneath: a map of what else does.
        exact: an empty pile of what may come: the map then keeps the meshes of what lies there.
    """
    surface = beneath or ContainerMap.empty(container, cell_size)
    heights = surface.heights.copy()
    nx, ny = heights.shape
    for part in resting:
        points = part.item.vertices @ part.rotation.T + part.position
        low, high = points.min(axis=0), points.max(axis=0)
        if exact is not None:
            sides = np.concatenate([low[:2], high[:2]])
            exact = exact.with_mesh(part.item, part.rotation, part.position, cell_size, sides)
        ix, iy = (math.floor(v / cell_size) for v in low[:2])
        w, h = (math.floor(v / cell_size) - i + 1 for v, i in zip(high[:2], (ix, iy), strict=True))
        top, bottom = np.full((w, h), -np.inf), np.full((w, h), np.inf)
        corner = np.array([ix * cell_size, iy * cell_size, 0.0])
        faces = part.item.faces
        rasterize(points - corner, faces, *edges_of(faces), cell_size, top, bottom)
        x0, y0, x1, y1 = max(ix, 0), max(iy, 0), min(ix + w, nx), min(iy + h, ny)
        if x0 >= x1 or y0 >= y1:
            continue
        seen = top[x0 - ix : x1 - ix, y0 - iy : y1 - iy]
        # Rounding of a pose is no material: heights of the planner's own places stay what they were.
        quanta = np.ceil((seen - NOISE) / HEIGHT_QUANTUM, where=np.isfinite(seen), out=np.zeros(seen.shape))
        window = heights[x0:x1, y0:y1]
        np.maximum(window, (quanta * HEIGHT_QUANTUM).astype(np.float32), out=window)
    return ContainerMap(container, cell_size, heights, exact)
