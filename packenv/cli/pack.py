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
from packenv.planning.options import PRESETS, PlanOptions, option_names
from packenv.robot.files import cell_files
from packenv.types import Plan
from packenv.view.show import check_suffix, show
from packenv.view.words import leftover_lines, piece_names, rule_words

_OUTPUTS = ("out", "html", "png")


def run(arguments: argparse.Namespace) -> int:
    """Plan an order; returns the exit code."""
    options = options_from(arguments)
    require_engine(options)
    catalogue = api.load_catalogue(arguments.catalogue, unit=arguments.unit, density=arguments.density)
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
    return 0 if plan.complete and _survives(plan) else 1


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


def _survives(plan: Plan) -> bool:
    """Whether a plan that was rehearsed succeeds in every world."""
    return plan.metrics.get("rehearsal_survived", 0) == plan.metrics.get("rehearsal_worlds", 0)


def _report(plan: Plan, options: PlanOptions, arguments: argparse.Namespace) -> None:
    packed, ordered = len(plan.placements), len(plan.placements) + len(plan.leftovers)
    names, left_over = piece_names(plan.placements), leftover_lines(plan.leftovers)
    width = max(len(name) for name in (*names, *(line.name for line in left_over), "item"))
    limits = [", ".join(plan.meshes[p.item].limits.words) for p in plan.placements]
    last = "  limits" if any(limits) else ""
    say(f"{'step':>4}  {'item':<{width}}  {'corner x, y, z (m)':<21}  {'size (m)':<21}   yaw{last}")
    for step, (p, name, words) in enumerate(zip(plan.placements, names, limits, strict=True), start=1):
        corner = " ".join(f"{c:6.3f}" for c in p.corner)
        size = " ".join(f"{e:6.3f}" for e in p.extents)
        row = f"{step:>4}  {name:<{width}}  {corner:<21}  {size:<21}  {math.degrees(p.yaw):3.0f}°  {words}"
        say(row.rstrip())
    for line in left_over:
        say(f"   -  {line.name:<{width}}  not packed: {line.detail}")
    say(
        f"packed {packed} of {ordered} items into {plan.container.full_label} with {rule_words(plan)}: "
        f"utilization {plan.metrics['utilization']:.1%}, height {plan.metrics['height']:.3f} m"
    )
    if options.cell is not None:
        say(f"cell: {options.cell.label}")
    if "rehearsal_worlds" in plan.metrics:
        survived, worlds, plans = (plan.metrics[f"rehearsal_{n}"] for n in ("survived", "worlds", "plans"))
        kept = "" if plan.made_by == "first" else f"; this one: {plan.made_by}"
        head = (
            "rehearsed: success" if _survives(plan) else "FAILED IN REHEARSAL, do not carry it out: success"
        )
        say(f"{head} in {survived} of {worlds} worlds; plans tried: {plans}{kept}")
    for option in _OUTPUTS:
        if (path := getattr(arguments, option)) is not None:
            say(f"wrote {path}")
