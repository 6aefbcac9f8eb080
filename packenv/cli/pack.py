"""``robotpack pack``: from an order to a plan."""

from __future__ import annotations

import argparse
import math
from collections import Counter

from packenv import api
from packenv.cli.output import Terminal, say, say_json
from packenv.execution.planning_job import require_engine
from packenv.io.containers import boxes_file, parse_container, read_boxes
from packenv.io.files import check_outputs
from packenv.io.plans import plan_to_json
from packenv.planning.assembly import ALONE
from packenv.planning.options import AUTO, PRESETS, SINGLE_RULES, PlanOptions, heuristic_label, option_names
from packenv.robot.files import cell_files
from packenv.types import Plan
from packenv.view.show import check_suffix, show

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


def _rule(plan: Plan, options: PlanOptions) -> str:
    """The heuristic that made a plan, beside the one that was asked for."""
    asked = heuristic_label(options.heuristic)
    made = next((word for word in plan.made_by.split() if word in SINGLE_RULES), None)
    made = made or (ALONE if asked == AUTO else asked)
    if made == asked:
        return asked
    return f"{made} (auto)" if asked == AUTO else f"{made} (in place of {asked})"


def _report(plan: Plan, options: PlanOptions, arguments: argparse.Namespace) -> None:
    packed, ordered = len(plan.placements), len(plan.placements) + len(plan.leftovers)
    same = Counter((left.item, left.detail) for left in plan.leftovers)
    left_over = [(item if n == 1 else f"{item} x {n}", detail) for (item, detail), n in same.items()]
    width = max(
        len(name) for name in (*(p.item for p in plan.placements), *(n for n, _ in left_over), "item")
    )
    say(f"{'step':>4}  {'item':<{width}}  {'corner x, y, z (m)':<21}  {'size (m)':<21}  yaw")
    for step, p in enumerate(plan.placements, start=1):
        corner = " ".join(f"{c:6.3f}" for c in p.corner)
        size = " ".join(f"{e:6.3f}" for e in p.extents)
        say(f"{step:>4}  {p.item:<{width}}  {corner:<21}  {size:<21}  {math.degrees(p.yaw):3.0f}°")
    for name, detail in left_over:
        say(f"   -  {name:<{width}}  not packed: {detail}")
    say(
        f"packed {packed} of {ordered} items into {plan.container.full_label} with {_rule(plan, options)}: "
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
