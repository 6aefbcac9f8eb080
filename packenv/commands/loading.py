"""What several commands load: items by name, prepared items, a plan with its meshes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

from packenv.commands.output import remark, with_progress
from packenv.config import GridConfig
from packenv.errors import PlanError
from packenv.geometry.convex_parts import ConvexParts
from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.prepare import PreparedItem
from packenv.io.catalogues import Catalogue, open_catalogue
from packenv.io.item_cache import ItemCache
from packenv.io.parts_files import exact_parts
from packenv.io.plans import EnvelopeRecord, read_plan
from packenv.types import Item, Plan

if TYPE_CHECKING:
    from packenv.planning.packer import Planner
    from packenv.sim.physics_items import PhysicsItem

Geometry: TypeAlias = Literal["mesh", "parts"]
"""What is planned with: an item's mesh, or its envelope: mesh and convex parts together."""

GEOMETRIES: tuple[Geometry, ...] = get_args(Geometry)

MAX_CLEARANCE = 0.05
"""Largest clearance that may be asked for, m."""


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


def load_envelopes(items: dict[str, Item], parts: Mapping[str, ConvexParts]) -> dict[str, Item]:
    """Every item with the surface of mesh and convex parts together, from the user's cache or made.

    Raises:
        MeshError: a mesh cannot be united with its parts.
    """
    cache = ItemCache()
    return {
        name: cache.envelope(item, parts[name]) for name, item in with_progress(items.items(), "envelopes")
    }


def as_physics_items(items: Mapping[str, Item], parts: Mapping[str, ConvexParts]) -> dict[str, PhysicsItem]:
    """Every item as a rigid body of its convex parts, or a ball."""
    from packenv.sim.physics_items import PhysicsItem

    return {name: PhysicsItem.of_item(item, parts[name]) for name, item in items.items()}


def end_planning(planner: Planner) -> None:
    """Free what a planner's constraints hold: one that starts anew gives up the world it tried things in."""
    for constraint in planner.constraints:
        constraint.start()


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
    check_meshes(plan, path, items)
    return plan, items


def check_meshes(plan: Plan, path: Path, items: Mapping[str, Item]) -> None:
    """Check that items are the meshes that a plan was made of.

    Raises:
        PlanError: one is not.
    """
    for name, item in items.items():
        if item.sha256 != plan.meshes[name].sha256:
            raise PlanError(
                f"{path}: {item.file} is not the mesh that the plan was made of (sha256 "
                f"{item.sha256[:12]}, not {plan.meshes[name].sha256[:12]}), plan again or name its folder "
                "by --catalogue"
            )


def plan_catalogue(plan: Plan, catalogue: str | None, unit: str | None) -> Catalogue:
    """The catalogue of a plan's meshes; folder and unit that are not None replace the plan's."""
    return open_catalogue(catalogue or plan.catalogue, unit=unit or plan.unit)


def plan_geometry(plan: Plan, path: Path) -> Geometry:
    """What a plan was made with; plans that do not tell are of meshes.

    Raises:
        PlanError: the plan says something else.
    """
    value = plan.settings.get("geometry", "mesh")
    for geometry in GEOMETRIES:
        if value == geometry:
            return geometry
    raise PlanError(f"{path}: settings.geometry is {value!r:.80}, should be one of {GEOMETRIES}")


def load_planned_shapes(
    plan: Plan,
    path: Path,
    items: dict[str, Item],
    catalogue: Catalogue,
    parts: Mapping[str, ConvexParts] | None = None,
) -> dict[str, Item]:
    """The items as the geometry that a plan was made with: as they are, or their envelopes.

    Args:
        plan: the plan.
        path: its file, for messages.
        items: items of the plan by name, as their meshes.
        catalogue: where they are from.
        parts: their convex parts, where they are known already.

    Raises:
        InputError: the plan or a file of parts is wrong, or an envelope is not the one that the plan was made
            of.
    """
    if plan_geometry(plan, path) == "mesh":
        return items
    shapes = load_envelopes(items, load_convex_parts(items, catalogue) if parts is None else parts)
    for name, shape in shapes.items():
        record = plan.meshes[name]
        if not isinstance(record, EnvelopeRecord):
            raise PlanError(
                f"{path}: meshes.{name} has no 'envelope_sha256', which plans of geometry 'parts' have"
            )
        if shape.sha256 != record.envelope_sha256:
            raise PlanError(
                f"{path}: the convex parts of {shape.file} are not those that the plan was made of "
                f"(sha256 of the envelope {shape.sha256[:12]}, not {record.envelope_sha256[:12]}), plan again"
            )
    return shapes


def plan_cell_size(plan: Plan, path: Path) -> float:
    """The cell size that a plan was made with, m.

    Raises:
        PlanError: it is not there, or out of range.
    """
    value = plan.settings.get("cell_size")
    if not isinstance(value, (int, float)) or not 2e-4 <= value <= 0.05:
        raise PlanError(f"{path}: settings.cell_size is {value!r}, should be metres between 0.0002 and 0.05")
    return float(value)
