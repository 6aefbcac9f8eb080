"""A catalogue as planning and physics need it together: every item as the envelope of mesh and parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from packenv.config import GridConfig
from packenv.io.catalogues import open_catalogue
from packenv.io.item_cache import ItemCache
from packenv.io.parts_files import exact_parts
from packenv.planning.assembly import Shelf
from packenv.sim.physics_items import PhysicsItem


@dataclass(frozen=True, eq=False)
class PhysicsShelf:
    """Every item of a catalogue, by name.

    Attributes:
        plan: for planning.
        physics: for physics.
    """

    plan: Shelf
    physics: Mapping[str, PhysicsItem]


def load_physics_shelf(catalogue: str, grid: GridConfig) -> PhysicsShelf:
    """Read a catalogue; parts, envelopes, heightmaps and surfaces come from the cache where it has them."""
    opened, cache = open_catalogue(catalogue), ItemCache()
    meshes, physics = {}, {}
    for name in opened.names:
        item = opened.item(name)
        parts = exact_parts(opened, name) or cache.parts(item)
        meshes[name] = cache.envelope(item, parts)
        physics[name] = PhysicsItem.of_item(item, parts)
    prepared = {name: cache.prepare(item, grid) for name, item in meshes.items()}
    fields = {name: cache.surface_field(item) for name, item in meshes.items()}
    return PhysicsShelf(Shelf(meshes, prepared, fields), physics)
