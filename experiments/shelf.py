"""The items of a catalogue, in memory as far as it reaches, so that no timing has a second reading in it."""

from __future__ import annotations

from packenv.config import GridConfig
from packenv.items.plan_items import catalogue_of
from packenv.items.shelf import ItemShelf
from packenv.planning.options import Geometry

MEMORY = 2**30
"""Bytes of surfaces, and as many of heightmaps, that a worker keeps: more than those of some 200 scans."""


def open_shelf(
    catalogue: str,
    geometry: Geometry = "mesh",
    grid: GridConfig | None = None,
    unit: str | None = None,
    *,
    memory: int = MEMORY,
) -> ItemShelf:
    """A shelf that forgets nothing until its memory is full; items are loaded when they are first asked for."""
    opened = catalogue_of(catalogue, unit)
    return ItemShelf(opened, grid, geometry, field_memory=memory, map_memory=memory)
