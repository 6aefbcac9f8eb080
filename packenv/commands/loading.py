"""What several commands load: items by name, prepared items, a plan with its meshes."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from packenv.commands.output import remark, with_progress
from packenv.config import GridConfig
from packenv.errors import PlanError
from packenv.geometry.convex_parts import ConvexParts
from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.prepare import PreparedItem
from packenv.io.catalogues import Catalogue, open_catalogue
from packenv.io.item_cache import ItemCache
from packenv.io.parts_files import exact_parts
from packenv.io.plans import read_plan
from packenv.types import Item, Plan

if TYPE_CHECKING:
    from packenv.sim.physics_items import PhysicsItem


def load_items(catalogue: Catalogue, names: Collection[str]) -> dict[str, Item]:
    """Load the named items; say what was repaired on the way.

    Raises:
        InputError: a mesh cannot be used.
    """
    items = {name: catalogue.item(name) for name in names}
    for item in items.values():
        if item.repairs:
            remark(f"{item.file}: repaired: {'; '.join(item.repairs)}")
    return items


def prepare_items(items: dict[str, Item], grid: GridConfig) -> dict[str, PreparedItem]:
    """Read every item's stable poses and heightmaps from the user's cache, or make and keep them."""
    cache = ItemCache()
    prepared = {name: cache.get(item, grid) for name, item in items.items()}
    missing = [name for name, found in prepared.items() if found is None]
    for name in with_progress(missing, "preparing"):
        prepared[name] = cache.prepare(items[name], grid)
    return {name: found for name, found in prepared.items() if found is not None}


def load_fields(items: dict[str, Item]) -> dict[str, SurfaceField]:
    """Read every item's surface field from the user's cache, or make and keep it."""
    cache = ItemCache()
    return {name: cache.surface_field(items[name]) for name in with_progress(items, "surfaces")}


def load_convex_parts(items: dict[str, Item], catalogue: Catalogue) -> dict[str, ConvexParts]:
    """Every item's convex parts: exact ones where the catalogue has them, else from the user's cache or made.

    Raises:
        CatalogueError: a file of parts is wrong.
    """
    cache = ItemCache()
    return {
        name: exact_parts(catalogue, name) or cache.parts(item)
        for name, item in with_progress(items.items(), "convex parts")
    }


def load_physics_items(items: dict[str, Item], catalogue: Catalogue) -> dict[str, PhysicsItem]:
    """Every item as a rigid body of convex parts, or a ball.

    Raises:
        CatalogueError: a file of parts is wrong.
    """
    from packenv.sim.physics_items import PhysicsItem

    parts = load_convex_parts(items, catalogue)
    return {name: PhysicsItem.of_item(item, parts[name]) for name, item in items.items()}


def load_plan(path: Path, catalogue: str | None, unit: str | None) -> tuple[Plan, dict[str, Item]]:
    """Read a plan and the meshes of its placed items, and check that they are the meshes it was made of.

    Args:
        path: the plan file.
        catalogue: where to find the meshes; None takes the folder that the plan names.
        unit: unit of the meshes; None takes the plan's.

    Raises:
        InputError: the plan or a mesh is wrong, or a mesh is not the one that the plan was made of.
    """
    plan = read_plan(path)
    shelf = plan_catalogue(plan, catalogue, unit)
    names = list(dict.fromkeys(placement.item for placement in plan.placements))
    for name in names:
        if name not in shelf:
            raise PlanError(f"{path}: item {name!r} is not in {shelf.label}, name its folder by --catalogue")
    items = {name: shelf.item(name) for name in names}
    for name, item in items.items():
        if item.sha256 != plan.meshes[name].sha256:
            raise PlanError(
                f"{path}: {item.file} is not the mesh that the plan was made of (sha256 "
                f"{item.sha256[:12]}, not {plan.meshes[name].sha256[:12]}), plan again or name its folder "
                "by --catalogue"
            )
    return plan, items


def plan_catalogue(plan: Plan, catalogue: str | None, unit: str | None) -> Catalogue:
    """The catalogue of a plan's meshes; folder and unit that are not None replace the plan's."""
    return open_catalogue(catalogue or plan.catalogue, unit=unit or plan.unit)


def plan_cell_size(plan: Plan, path: Path) -> float:
    """The cell size that a plan was made with, m.

    Raises:
        PlanError: it is not there, or out of range.
    """
    value = plan.settings.get("cell_size")
    if not isinstance(value, (int, float)) or not 2e-4 <= value <= 0.05:
        raise PlanError(f"{path}: settings.cell_size is {value!r}, should be metres between 0.0002 and 0.05")
    return float(value)
