"""Slow, obviously correct versions of the search and the scores, straight from the paper's formulas."""

from __future__ import annotations

import numpy as np

from packenv.planning.search.container_map import ContainerMap
from packenv.types import OrientedItem


def translations(surface: ContainerMap, oriented: OrientedItem, step: int) -> list[tuple[int, int]]:
    """Every translation of the grid whose footprint is inside, x before y."""
    nx, ny = surface.heights.shape
    w, h = oriented.top.shape
    return [(x, y) for x in range(0, nx - w + 1, step) for y in range(0, ny - h + 1, step)]


def lowest_z(surface: ContainerMap, oriented: OrientedItem, x: int, y: int) -> float:
    """Paper Sec. IV-B: Z = max_i max_j (H_c[x + i, y + j] - H_b[i, j]), cell by cell."""
    z = 0.0
    w, h = oriented.top.shape
    for i in range(w):
        for j in range(h):
            if oriented.footprint[i, j]:
                z = max(z, float(surface.heights[x + i, y + j]) - float(oriented.bottom[i, j]))
    return z


def search(
    surface: ContainerMap, orientations: list[OrientedItem], step: int
) -> list[tuple[int, int, int, float]]:
    """Paper Alg. 2: (orientation, x, y, z) of every legal candidate."""
    found = []
    for k, oriented in enumerate(orientations):
        for x, y in translations(surface, oriented, step):
            z = lowest_z(surface, oriented, x, y)
            if z + float(oriented.extents[2]) <= surface.container.height + 1e-9:
                found.append((k, x, y, z))
    return found


def updated(surface: ContainerMap, oriented: OrientedItem, x: int, y: int, z: float) -> np.ndarray:
    """Paper Sec. IV-B: H'_c, cell by cell, in float64."""
    heights = surface.heights.astype(np.float64)
    w, h = oriented.top.shape
    for i in range(w):
        for j in range(h):
            if oriented.footprint[i, j]:
                heights[x + i, y + j] = max(float(oriented.top[i, j]) + z, heights[x + i, y + j])
    return heights


def hm(surface: ContainerMap, oriented: OrientedItem, x: int, y: int, z: float) -> float:
    """Paper eq. 11 with c = 1."""
    return (x + y) * surface.cell_size + float(updated(surface, oriented, x, y, z).sum())


def dblf(surface: ContainerMap, oriented: OrientedItem, x: int, y: int, z: float, c: float = 0.01) -> float:
    """Paper eq. 8; the paper's c is 1."""
    return z + c * ((x + y) * surface.cell_size)


def minz(surface: ContainerMap, oriented: OrientedItem, x: int, y: int, z: float) -> float:
    """Height of the centre of mass."""
    return z + float(oriented.com[2])


def mta(surface: ContainerMap, oriented: OrientedItem, x: int, y: int, z: float) -> float:
    """Minus the touching area, side by side of every cell."""
    cell, wall = surface.cell_size, surface.container.height
    nx, ny = surface.heights.shape
    w, h = oriented.top.shape
    cells, sides = 0, 0.0
    for i in range(w):
        for j in range(h):
            if not oriented.footprint[i, j]:
                continue
            low, high = z + float(oriented.bottom[i, j]), z + float(oriented.top[i, j])
            if low - float(surface.heights[x + i, y + j]) <= float(np.float32(cell / 2)):
                cells += 1
            for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
                if 0 <= a < w and 0 <= b < h and oriented.footprint[a, b]:
                    continue
                inside = 0 <= x + a < nx and 0 <= y + b < ny
                beside = float(surface.heights[x + a, y + b]) if inside else float(np.float32(wall))
                sides += max(0.0, min(high, beside) - low)
    return -(cells * cell**2 + sides * cell)
