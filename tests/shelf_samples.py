"""Shelves of items that a test makes."""

from __future__ import annotations

from collections.abc import Mapping

from packenv.config import GridConfig
from packenv.items.catalogue import Catalogue
from packenv.items.shelf import ItemShelf
from packenv.planning.options import Geometry
from packenv.types import Item
from tests.shapes import box

_PLENTY = 2**29
"""Bytes: nothing is made twice, so tests may ask for the very same orientation."""

FOUR_BOXES = {
    item.name: item
    for item in (
        box(0.12, 0.10, 0.05, "slab"),
        box(0.10, 0.08, 0.06, "brick"),
        box(0.06, 0.05, 0.04, "block"),
        box(0.05, 0.05, 0.03, "cube"),
    )
}
"""Four boxes by name, largest first: few enough to plan with physics after every one."""


def shelf_of(items: Mapping[str, Item], grid: GridConfig, geometry: Geometry = "mesh") -> ItemShelf:
    """A shelf of these items, prepared when they are first asked for."""
    return ItemShelf(Catalogue.of_items(items), grid, geometry, field_memory=_PLENTY, map_memory=_PLENTY)
