"""The items of a catalogue or of a plan, for whoever plans, verifies, executes or shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from packenv.errors import CatalogueError, InputError, PlanError
from packenv.extensions import is_extension
from packenv.io.plans import read_plan
from packenv.items.catalogue import Catalogue, open_catalogue
from packenv.items.memory import items_of_meshes
from packenv.items.shelf import ItemShelf, shelf_in
from packenv.planning.options import OWN, Geometry, PlanOptions
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.replay import replay_plan
from packenv.planning.sequence import pieces_of
from packenv.robot.cell import Cell
from packenv.shipped import MEMORY
from packenv.types import Item, Plan, limits_in

if TYPE_CHECKING:
    import trimesh

Items: TypeAlias = "Catalogue | ItemShelf | str | Path | Mapping[str, Any] | trimesh.Scene"
"""Where items are from: what ``packenv.load_catalogue`` takes or gives, or a shelf that has loaded some of it."""


def catalogue_of(catalogue: Items, unit: str | None = None, density: float | None = None) -> Catalogue:
    """The catalogue that items are from."""
    if isinstance(catalogue, ItemShelf):
        return catalogue.catalogue
    if isinstance(catalogue, Catalogue):
        return catalogue
    if isinstance(catalogue, str | Path):
        return open_catalogue(catalogue, unit=unit, density=density)
    return Catalogue.of_items(items_of_meshes(catalogue, unit))


def require_plan(plan: object) -> None:
    """Refuse what is no plan.

    Raises:
        PlanError: so it is.
    """
    if not isinstance(plan, Plan):
        raise PlanError(f"{plan!r:.60} is no plan, give one, such as packenv.load_plan('plan.json')")


def options_of(plan: Plan) -> PlanOptions:
    """How a plan was made.

    Raises:
        PlanError: its settings are not options.
    """
    require_plan(plan)
    for name in ("constraints", "stability", "contacts", "grasp", "cell_size"):
        if name not in plan.settings:
            raise PlanError(f"{plan.label}: settings has no {name!r}, plan again")
    try:
        return PlanOptions.from_mapping(plan.settings, f"{plan.label}: settings")
    except InputError as problem:
        raise PlanError(str(problem)) from None


def cell_of(plan: Plan) -> Cell:
    """The robot cell that a plan was made for, with the plan's container.

    Raises:
        PlanError: the plan names a cell that is none.
    """
    given = plan.settings.get("cell")
    try:
        setup = PlanOptions.from_mapping({"cell": given}, f"{plan.label}: settings").setup
    except InputError as problem:
        raise PlanError(str(problem)) from None
    return setup.with_container(plan.container)


def options_again(
    plan: Plan, options: PlanOptions | None = None, given: Mapping[str, Any] | None = None
) -> PlanOptions:
    """How to plan again: as the caller says, else as the plan was made, unless that names own code.

    Args:
        plan: the plan.
        options: how to plan; None takes those of the plan.
        given: some of them by name, in place of the plan's.

    Raises:
        PlanError: the plan's settings are not options, or they name own code in place of which none is given:
            a file may not say which code is run.
    """
    given = given or {}
    if options is not None:
        return options.changed(given)
    if isinstance(plan.made_with, PlanOptions):  # made in this process: no file says which code is run
        return plan.made_with.changed(given)
    chosen = options_of(plan)
    heuristics = () if "heuristic" in given else (chosen.heuristic,)
    constraints = () if "own_constraints" in given else chosen.own_constraints
    for name in map(str, (*heuristics, *constraints)):
        if is_extension(name) or name == OWN:
            raise PlanError(
                f"{plan.label}: was planned with own code ({name}), which a file may not call; to plan again "
                "with it, give it again: --heuristic or --constraint, options= in a script"
            )
    return chosen.changed(given)


def shelf_for(catalogue: Items, options: PlanOptions, unit: str | None = None) -> ItemShelf:
    """A shelf of a catalogue's items for planning with some options.

    Raises:
        InputError: the catalogue cannot be opened.
    """
    if isinstance(catalogue, ItemShelf):
        return catalogue.like(options.grid, options.shape)
    return shelf_in(catalogue_of(catalogue, unit), options.grid, options.shape)


def shelf_of(
    plan: Plan,
    catalogue: Items | None = None,
    *,
    unit: str | None = None,
    options: PlanOptions | None = None,
    leftovers: bool = False,
) -> ItemShelf:
    """A shelf of a plan's items, which are those that the plan was made of.

    Args:
        plan: the plan.
        catalogue: where its items are from; None takes what the plan names.
        unit: unit of the meshes; None takes the plan's.
        options: geometry and grid; None takes those of the plan.
        leftovers: check the items that are not in the plan, too.

    Raises:
        InputError: an item is missing, or is not the one that the plan was made of.
    """
    if catalogue is None and plan.catalogue == MEMORY and plan.items:
        catalogue = Catalogue.of_items(plan.items)
    elif catalogue is None and plan.catalogue == MEMORY:
        raise PlanError(
            f"{plan.label}: its meshes were in a script's memory, in no folder; give them again: --catalogue DIR, "
            "catalogue= in a script"
        )
    elif catalogue is None or isinstance(catalogue, str | Path):
        try:
            catalogue = open_catalogue(
                catalogue or plan.catalogue, unit=unit or plan.unit, density=plan.density
            )
        except CatalogueError as problem:
            if catalogue is not None:
                raise
            raise PlanError(
                f"{plan.label}: its meshes: {problem}; or name their folder by --catalogue"
            ) from None
    made = options_of(plan)
    shelf = shelf_for(catalogue, options or made)
    limits = {name: given for name, given in limits_in(plan.order).items() if name in shelf}
    if limits:
        shelf = shelf.with_limits(limits)
    names = [p.item for p in plan.placements] + [left.item for left in plan.leftovers if leftovers]
    for name in dict.fromkeys(names):
        if name not in shelf:
            raise PlanError(
                f"{plan.label}: item {name!r} is not in {shelf.catalogue.label}, name its folder by --catalogue"
            )
        _check_mesh(plan, name, shelf, made.shape)
    return shelf


def open_plan(
    path: str | Path, catalogue: Items | None = None, *, unit: str | None = None
) -> tuple[Plan, ItemShelf]:
    """Read a plan, and open the shelf of its items once for all that is done with it.

    Args:
        path: the plan file.
        catalogue: where to find the meshes; None takes the folder that the plan names.
        unit: unit of the meshes; None takes the plan's.

    Raises:
        InputError: the plan or a mesh is wrong, or a mesh is not the one that the plan was made of.
    """
    plan = replace(read_plan(Path(path)), source=Path(path))
    shelf = shelf_of(plan, catalogue, unit=unit)
    names = [p.item for p in plan.placements]
    if plan.catalogue == MEMORY:  # no later call finds the others
        names += [left.item for left in plan.leftovers if left.item in shelf]
    return replace(plan, items={name: shelf.items[name] for name in names}), shelf


def surfaces_of(plan: Plan, shelf: ItemShelf) -> tuple[ContainerMap, ...]:
    """The container heightmap after each step of a plan.

    Raises:
        ValueError: an item is not inside the container.
    """
    return replay_plan(plan, shelf.shapes, shelf.grid.cell_size)


def renumbered(plan: Plan) -> Plan:
    """The plan with every piece of a name numbered in its sequence, placed ones first."""
    numbers = iter(pieces_of([*(p.item for p in plan.placements), *(left.item for left in plan.leftovers)]))
    placements = tuple(replace(p, instance=next(numbers).instance) for p in plan.placements)
    leftovers = tuple(replace(left, instance=next(numbers).instance) for left in plan.leftovers)
    return replace(plan, placements=placements, leftovers=leftovers)


def _check_mesh(plan: Plan, name: str, shelf: ItemShelf, made_on: Geometry) -> None:
    item: Item = shelf.items[name]
    record = plan.meshes[name]
    if item.sha256 != record.sha256:
        raise PlanError(
            f"{plan.label}: {item.file} is not the mesh that the plan was made of (sha256 "
            f"{item.sha256[:12]}, not {record.sha256[:12]}), plan again or name its folder by --catalogue"
        )
    if shelf.geometry != "parts" or made_on != "parts":
        return
    if record.envelope_sha256 is None:
        raise PlanError(
            f"{plan.label}: meshes.{name} has no 'envelope_sha256', which plans of geometry 'parts' have"
        )
    shape = shelf.shapes[name]
    if shape.sha256 != record.envelope_sha256:
        raise PlanError(
            f"{plan.label}: the convex parts of {shape.file} are not those that the plan was made of "
            f"(sha256 of the envelope {shape.sha256[:12]}, not {record.envelope_sha256[:12]}), plan again"
        )
