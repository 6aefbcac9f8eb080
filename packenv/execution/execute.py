"""Carry a plan out in physics: open loop or closed loop, from an empty container or a partly filled one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from packenv.config import EngineName
from packenv.errors import InputError, PlanError
from packenv.execution.closed_loop import WORLDS, run_closed_loop
from packenv.execution.planning_job import PlanningJob
from packenv.execution.rehearsal import Rehearsal
from packenv.geometry.convex_parts import ConvexParts
from packenv.io.executions import execution_to_json
from packenv.items.plan_items import (
    Items,
    cell_of,
    options_again,
    options_of,
    renumbered,
    require_plan,
    shelf_of,
    surfaces_of,
)
from packenv.items.shelf import ItemShelf
from packenv.planning.options import PlanOptions, rules
from packenv.planning.packing import Packing
from packenv.sim.camera import Recorder
from packenv.sim.descent import PlacementTask
from packenv.sim.disturbance import Disturbance
from packenv.sim.drop_test import Lying
from packenv.sim.plan_tasks import task_of
from packenv.sim.session import Execution, ExecutionConfig, Session, feeling
from packenv.sim.world import World
from packenv.types import Frame, Leftover, Plan, Pose
from packenv.watcher import SILENT, Watcher

if TYPE_CHECKING:
    from collections.abc import Mapping

    from packenv.robot.cell import Cell

BULGE = 0.001
"""Convex parts that reach further out of a mesh than this are remarked on, m."""


@dataclass(frozen=True, eq=False)
class ExecutedPlan:
    """A plan, and what physics made of it.

    Attributes:
        plan: as it was in the end: in closed loop, with what was planned again.
        execution: in physics.
        config: settings of the nominal world.
        disturbance: how the world differed from it; None for the nominal world.
        plans: how many plans were looked at, in closed loop; None in open loop.
        frames: the moments that were recorded; empty where none were.
        lying: items that lay in the container at the beginning.
    """

    plan: Plan
    execution: Execution
    config: ExecutionConfig
    disturbance: Disturbance | None = None
    plans: int | None = None
    frames: tuple[Frame, ...] = ()
    lying: int = 0

    @property
    def leftovers(self) -> tuple[Leftover, ...]:
        """Items that the closed loop found no place for; an open loop is judged by its plan alone."""
        return () if self.plans is None else self.plan.leftovers

    @property
    def success(self) -> bool:
        """Nothing collided, every item is inside, and in closed loop none is left over."""
        return self.execution.success and not self.leftovers

    @property
    def measured(self) -> tuple[Pose, ...]:
        """Poses at the end of the items that were placed, in packing sequence: what ``plan_rest`` takes."""
        released = sum(not outcome.collided for outcome in self.execution.items)
        return self.execution.final[: self.lying + released]

    def __repr__(self) -> str:
        """A line for people."""
        placed = len(self.measured)
        return f"<ExecutedPlan: {self.verdict}, {placed} of {len(self.plan.placements)} items placed>"

    @property
    def verdict(self) -> str:
        """``success``, or the cause of the failure and a phrase."""
        execution = self.execution
        return "success" if execution.success else f"{execution.cause}: {execution.detail}"

    def to_json(self) -> dict[str, Any]:
        """The execution as a JSON-able mapping (docs/execution.md)."""
        return execution_to_json(
            self.execution,
            self.plan.placements[self.lying :],
            self.config,
            self.disturbance,
            plan="" if self.plan.source is None else self.plan.source.name,
            plans=self.plans,
            leftovers=self.leftovers,
            placed=self.lying,
        )


def execute(
    plan: Plan,
    catalogue: Items | None = None,
    *,
    unit: str | None = None,
    feel: bool = False,
    closed_loop: bool = False,
    gentle: bool = False,
    budget: float | None = None,
    disturb: int | Disturbance | None = None,
    settle: float | None = None,
    full_settle: bool = False,
    placed: Sequence[Pose] | None = None,
    options: PlanOptions | None = None,
    engine: EngineName = "auto",
    config: ExecutionConfig | None = None,
    record: bool = False,
    gui: bool = False,
    watch: Callable[[World], None] | None = None,
    watcher: Watcher = SILENT,
) -> ExecutedPlan:
    """Let a simulated robot carry a plan out, and measure where every item ends (paper Sec. V-C).

    Args:
        plan: the plan.
        catalogue: where its items are from; None takes what the plan names.
        unit: unit of the meshes; None takes the plan's.
        feel: guarded moves: the robot feels contacts and tries beside them; part of ``closed_loop``.
        closed_loop: measure all poses after every placement, and plan the rest again where it would fail.
        budget: longest time for planning again, in closed loop, s, all in all; then the plan goes on as it is.
        gentle: lower each item until something holds it, instead of letting it drop from 1 cm above its place.
        disturb: seed of a world that is not quite as planned, or how it differs; None: the nominal one.
        settle: longest time for an item to come to rest, s; None takes that of ``config``, 20 s as in the paper.
        full_settle: wait that long after every item, at rest or not.
        placed: measured poses of the first items, where the plan was carried out in part: they lie there, and
            the execution goes on with the next one. None takes those that the plan says lay there.
        options: how to plan again, in closed loop; None takes those of the plan.
        engine: the physics engine, ``bullet``, ``mujoco`` or ``auto``: PyBullet where it is installed, else MuJoCo; of
            rehearsals in closed loop, too.
        config: settings of the nominal world, engine and all, on which the words above build.
        record: keep frames for an animation.
        gui: open PyBullet's window, which needs the engine ``bullet``.
        watch: called with the world after every step.
        watcher: is told of remarks and of progress.

    Raises:
        PhysicsError: the engine is not installed.
        InputError: the plan places no item or its robot's path is none, a mesh is not the plan's, or the
            window was closed before the end.
    """
    require_plan(plan)
    if not plan.placements:
        raise PlanError(f"{plan.label}: places no item, so there is nothing to execute")
    placed = [p.pose for p in plan.placements[: plan.lying]] if placed is None else placed
    if len(placed) > len(plan.placements):
        raise InputError(f"{len(placed)} placed poses, but the plan places {len(plan.placements)} items")
    rules()["budget"].check("budget", budget)
    made = options_of(plan)
    chosen = options_again(plan, options) if closed_loop else made
    shelf = shelf_of(
        plan, catalogue, unit=unit, options=replace(made, grid=chosen.grid), leftovers=closed_loop
    )
    names = [p.item for p in plan.placements] + [left.item for left in plan.leftovers if closed_loop]
    shelf.load(
        names,
        fields=closed_loop and chosen.constraints != "overlap",
        physics=True,
        progress=watcher.progress,
    )
    if made.shape == "mesh":
        _remark_bulges(plan, shelf.parts, watcher)
    cell = cell_of(plan)
    tasks = [_task(plan, k, shelf, cell) for k in range(len(placed), len(plan.placements))]
    if any(task.joints is None for task in tasks):
        watcher.remark(
            f"{plan.label}: tells no joints (pack --constraints robot plans them); "
            "an ideal hand without size places the items"
        )
    config = _config(
        config or ExecutionConfig.of(made.setup, engine),
        settle=settle,
        full_settle=full_settle,
        gentle=gentle,
    )
    config = feeling(config) if feel or closed_loop else config
    if isinstance(disturb, int) and disturb < 0:
        raise InputError(f"disturb is {disturb}, give a seed of at least 0")
    disturbance = Disturbance(disturb) if isinstance(disturb, int) else disturb
    recorder = Recorder() if record else None
    lying = tuple(
        Lying(shelf.physics[p.item], pose) for p, pose in zip(plan.placements, placed, strict=False)
    )
    arm = any(task.joints is not None for task in tasks)
    settings = config if disturbance is None else disturbance.config(config)

    def see(world: World) -> None:
        for look in (recorder, watch):
            if look is not None:
                look(world)

    watching = see if recorder is not None or watch is not None else None
    if gui and config.world.engine.name != "bullet":
        raise InputError(
            f"gui: is PyBullet's window, and the engine is {config.world.engine.name}; record instead"
        )
    coming = [task.item for task in tasks]
    with Session(cell, settings, arm=arm, lying=lying, coming=coming, gui=gui, watch=watching) as session:
        try:
            if closed_loop:
                again = replace(chosen, geometry=made.shape, engine=config.world.engine.name, budget=budget)
                loop = _Loop(plan, shelf, again, config, lying, watcher)
                executed = loop.run(session, disturbance)
            else:
                for step, task in enumerate(watcher.progress(tasks, "executing"), start=len(placed) + 1):
                    session.place(task if disturbance is None else disturbance.task(task, step))
                    if session.failed:
                        break
                executed = ExecutedPlan(plan, session.result(), config)
        except session.world.engine.failure:
            if session.world.open:
                raise
            raise InputError("gui: the window was closed before the execution was done") from None
    frames = () if recorder is None else recorder.frames()
    return replace(executed, disturbance=disturbance, frames=frames, lying=len(placed))


@dataclass(frozen=True, eq=False)
class _Loop:
    """What an execution in closed loop plans again with."""

    plan: Plan
    shelf: ItemShelf
    options: PlanOptions
    config: ExecutionConfig
    lying: tuple[Lying, ...]
    watcher: Watcher

    def run(self, session: Session, disturbance: Disturbance | None) -> ExecutedPlan:
        """Carry the plan out."""
        plan, shelf = self.plan, self.shelf
        try:
            surfaces = () if self.lying else surfaces_of(plan, shelf)
        except ValueError as problem:
            raise PlanError(f"{plan.label}: {problem}, plan again") from None
        job = PlanningJob(shelf, self.options, margins=False, world=self.config.world)
        rehearsal = Rehearsal(session.cell, shelf.physics, WORLDS, self.config)
        with job.planner(plan.container) as planner:
            result = run_closed_loop(
                planner,
                Packing.of_plan(plan, surfaces),
                session,
                shelf.shapes,
                shelf.prepared,
                rehearsal,
                disturbance,
                job.spares(plan.container),
                lying=self.lying,
                until=job.until,
                watcher=self.watcher,
            )
        whole = replace(plan, placements=result.placements, leftovers=result.leftovers)
        return ExecutedPlan(renumbered(whole), result.execution, self.config, plans=result.plans)


def _task(plan: Plan, index: int, shelf: ItemShelf, cell: Cell) -> PlacementTask:
    placement = plan.placements[index]
    try:
        return task_of(placement, shelf.physics[placement.item], cell)
    except PlanError as problem:
        raise PlanError(f"{plan.label}: {problem}") from None


def _remark_bulges(plan: Plan, parts: Mapping[str, ConvexParts], watcher: Watcher) -> None:
    """Say where physics knows larger items than the plan."""
    bulges = {p.item: parts[p.item].bulge for p in plan.placements if parts[p.item].bulge > BULGE}
    if bulges:
        worst = max(bulges, key=lambda name: bulges[name])
        others = f" ({len(bulges) - 1} more by less)" if len(bulges) > 1 else ""
        watcher.remark(
            f"{plan.label}: planned on meshes; in physics {worst} bulges by {bulges[worst] * 1e3:.1f} mm"
            f"{others}: plan with --geometry parts"
        )


def _config(
    config: ExecutionConfig, *, settle: float | None, full_settle: bool, gentle: bool
) -> ExecutionConfig:
    motion = config.motion
    if gentle:
        motion = replace(motion, profile=replace(motion.profile, gentle=True))
    if settle is not None:
        motion = replace(motion, settle=settle)
    if full_settle:
        motion = replace(motion, rest=None)
    return replace(config, motion=motion)
