"""``robotpack pack``: from an order to a plan."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from packenv import api
from packenv.cli.output import Terminal, say, say_json
from packenv.errors import InputError
from packenv.execution.planning_job import require_engine
from packenv.io.containers import boxes_file, parse_container, read_boxes
from packenv.io.files import check_outputs
from packenv.io.lying import PartlyFilled
from packenv.io.plans import plan_to_json
from packenv.items.catalogue import Catalogue
from packenv.items.plan_items import shelf_of
from packenv.planning.options import PRESETS, PlanOptions, option_names
from packenv.robot.files import cell_files
from packenv.shipped import BUILTIN
from packenv.types import Container, Plan
from packenv.view.show import check_suffix, show
from packenv.view.words import leftover_lines, piece_names, robustness_words, rule_words


def run(arguments: argparse.Namespace) -> int:
    """Plan an order; returns the exit code."""
    options = options_from(arguments)
    require_engine(options)
    lies = _partly_filled(arguments)
    catalogue = _catalogue(arguments, lies)
    tables = [path for path in (arguments.start, arguments.measured) if path is not None]
    tables += [arguments.order, arguments.boxes or boxes_file()]
    read = [*tables, *catalogue.files, *cell_files(arguments.cell)]
    order = api.load_order(arguments.order, catalogue)
    most = min(arguments.boxes_max, len(order.names))
    numbers = range(1, most + 1) if most > 1 else ()
    numbered = {f"{name} of box {k}": path for k in numbers for name, path in _outputs(arguments, k).items()}
    check_outputs({**_outputs(arguments), **numbered}, read)
    check_suffix(arguments.out, "--out", (".json", ""))
    check_suffix(arguments.html, "--html", (".html", ".htm"))
    check_suffix(arguments.png, "--png", (".png",))
    boxes = read_boxes(arguments.boxes)
    word = arguments.container or ("auto" if lies is None else None)
    container: Container | Sequence[Container] | None = boxes
    if word is None or word.lower() != "auto":
        container = None if word is None else parse_container(word, boxes, arguments.unit)
    watcher = Terminal()
    rest = {"unit": arguments.unit, "watcher": watcher, "workers": arguments.workers}

    def planned(chosen: PlanOptions) -> tuple[Plan, ...]:
        if container is None or most == 1:
            return (api.plan(order, container, catalogue, chosen, start=lies, **rest),)
        return api.plan_boxes(order, container, catalogue, chosen, boxes_max=most, **rest)

    if most == 1 and container is not None and _checks_itself(arguments, options):
        plans: tuple[Plan, ...] = (api.plan_rehearsed(order, container, catalogue, options, **rest),)
    else:
        plans = planned(options)
    written = [_outputs(arguments, k if len(plans) > 1 else None) for k in range(1, len(plans) + 1)]
    for plan, outputs in zip(plans, written, strict=True):
        for option, path in outputs.items():
            if option == "--out":
                api.save_plan(plan, path)
            else:
                show(plan, path, catalogue, watcher=watcher)
    if arguments.json:
        documents = [plan_to_json(plan) for plan in plans]
        say_json(documents if arguments.boxes_max > 1 else documents[0])
    else:
        for plan, outputs in zip(plans, written, strict=True):
            _report(plan, options, outputs.values())
            if len(plans) > 1:
                say()
        if len(plans) > 1:
            _report_boxes(plans)
    return 0 if all(plan.complete and _survives(plan) for plan in plans) else 1


def _checks_itself(arguments: argparse.Namespace, options: PlanOptions) -> bool:
    """Whether plans are carried out in simulation though nobody says so: for a robot, where it takes seconds."""
    from packenv.sim.engines import is_there

    others = (arguments.rehearse, arguments.geometry, arguments.start, arguments.budget, arguments.plans)
    if not is_there(api.rehearsing(options).engine):
        return False
    usual = options.constraints == "robot" and options.stability == "cautious" and options.method == "auto"
    return usual and options.goal == "items" and all(given is None for given in others)


def _partly_filled(arguments: argparse.Namespace) -> PartlyFilled | None:
    """The box of ``--start``.

    Raises:
        InputError: a file is wrong, or options contradict each other.
    """
    if arguments.start is None:
        if arguments.measured is not None:
            raise InputError("--measured: poses of what? give the plan that placed the items by --start")
        return None
    if arguments.boxes_max > 1:
        raise InputError(
            "--boxes-max: a partly filled box (--start) takes what it takes, give one of the two"
        )
    return api.load_partly_filled(arguments.start, arguments.measured)


def _catalogue(arguments: argparse.Namespace, lies: PartlyFilled | None) -> Catalogue:
    """The catalogue that the user names, else that of the plan to start from, else the built-in one."""
    if arguments.catalogue is None and lies is not None and lies.plan is not None:
        return shelf_of(lies.plan, unit=arguments.unit).catalogue
    return api.load_catalogue(arguments.catalogue or BUILTIN, unit=arguments.unit, density=arguments.density)


def _outputs(arguments: argparse.Namespace, box: int | None = None) -> dict[str, Path]:
    """The files to be written by the options that name them; ``plan-2.json`` for box 2 of several."""
    given = {f"--{name}": getattr(arguments, name) for name in ("out", "html", "png")}
    paths = {option: path for option, path in given.items() if path is not None}
    if box is None:
        return paths
    return {option: path.with_stem(f"{path.stem}-{box}") for option, path in paths.items()}


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


def _report(plan: Plan, options: PlanOptions, written: Iterable[Path]) -> None:
    packed, ordered = len(plan.placements), len(plan.placements) + len(plan.leftovers)
    names, left_over = piece_names(plan.placements), leftover_lines(plan.leftovers)
    width = max(len(name) for name in (*names, *(line.name for line in left_over), "item"))
    limits = [", ".join(plan.meshes[p.item].limits.words) for p in plan.placements]
    last = "  limits" if any(limits) else ""
    say(f"{'step':>4}  {'item':<{width}}  {'corner x, y, z (m)':<21}  {'size (m)':<21}   yaw{last}")
    for step, (p, name, words) in enumerate(zip(plan.placements, names, limits, strict=True), start=1):
        corner = " ".join(f"{round(c, 3) + 0.0:6.3f}" for c in p.corner)  # no -0.000
        size = " ".join(f"{e:6.3f}" for e in p.extents)
        row = f"{step:>4}  {name:<{width}}  {corner:<21}  {size:<21}  {math.degrees(p.yaw):3.0f}°  {words}"
        say(row.rstrip())
    for line in left_over:
        say(f"   -  {line.name:<{width}}  not packed: {line.detail}")
    say(
        f"packed {packed} of {ordered} items into {plan.container.full_label} with {rule_words(plan)}: "
        f"utilization {plan.metrics['utilization']:.1%}, height {plan.metrics['height']:.3f} m"
    )
    if "min_tilt_deg" in plan.metrics:
        say(f"every step {robustness_words(plan.metrics, 'min_')}")
    if options.cell is not None:
        say(f"cell: {options.cell.label}")
    if "rehearsal_worlds" in plan.metrics:
        survived, worlds, plans = (plan.metrics[f"rehearsal_{n}"] for n in ("survived", "worlds", "plans"))
        kept = "" if plans == 1 else f"; this one: {plan.made_by}"
        head = (
            "rehearsed: success" if _survives(plan) else "FAILED IN REHEARSAL, do not carry it out: success"
        )
        say(f"{head} in {survived} of {worlds} worlds; plans tried: {plans}{kept}")
    for path in written:
        say(f"wrote {path}")


def _report_boxes(plans: Sequence[Plan]) -> None:
    boxes = ", ".join(plan.container.full_label for plan in plans)
    packed = sum(len(plan.placements) for plan in plans)
    ordered = packed + sum(len(plan.leftovers) for plan in plans)
    say(f"{len(plans)} boxes: {boxes}: {packed} of {ordered} items")
