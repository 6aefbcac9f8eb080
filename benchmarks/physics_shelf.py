"""A catalogue as planning and physics need it together: every item as the envelope of mesh and parts."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass

from packenv.config import GridConfig
from packenv.io.catalogues import open_catalogue
from packenv.io.shelves import ItemShelf
from packenv.planning.assembly import Shelf
from packenv.sim.physics_items import PhysicsItem
from packenv.types import Item


@dataclass(frozen=True, eq=False)
class PhysicsShelf:
    """Every item of a catalogue, by name.

    Attributes:
        items: as their meshes.
        plan: for planning.
        physics: for physics.
    """

    items: Mapping[str, Item]
    plan: Shelf
    physics: Mapping[str, PhysicsItem]


def load_physics_shelf(catalogue: str, grid: GridConfig) -> PhysicsShelf:
    """Read a catalogue; parts, envelopes, heightmaps and surfaces come from the cache where it has them.

    All of it stays in memory, so that no timing has a second reading in it.
    """
    opened = open_catalogue(catalogue)
    shelf = ItemShelf(opened, grid, "parts", field_memory=sys.maxsize, map_memory=sys.maxsize)
    plan = shelf.planning(opened.names)
    fields = {name: shelf.field(name) for name in opened.names}
    return PhysicsShelf(
        {name: shelf.item(name) for name in opened.names},
        Shelf(plan.meshes, plan.prepared, fields),
        {name: shelf.physics(name) for name in opened.names},
    )
