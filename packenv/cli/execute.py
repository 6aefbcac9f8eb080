"""``robotpack execute``: carry a plan out in physics."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

from packenv.cli.output import Terminal, say, say_json
from packenv.errors import InputError
from packenv.io.executions import write_execution
from packenv.io.files import check_outputs
from packenv.items.plan_items import open_plan, options_again
from packenv.items.shelf import ItemShelf
from packenv.planning.options import PlanOptions
from packenv.types import Plan
from packenv.view.show import check_suffix, show

if TYPE_CHECKING:
    from packenv.execution.execute import ExecutedPlan
    from packenv.sim.world import World

_RULES = {"heuristic": "--heuristic", "own_constraints": "--constraint"}
"""Options of planning again, and their flags."""

_LATE = 0.1
"""How much time a window may make up by showing things faster than they are, s."""


def run(arguments: argparse.Namespace) -> int:
    """Execute a plan; returns the exit code: 1 where it is no success."""
    from packenv.sim.engines import engine_config

    engine = engine_config(arguments.engine)  # says before anything is loaded where there is none
    if arguments.gui and engine.name != "bullet":
        raise InputError(
            f"--gui: is PyBullet's window, and the engine is {engine.name}; --gif FILE needs none"
        )
    if arguments.gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        raise InputError("--gui: there is no display (DISPLAY is not set); --gif FILE needs none")
    if arguments.seed is not None and not arguments.disturb:
        raise InputError(f"--seed {arguments.seed}: is of the disturbances, give --disturb as well")
    if arguments.budget is not None and not arguments.closed_loop:
        raise InputError(f"--budget {arguments.budget:g}: is for planning again, give --closed-loop as well")
    for name, flag in _RULES.items():
        if getattr(arguments, name) is not None and not arguments.closed_loop:
            raise InputError(f"{flag}: is for planning again, give --closed-loop as well")
    plan, shelf = open_plan(arguments.plan, arguments.catalogue, unit=arguments.unit)
    outputs = {f"--{name}": getattr(arguments, name) for name in ("out", "gif", "html")}
    check_outputs(outputs, [arguments.plan, *shelf.catalogue.files])
    check_suffix(arguments.out, "--out", (".json", ""))
    check_suffix(arguments.html, "--html", (".html", ".htm"))
    check_suffix(arguments.gif, "--gif", (".gif",))
    executed = _executed(plan, shelf, arguments)
    document = executed.to_json()
    if arguments.out is not None:
        write_execution(arguments.out, document)
    for path in (arguments.html, arguments.gif):
        if path is not None:
            show(executed, path, shelf, watcher=Terminal())
    if arguments.json:
        say_json(document)
    else:
        _report(document, arguments)
    return 0 if document["success"] else 1


def _executed(plan: Plan, shelf: ItemShelf, arguments: argparse.Namespace) -> ExecutedPlan:
    from packenv.execution.execute import execute
    from packenv.quiet import engine_muted

    with engine_muted() if arguments.gui else nullcontext():
        return execute(
            plan,
            shelf,
            feel=arguments.feel,
            closed_loop=arguments.closed_loop,
            gentle=arguments.gentle,
            disturb=(arguments.seed or 0) if arguments.disturb else None,
            settle=arguments.settle,
            full_settle=arguments.full_settle,
            options=_own_code(plan, arguments),
            engine=arguments.engine,
            budget=arguments.budget,
            record=arguments.gif is not None,
            gui=arguments.gui,
            watch=_at_real_speed() if arguments.gui else None,
            watcher=Terminal(),
        )


def _own_code(plan: Plan, arguments: argparse.Namespace) -> PlanOptions | None:
    """The plan's options with the rules that the user names; None where none is named."""
    given = {name: getattr(arguments, name) for name in _RULES if getattr(arguments, name) is not None}
    return options_again(plan, given=given) if given else None


def _at_real_speed() -> Callable[[World], None]:
    """A watch that slows a simulation down to real time, for people; time lost in planning is not made up."""
    start = -math.inf

    def watch(world: World) -> None:
        nonlocal start
        start = max(start, time.monotonic() - world.time - _LATE)
        time.sleep(max(0.0, start + world.time - time.monotonic()))

    return watch


def _report(document: dict[str, Any], arguments: argparse.Namespace) -> None:
    rows = document["items"]
    width = max(len(row["item"]) for row in rows)
    say(f"{'step':>4}  {'item':<{width}}  drop cm  shift cm  turned  at rest after")
    for row in rows:
        head = f"{row['step']:>4}  {row['item']:<{width}}"
        if row["collided"]:
            say(f"{head}  stopped: {document['detail']}")
            continue
        rest = f"{row['settle_s']:.1f} s" + ("" if row["at_rest"] else ", still moving")
        turned = f"{math.degrees(row['turned_rad']):.0f}°"
        say(f"{head}  {row['drop_m'] * 100:7.2f}  {row['shift_m'] * 100:8.2f}  {turned:>6}  {rest}")
    verdict = "success" if document["success"] else f"failed ({document['cause']}): {document['detail']}"
    lengths = ""
    if document["drop_m"] is not None:
        lengths = (
            f", drop {document['drop_m'] * 100:.2f} cm, shift {document['shift_m'] * 100:.2f} cm on average"
        )
    plans = ""
    if document["plans"] is not None:
        plans = ", planned once" if document["plans"] == 1 else f", planned {document['plans']} times"
    say(f"{verdict}; {document['placed']} of {document['planned']} items placed{lengths}{plans}")
    for option in ("out", "gif", "html"):
        if (path := getattr(arguments, option)) is not None:
            say(f"wrote {path}")
