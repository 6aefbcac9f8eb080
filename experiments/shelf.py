"""The items of a catalogue, all of them in memory, so that no timing has a second reading in it."""

from __future__ import annotations

import sys

from packenv.config import GridConfig
from packenv.items.plan_items import catalogue_of
from packenv.items.shelf import ItemShelf
from packenv.planning.options import Geometry


def open_shelf(
    catalogue: str, geometry: Geometry = "mesh", grid: GridConfig | None = None, unit: str | None = None
) -> ItemShelf:
    """A shelf that forgets nothing; items are loaded when they are first asked for."""
    opened = catalogue_of(catalogue, unit)
    return ItemShelf(opened, grid, geometry, field_memory=sys.maxsize, map_memory=sys.maxsize)
