"""How far an item may be off sideways and still come down to its place."""

from __future__ import annotations

from packenv.planning.search.container_map import ContainerMap
from packenv.types import OrientedItem

LARGEST_OFFSET = 0.02
"""Offsets beyond this are not told apart, m."""


def largest_offset(
    surface: ContainerMap, oriented: OrientedItem, ix: int, iy: int, z: float, release: float
) -> float:
    """How far an item may be off, along x and along y at once, and meet nothing on its way down to its release.

    Wherever it is by no more than this, all beneath it and the walls are lower than the item at its release. Found on
    the conservative heightmap in whole cells, so it may be a cell more, never less.

    Args:
        surface: what the container holds before.
        oriented: the item at its orientation.
        ix: cell of its smallest x.
        iy: cell of its smallest y.
        z: height of its lowest point at its place, m.
        release: how much higher it is let go, m.

    Returns:
        m, up to :data:`LARGEST_OFFSET`; 0 also where the maps do not tell that it comes down at all.
    """
    cells = 0
    spread = surface
    while (cells + 1) * surface.cell_size <= LARGEST_OFFSET + 1e-9:
        spread = spread.spread(1)
        if spread.bound(oriented, ix, iy) > z + release:
            break
        cells += 1
    return cells * surface.cell_size
