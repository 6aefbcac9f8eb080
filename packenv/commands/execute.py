"""``robotpack execute``: carry a plan out in physics."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from packenv.commands.loading import (
    as_physics_items,
    check_meshes,
    load_convex_parts,
    load_items,
    load_plan,
    load_planned_shapes,
    plan_catalogue,
    plan_geometry,
)
from packenv.commands.output import remark, say, say_json, with_progress
from packenv.errors import InputError, PlanError
from packenv.geometry.convex_parts import ConvexParts
from packenv.io.assets import robot_urdf
from packenv.io.executions import execution_to_json, write_execution
from packenv.io.files import check_outputs
from packenv.types import Item, Leftover, Plan

if TYPE_CHECKING:
    from packenv.sim.camera import Recorder
    from packenv.sim.descent import PlacementTask
    from packenv.sim.disturbance import Disturbance
    from packenv.sim.physics_items import PhysicsItem
    from packenv.sim.session import Execution, ExecutionConfig, Session
    from packenv.sim.world import World


_LATE = 0.1
"""How much time a window may make up by showing things faster than they are, s."""

_BULGE = 0.001
"""Convex parts that reach further out of a mesh than this are remarked on, m."""


def run(arguments: argparse.Namespace) -> int:
    """Execute a plan; returns the exit code: 1 where it is no success."""
    outputs = {f"--{name}": getattr(arguments, name) for name in ("out", "gif", "html")}
    check_outputs(outputs, arguments.plan)
    import packenv.sim  # noqa: F401  says before anything is loaded where there is no physics

    if arguments.gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        raise InputError("--gui: there is no display (DISPLAY is not set); --gif FILE needs none")
    if arguments.seed is not None and not arguments.disturb:
        raise InputError(f"--seed {arguments.seed}: is of the disturbances, give --disturb as well")
    plan, items = load_plan(arguments.plan, arguments.catalogue, arguments.unit)
    if not plan.placements:
        raise PlanError(f"{arguments.plan}: places no item, so there is nothing to execute")
    catalogue = plan_catalogue(plan, arguments.catalogue, arguments.unit)
    if arguments.closed_loop:
        left_over = load_items(catalogue, {left.item for left in plan.leftovers} - items.keys())
        check_meshes(plan, arguments.plan, left_over)
        items |= left_over
    geometry = plan_geometry(plan, arguments.plan)
    parts = load_convex_parts(items, catalogue)
    if geometry == "mesh":
        _remark_bulges(plan, parts, arguments)
    physics = as_physics_items(items, parts)
    tasks = _tasks(plan, physics, arguments)

    from packenv.quiet import engine_muted
    from packenv.sim.camera import Recorder
    from packenv.sim.disturbance import Disturbance
    from packenv.sim.session import ExecutionConfig

    config = _config(ExecutionConfig(), arguments)
    disturbance = Disturbance(arguments.seed or 0) if arguments.disturb else None
    recorder = Recorder() if arguments.gif is not None else None
    carry_out = _open_loop(plan, tasks)
    if arguments.closed_loop:
        shapes = load_planned_shapes(plan, arguments.plan, items, catalogue, parts)
        carry_out = _closed_loop(plan, shapes, physics, config, arguments)
    with engine_muted() if arguments.gui else nullcontext():
        carried = _carried(plan, tasks, config, disturbance, recorder, carry_out, gui=arguments.gui)
    document = execution_to_json(
        carried.execution,
        carried.plan.placements,
        config,
        disturbance,
        plan=arguments.plan.name,
        plans=carried.plans,
        leftovers=carried.missing,
    )
    _write(carried, items, recorder, document, arguments)
    if arguments.json:
        say_json(document)
    else:
        _report(document, arguments)
    return 0 if document["success"] else 1


@dataclass(frozen=True, eq=False)
class _Carried:
    """What was carried out, and what came of it.

    Attributes:
        execution: in physics.
        plan: as it was in the end.
        plans: how many plans were looked at, in closed loop; None in open loop.
    """

    execution: Execution
    plan: Plan
    plans: int | None = None

    @property
    def missing(self) -> tuple[Leftover, ...]:
        """Items that the closed loop found no place for; an open loop is judged by its plan alone."""
        return () if self.plans is None else self.plan.leftovers


_CarryOut: TypeAlias = "Callable[[Session, Disturbance | None], _Carried]"


def _tasks(
    plan: Plan, physics: Mapping[str, PhysicsItem], arguments: argparse.Namespace
) -> list[PlacementTask]:
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


def _remark_bulges(plan: Plan, parts: Mapping[str, ConvexParts], arguments: argparse.Namespace) -> None:
    """Say where physics knows larger items than the plan."""
    bulges = {p.item: parts[p.item].bulge for p in plan.placements if parts[p.item].bulge > _BULGE}
    if bulges:
        worst = max(bulges, key=lambda name: bulges[name])
        others = f" ({len(bulges) - 1} more by less)" if len(bulges) > 1 else ""
        remark(
            f"{arguments.plan}: planned on meshes; in physics {worst} bulges by {bulges[worst] * 1e3:.1f} mm"
            f"{others}: plan with --geometry parts"
        )


def _config(config: ExecutionConfig, arguments: argparse.Namespace) -> ExecutionConfig:
    profile = replace(config.motion.profile, gentle=arguments.gentle)
    motion = replace(config.motion, settle=arguments.settle, profile=profile)
    if arguments.full_settle:
        motion = replace(motion, rest=None)
    config = replace(config, motion=motion)
    if arguments.feel or arguments.closed_loop:
        from packenv.sim.session import feeling

        config = feeling(config)
    return config


def _carried(
    plan: Plan,
    tasks: Sequence[PlacementTask],
    config: ExecutionConfig,
    disturbance: Disturbance | None,
    recorder: Recorder | None,
    carry_out: _CarryOut,
    *,
    gui: bool,
) -> _Carried:
    """Open a session, and carry a plan out in it."""
    from packenv.robot.cell import Cell
    from packenv.sim.session import Session
    from packenv.sim.world import EngineError

    urdf = robot_urdf() if any(t.joints is not None for t in tasks) else None
    settings = config if disturbance is None else disturbance.config(config)
    watch: Callable[[World], None] | None = _at_real_speed(recorder) if gui else recorder
    with Session(Cell.beside(plan.container), settings, urdf, gui=gui, watch=watch) as session:
        try:
            return carry_out(session, disturbance)
        except EngineError:
            if session.world.open:
                raise
            raise InputError("--gui: the window was closed before the execution was done") from None


def _open_loop(plan: Plan, tasks: Sequence[PlacementTask]) -> _CarryOut:
    """Place item by item as planned, up to a collision."""

    def carry_out(session: Session, disturbance: Disturbance | None) -> _Carried:
        for step, task in enumerate(with_progress(tasks, "executing"), start=1):
            session.place(task if disturbance is None else disturbance.task(task, step))
            if session.failed:
                break
        return _Carried(session.result(), plan)

    return carry_out


def _closed_loop(
    plan: Plan,
    shapes: dict[str, Item],
    physics: Mapping[str, PhysicsItem],
    config: ExecutionConfig,
    arguments: argparse.Namespace,
) -> _CarryOut:
    """Measure after every placement, and plan the rest again where it would fail."""
    from packenv.commands.planning_again import Again, renumbered

    again = Again(plan, arguments.plan, shapes, physics, config)

    def carry_out(session: Session, disturbance: Disturbance | None) -> _Carried:
        result = again.run(session, disturbance)
        return _Carried(result.execution, renumbered(plan, result), result.plans)

    return carry_out


def _at_real_speed(recorder: Recorder | None) -> Callable[[World], None]:
    """A watch that slows a simulation down to real time, for people; time lost in planning is not made up."""
    start = -math.inf

    def watch(world: World) -> None:
        if recorder is not None:
            recorder(world)
        nonlocal start
        start = max(start, time.monotonic() - world.time - _LATE)
        time.sleep(max(0.0, start + world.time - time.monotonic()))

    return watch


def _write(
    carried: _Carried,
    items: dict[str, Item],
    recorder: Recorder | None,
    document: dict[str, Any],
    arguments: argparse.Namespace,
) -> None:
    plan, execution = carried.plan, carried.execution
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
