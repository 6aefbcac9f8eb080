"""``robotpack pack``: from an order to a plan."""

from __future__ import annotations

import argparse
import math

from packenv import api
from packenv.cli.output import Terminal, say, say_json
from packenv.execution.planning_job import require_engine
from packenv.io.containers import boxes_file, parse_container, read_boxes
from packenv.io.files import check_outputs
from packenv.io.plans import plan_to_json
from packenv.planning.options import AUTO, PRESETS, SINGLE_RULES, PlanOptions, heuristic_label, option_names
from packenv.robot.files import cell_files
from packenv.types import Plan
from packenv.view.show import check_suffix, show

_OUTPUTS = ("out", "html", "png")


def run(arguments: argparse.Namespace) -> int:
    """Plan an order; returns the exit code."""
    options = options_from(arguments)
    require_engine(options)
    catalogue = api.load_catalogue(arguments.catalogue, unit=arguments.unit)
    read = [arguments.order, arguments.boxes or boxes_file(), *catalogue.files, *cell_files(arguments.cell)]
    check_outputs({f"--{name}": getattr(arguments, name) for name in _OUTPUTS}, read)
    check_suffix(arguments.out, "--out", (".json", ""))
    check_suffix(arguments.html, "--html", (".html", ".htm"))
    check_suffix(arguments.png, "--png", (".png",))
    order = api.load_order(arguments.order, catalogue)
    boxes = read_boxes(arguments.boxes)
    auto = arguments.container.lower() == "auto"
    container = boxes if auto else parse_container(arguments.container, boxes, arguments.unit)
    watcher = Terminal()
    plan = api.plan(order, container, catalogue, options, unit=arguments.unit, watcher=watcher)
    if arguments.out is not None:
        api.save_plan(plan, arguments.out)
    for path in (arguments.html, arguments.png):
        if path is not None:
            show(plan, path, catalogue, watcher=watcher)
    if arguments.json:
        say_json(plan_to_json(plan))
    else:
        _report(plan, options, arguments)
    return 0 if plan.complete else 1


def options_from(arguments: argparse.Namespace) -> PlanOptions:
    """The options of planning that the user gave, on top of a preset.

    Raises:
        InputError: one is wrong, or two contradict each other.
    """
    asked = {name: getattr(arguments, name, None) for name in option_names()}
    given = {name: value for name, value in asked.items() if value is not None}
    given = {name: None if value == "none" else value for name, value in given.items()}
    if "own_constraints" in given:
        given["own_constraints"] = tuple(given["own_constraints"])
    return PRESETS[arguments.preset]().changed(given)


def _report(plan: Plan, options: PlanOptions, arguments: argparse.Namespace) -> None:
    packed, ordered = len(plan.placements), len(plan.placements) + len(plan.leftovers)
    width = max([len(p.item) for p in plan.placements] + [len(left.item) for left in plan.leftovers] + [4])
    say(f"{'step':>4}  {'item':<{width}}  {'corner x, y, z (m)':<21}  {'size (m)':<21}  yaw")
    for step, p in enumerate(plan.placements, start=1):
        corner = " ".join(f"{c:6.3f}" for c in p.corner)
        size = " ".join(f"{e:6.3f}" for e in p.extents)
        say(f"{step:>4}  {p.item:<{width}}  {corner:<21}  {size:<21}  {math.degrees(p.yaw):3.0f}°")
    for left in plan.leftovers:
        say(f"   -  {left.item:<{width}}  not packed: {left.detail}")
    rule = heuristic_label(options.heuristic)
    if rule == AUTO and plan.made_by in SINGLE_RULES:
        rule = f"{plan.made_by} (auto)"
    say(
        f"packed {packed} of {ordered} items into {plan.container.label} with {rule}: "
        f"utilization {plan.metrics['utilization']:.1%}, height {plan.metrics['height']:.3f} m"
    )
    if options.cell is not None:
        say(f"cell: {options.cell.label}")
    if "rehearsal_worlds" in plan.metrics:
        survived, worlds, plans = (plan.metrics[f"rehearsal_{n}"] for n in ("survived", "worlds", "plans"))
        kept = "" if plan.made_by == "first" else f"; this one: {plan.made_by}"
        say(f"rehearsed: success in {survived} of {worlds} worlds; plans tried: {plans}{kept}")
    for option in _OUTPUTS:
        if (path := getattr(arguments, option)) is not None:
            say(f"wrote {path}")
