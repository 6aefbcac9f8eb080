"""``robotpack pack``: from an order to a plan."""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

from packenv.commands.loading import (
    MAX_CLEARANCE,
    Geometry,
    as_physics_items,
    end_planning,
    load_convex_parts,
    load_envelopes,
    load_fields,
    load_items,
    prepare_items,
)
from packenv.commands.output import say, say_json
from packenv.config import GridConfig
from packenv.errors import InputError
from packenv.geometry.convex_parts import ConvexParts
from packenv.io.assets import robot_urdf
from packenv.io.catalogues import open_catalogue
from packenv.io.containers import parse_container, read_boxes
from packenv.io.files import check_outputs
from packenv.io.orders import read_order
from packenv.io.plan_maker import make_plan, with_envelopes
from packenv.io.plans import plan_to_json, write_plan
from packenv.planning.assembly import MAX_WORLDS, PlannerChoice, Shelf, assemble
from packenv.planning.packer import Planner, by_box_volume
from packenv.planning.packing import Packing
from packenv.types import Container, Item, Plan

if TYPE_CHECKING:
    from packenv.rehearsal import Rehearsed

_SETTINGS = (
    "heuristic",
    "constraints",
    "stability",
    "contacts",
    "grasp",
    "search",
    "restarts",
    "seed",
    "clearance",
    "rehearse",
)

_MakePlanner: TypeAlias = Callable[[PlannerChoice, Container], Planner]


def run(arguments: argparse.Namespace) -> int:
    """Plan an order; returns the exit code."""
    check_outputs({f"--{name}": getattr(arguments, name) for name in ("out", "html", "png")}, arguments.order)
    geometry = _geometry(arguments)
    choice = _choice(arguments)
    catalogue = open_catalogue(arguments.catalogue, unit=arguments.unit)
    order = read_order(arguments.order, catalogue.names)
    boxes = read_boxes(arguments.boxes)
    if arguments.container.lower() == "auto":
        containers: Sequence[Container] = sorted(boxes, key=lambda box: box.volume)
    else:
        containers = [parse_container(arguments.container, boxes)]
    grid = GridConfig()
    items = load_items(catalogue, dict.fromkeys(order.names))
    parts = load_convex_parts(items, catalogue) if geometry == "parts" else {}
    shapes = load_envelopes(items, parts) if geometry == "parts" else items
    prepared = prepare_items(shapes, grid)
    sequence = list(order.names)
    if arguments.sequence == "volume":
        sequence = by_box_volume(sequence, prepared)
    shelf = Shelf(shapes, prepared, load_fields(shapes) if choice.constraints != "overlap" else {})
    make = _planner_maker(choice, shelf, grid, parts)
    packing, choice = _smallest(containers, choice, sequence, shelf, make)
    rehearsed = None
    if choice.rehearse and packing.placements:
        rehearsed = _rehearsed(packing, sequence, shelf, parts, grid, choice, make)
        packing = rehearsed.packing
    plan = make_plan(
        packing,
        order.lines,
        items,
        grid,
        catalogue=catalogue.label,
        unit=arguments.unit,
        settings={
            **{n: getattr(choice, n) for n in _SETTINGS},
            "geometry": geometry,
            "sequence": arguments.sequence,
        },
    )
    if rehearsed is not None:
        plan = rehearsed.told_by(plan)
    if geometry == "parts":
        plan = with_envelopes(plan, shapes)
    _write(plan, packing, items, grid, arguments)
    if arguments.json:
        say_json(plan_to_json(plan))
    else:
        _report(plan, arguments)
    return 0 if plan.complete else 1


def _geometry(arguments: argparse.Namespace) -> Geometry:
    """What is planned with; refuses options that contradict each other."""
    if not 0.0 <= arguments.clearance <= MAX_CLEARANCE:
        raise InputError(
            f"--clearance {arguments.clearance:g}: is out of range, give metres from 0 to {MAX_CLEARANCE:g}"
        )
    if arguments.rehearse > MAX_WORLDS:
        raise InputError(f"--rehearse {arguments.rehearse}: is too many, give at most {MAX_WORLDS} worlds")
    physics = arguments.stability == "physics"
    if not (physics or arguments.rehearse):
        return arguments.geometry or "mesh"
    if physics and arguments.constraints == "overlap":
        raise InputError(
            "--stability physics: needs force balance, which --constraints overlap leaves out; "
            "give --constraints stability or robot"
        )
    import packenv.sim  # noqa: F401  says before the planning where there is no physics

    if arguments.geometry == "mesh":
        asks = "--stability physics" if physics else f"--rehearse {arguments.rehearse}"
        raise InputError(f"{asks}: knows convex parts alone; leave --geometry mesh out")
    return "parts"


def _choice(arguments: argparse.Namespace) -> PlannerChoice:
    return PlannerChoice(
        arguments.heuristic,
        arguments.constraints,
        arguments.stability,
        arguments.search,
        arguments.seed,
        contacts=arguments.contacts,
        grasp=arguments.grasp,
        restarts=arguments.restarts,
        with_margin=True,
        clearance=arguments.clearance,
        rehearse=arguments.rehearse,
    )


def _planner_maker(
    choice: PlannerChoice, shelf: Shelf, grid: GridConfig, parts: Mapping[str, ConvexParts]
) -> _MakePlanner:
    """What makes a planner for a container; the physics engine is loaded only where it is asked."""
    if choice.stability != "physics":
        return lambda chosen, box: assemble(chosen, shelf, box, grid)
    from packenv.physics_planning import make_planner

    physics = as_physics_items(shelf.meshes, parts)
    return lambda chosen, box: make_planner(chosen, shelf, box, grid, physics)


def _smallest(
    containers: Sequence[Container],
    choice: PlannerChoice,
    sequence: Sequence[str],
    shelf: Shelf,
    make: _MakePlanner,
) -> tuple[Packing, PlannerChoice]:
    """The packing in the smallest container that takes all, else in the largest; and what was chosen for it.

    All but the last container are given up as soon as they are known not to do. What does without a margin in
    a small box goes before a margin in a larger one.
    """
    brisk = replace(choice, restarts=0, give_up=True)
    rules = [brisk, replace(brisk, stability="paper")] if choice.stability == "cautious" else [brisk]
    for box, rule in itertools.product(containers[:-1], rules):
        packing = _packed(make(rule, box), sequence, shelf, box)
        if packing.complete:
            return packing, replace(choice, stability=rule.stability)
    box = containers[-1]
    return _packed(make(choice, box), sequence, shelf, box), choice


def _packed(planner: Planner, sequence: Sequence[str], shelf: Shelf, box: Container) -> Packing:
    try:
        return planner.pack(sequence, shelf.prepared, box)
    finally:
        end_planning(planner)


def _rehearsed(
    first: Packing,
    sequence: Sequence[str],
    shelf: Shelf,
    parts: Mapping[str, ConvexParts],
    grid: GridConfig,
    choice: PlannerChoice,
    make: _MakePlanner,
) -> Rehearsed:
    """What is left of a rehearsal."""
    from packenv.physics_planning import make_spares
    from packenv.rehearsal import Rehearsal, pack_rehearsed

    box = first.container
    planner, spares = make(choice, box), make_spares(choice, shelf, box, grid)
    physics = as_physics_items(shelf.meshes, parts)
    rehearsal = Rehearsal(box, physics, robot_urdf(), choice.rehearse)
    try:
        return pack_rehearsed(planner, sequence, shelf.prepared, rehearsal, first=first, spares=spares)
    finally:
        end_planning(planner)


def _write(
    plan: Plan,
    packing: Packing,
    items: dict[str, Item],
    grid: GridConfig,
    arguments: argparse.Namespace,
) -> None:
    if arguments.out is not None:
        write_plan(arguments.out, plan)
    if arguments.html is None and arguments.png is None:
        return
    from packenv.io.scene import build_scene

    scene = build_scene(plan, items, [surface.heights for surface in packing.surfaces], grid.cell_size)
    if arguments.html is not None:
        from packenv.io.viewer import write_page

        write_page(arguments.html, scene)
    if arguments.png is not None:
        from packenv.io.picture import render_plan_png

        render_plan_png(arguments.png, scene)


def _report(plan: Plan, arguments: argparse.Namespace) -> None:
    packed, ordered = len(plan.placements), len(plan.placements) + len(plan.leftovers)
    width = max([len(p.item) for p in plan.placements] + [len(left.item) for left in plan.leftovers] + [4])
    say(f"{'step':>4}  {'item':<{width}}  {'corner x, y, z (m)':<21}  {'size (m)':<21}  yaw")
    for step, p in enumerate(plan.placements, start=1):
        corner = " ".join(f"{c:6.3f}" for c in p.corner)
        size = " ".join(f"{e:6.3f}" for e in p.extents)
        say(f"{step:>4}  {p.item:<{width}}  {corner:<21}  {size:<21}  {math.degrees(p.yaw):3.0f}°")
    for left in plan.leftovers:
        say(f"   -  {left.item:<{width}}  not packed: {left.detail}")
    say(
        f"packed {packed} of {ordered} items into {plan.container.label} with {arguments.heuristic}: "
        f"utilization {plan.metrics['utilization']:.1%}, height {plan.metrics['height']:.3f} m"
    )
    if "rehearsal_worlds" in plan.metrics:
        survived, worlds, plans = (plan.metrics[f"rehearsal_{n}"] for n in ("survived", "worlds", "plans"))
        how = plan.settings["rehearsed_plan"]
        kept = "" if how == "first" else f"; this one: {how}"
        say(f"rehearsed: success in {survived} of {worlds} worlds; plans tried: {plans}{kept}")
    for option in ("out", "html", "png"):
        if (path := getattr(arguments, option)) is not None:
            say(f"wrote {path}")
