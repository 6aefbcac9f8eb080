"""Shelves of items that a test makes."""

from __future__ import annotations

from collections.abc import Mapping

from packenv.config import GridConfig
from packenv.io.catalogues import Catalogue
from packenv.io.shelves import ItemShelf
from packenv.planning.options import Geometry
from packenv.types import Item

_PLENTY = 2**29
"""Bytes: nothing is made twice, so tests may ask for the very same orientation."""


def shelf_of(items: Mapping[str, Item], grid: GridConfig, geometry: Geometry = "mesh") -> ItemShelf:
    """A shelf of these items, prepared when they are first asked for."""
    return ItemShelf(Catalogue.of_items(items), grid, geometry, field_memory=_PLENTY, map_memory=_PLENTY)
