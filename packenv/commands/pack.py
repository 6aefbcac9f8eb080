"""``robotpack pack``: from an order to a plan."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace

from packenv.commands.loading import load_fields, load_items, prepare_items
from packenv.commands.output import say, say_json
from packenv.config import GridConfig
from packenv.io.catalogues import open_catalogue
from packenv.io.containers import parse_container, read_boxes
from packenv.io.files import check_outputs
from packenv.io.orders import read_order
from packenv.io.plan_maker import make_plan
from packenv.io.plans import plan_to_json, write_plan
from packenv.planning.assembly import PlannerChoice, Shelf, assemble
from packenv.planning.packer import Packing, by_box_volume
from packenv.types import Container, Item, Plan

_SETTINGS = (
    "heuristic",
    "constraints",
    "stability",
    "contacts",
    "grasp",
    "search",
    "restarts",
    "seed",
)


def run(arguments: argparse.Namespace) -> int:
    """Plan an order; returns the exit code."""
    check_outputs({f"--{name}": getattr(arguments, name) for name in ("out", "html", "png")}, arguments.order)
    catalogue = open_catalogue(arguments.catalogue, unit=arguments.unit)
    order = read_order(arguments.order, catalogue.names)
    boxes = read_boxes(arguments.boxes)
    if arguments.container.lower() == "auto":
        containers: Sequence[Container] = sorted(boxes, key=lambda box: box.volume)
    else:
        containers = [parse_container(arguments.container, boxes)]
    grid = GridConfig()
    items = load_items(catalogue, dict.fromkeys(order.names))
    prepared = prepare_items(items, grid)
    sequence = list(order.names)
    if arguments.sequence == "volume":
        sequence = by_box_volume(sequence, prepared)
    shelf = Shelf(items, prepared, load_fields(items) if arguments.constraints != "overlap" else {})
    choice = PlannerChoice(
        arguments.heuristic,
        arguments.constraints,
        arguments.stability,
        arguments.search,
        arguments.seed,
        contacts=arguments.contacts,
        grasp=arguments.grasp,
        restarts=arguments.restarts,
        with_margin=True,
    )
    packing, choice = _smallest(containers, choice, sequence, shelf, grid)
    plan = make_plan(
        packing,
        order.lines,
        items,
        grid,
        catalogue=catalogue.label,
        unit=arguments.unit,
        settings={**{n: getattr(choice, n) for n in _SETTINGS}, "sequence": arguments.sequence},
    )
    _write(plan, packing, items, grid, arguments)
    if arguments.json:
        say_json(plan_to_json(plan))
    else:
        _report(plan, arguments)
    return 0 if plan.complete else 1


def _smallest(
    containers: Sequence[Container],
    choice: PlannerChoice,
    sequence: Sequence[str],
    shelf: Shelf,
    grid: GridConfig,
) -> tuple[Packing, PlannerChoice]:
    """The packing in the smallest container that takes all, else in the largest; and what was chosen for it.

    All but the last container are given up as soon as they are known not to do.
    """
    for box in containers[:-1]:
        brisk = replace(choice, restarts=0, give_up=True)
        packing = assemble(brisk, shelf, box, grid).pack(sequence, shelf.prepared, box)
        if packing.complete:
            return packing, brisk
    box = containers[-1]
    return assemble(choice, shelf, box, grid).pack(sequence, shelf.prepared, box), choice


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
    for option in ("out", "html", "png"):
        if (path := getattr(arguments, option)) is not None:
            say(f"wrote {path}")
