"""``robotpack execute``: carry a plan out in physics."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from packenv.commands.loading import load_physics_items, load_plan, plan_catalogue
from packenv.commands.output import remark, say, say_json, with_progress
from packenv.errors import InputError, PlanError
from packenv.io.assets import assets_dir
from packenv.io.executions import execution_to_json, mean_lengths, write_execution
from packenv.io.files import check_outputs
from packenv.types import Item, Plan

if TYPE_CHECKING:
    from packenv.sim.camera import Recorder
    from packenv.sim.disturbance import Disturbance
    from packenv.sim.placing import PlacementTask
    from packenv.sim.session import Execution, ExecutionConfig
    from packenv.sim.world import World


def run(arguments: argparse.Namespace) -> int:
    """Execute a plan; returns the exit code: 1 where it is no success."""
    outputs = {f"--{name}": getattr(arguments, name) for name in ("out", "gif", "html")}
    check_outputs(outputs, arguments.plan)
    if arguments.gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        raise InputError("--gui: there is no display (DISPLAY is not set); --gif FILE needs none")
    plan, items = load_plan(arguments.plan, arguments.catalogue, arguments.unit)
    if not plan.placements:
        raise PlanError(f"{arguments.plan}: places no item, so there is nothing to execute")
    tasks = _tasks(plan, items, arguments)

    from packenv.sim.camera import Recorder
    from packenv.sim.disturbance import Disturbance
    from packenv.sim.quiet import engine_muted
    from packenv.sim.session import ExecutionConfig

    config = _config(ExecutionConfig(), arguments)
    disturbance = Disturbance(arguments.seed) if arguments.disturb else None
    recorder = Recorder() if arguments.gif is not None else None
    if arguments.gui:
        with engine_muted():
            execution = _carry_out(plan, tasks, config, disturbance, recorder, gui=True)
    else:
        execution = _carry_out(plan, tasks, config, disturbance, recorder, gui=False)
    document = execution_to_json(execution, plan.placements, config, disturbance, plan=arguments.plan.name)
    _write(plan, items, execution, recorder, document, arguments)
    if arguments.json:
        say_json(document)
    else:
        _report(execution, len(plan.placements), arguments)
    return 0 if execution.success else 1


def _tasks(plan: Plan, items: dict[str, Item], arguments: argparse.Namespace) -> list[PlacementTask]:
    physics = load_physics_items(items, plan_catalogue(plan, arguments.catalogue, arguments.unit))

    from packenv.sim.plan_tasks import task_of

    tasks = []
    for placement in plan.placements:
        try:
            tasks.append(task_of(placement, physics[placement.item], plan.container))
        except PlanError as problem:
            raise PlanError(f"{arguments.plan}: {problem}") from None
    if any(task.joints is None for task in tasks):
        remark(
            f"{arguments.plan}: tells no joints (pack --constraints robot plans them); "
            "an ideal hand without size places the items"
        )
    return tasks


def _config(config: ExecutionConfig, arguments: argparse.Namespace) -> ExecutionConfig:
    motion = replace(config.motion, settle=arguments.settle, gentle=arguments.gentle)
    if arguments.full_settle:
        motion = replace(motion, rest=None)
    return replace(config, motion=motion)


def _carry_out(
    plan: Plan,
    tasks: Sequence[PlacementTask],
    config: ExecutionConfig,
    disturbance: Disturbance | None,
    recorder: Recorder | None,
    *,
    gui: bool,
) -> Execution:
    """Place item by item, up to a collision."""
    from packenv.robot.cell import Cell
    from packenv.sim.session import Session

    urdf = assets_dir() / "robot" / "tx90.urdf" if any(t.joints is not None for t in tasks) else None
    settings = config if disturbance is None else disturbance.config(config)
    watch: Callable[[World], None] | None = _at_real_speed(recorder) if gui else recorder
    with Session(Cell.beside(plan.container), settings, urdf, gui=gui, watch=watch) as session:
        for step, task in enumerate(with_progress(tasks, "executing"), start=1):
            session.place(task if disturbance is None else disturbance.task(task, step))
            if session.failed:
                break
        return session.result()


def _at_real_speed(recorder: Recorder | None) -> Callable[[World], None]:
    """A watch that slows a simulation down to real time, for people."""
    start: list[float] = []

    def watch(world: World) -> None:
        if recorder is not None:
            recorder(world)
        if not start:
            start.append(time.monotonic() - world.time)
        time.sleep(max(0.0, start[0] + world.time - time.monotonic()))

    return watch


def _write(
    plan: Plan,
    items: dict[str, Item],
    execution: Execution,
    recorder: Recorder | None,
    document: dict[str, object],
    arguments: argparse.Namespace,
) -> None:
    if arguments.out is not None:
        write_execution(arguments.out, document)
    if arguments.html is not None:
        from packenv.io.execution_scene import executed_scene
        from packenv.io.viewer import write_page

        write_page(arguments.html, executed_scene(plan, items, execution))
    if arguments.gif is not None and recorder is not None:
        from packenv.io.animation import write_gif

        frames = recorder.frames()
        write_gif(arguments.gif, plan, items, execution, frames, lambda f: with_progress(f, "drawing"))


def _report(execution: Execution, planned: int, arguments: argparse.Namespace) -> None:
    width = max(len(outcome.item) for outcome in execution.items)
    say(f"{'step':>4}  {'item':<{width}}  drop cm  shift cm  turned  at rest after")
    for step, o in enumerate(execution.items, start=1):
        if o.collided:
            say(f"{step:>4}  {o.item:<{width}}  stopped: {execution.detail}")
            continue
        rest = f"{o.settle_s:.1f} s" if o.at_rest else f"{o.settle_s:.1f} s, still moving"
        turned = f"{o.turned_rad * 57.29578:.0f}°"
        lengths = f"{o.drop_m * 100:7.2f}  {o.shift_m * 100:8.2f}"
        say(f"{step:>4}  {o.item:<{width}}  {lengths}  {turned:>6}  {rest}")
    verdict = "success" if execution.success else f"failed ({execution.cause}): {execution.detail}"
    means = mean_lengths(execution)
    lengths = (
        "" if means is None else f", drop {means[0] * 100:.2f} cm, shift {means[1] * 100:.2f} cm on average"
    )
    say(f"{verdict}; {sum(not o.collided for o in execution.items)} of {planned} items placed{lengths}")
    for option in ("out", "gif", "html"):
        if (path := getattr(arguments, option)) is not None:
            say(f"wrote {path}")
