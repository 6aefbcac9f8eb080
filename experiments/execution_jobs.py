"""One order, planned and carried out in one way: the job of every experiment on executions."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from packenv.config import EngineName
from packenv.execution.execute import ExecutedPlan, execute
from packenv.items.plan_items import shelf_for, shelf_of
from packenv.sim.engines import engine_config
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.session import Execution
from packenv.types import Container, Plan

from . import planning
from .columns import CAUTIOUS, Column
from .experiment import Experiment, Job, Row
from .orders import fitting
from .plan_store import PlanStore, fingerprints
from .results import Result
from .revision import revision
from .setting import options_of
from .spec import RunSpec

WORLDS = ("nominal", "disturbed")
"""In which a plan is carried out: as it was planned, and disturbed by a seed that is the order's index."""
TIMEOUT = 1800.0
"""Seconds after which one order in one column is given up."""
_BLOCK = 50
"""Orders that are done in all columns before the next ones are begun. With few, a worker comes to carry out
a plan that another one still makes, and makes it too: a hard one takes minutes."""


@dataclass(frozen=True)
class ExecutionJob(Job):
    """One order in one column: ``method`` is the column's name.

    Attributes:
        as_packed: as in :class:`Column`, as are the next two.
        feel: likewise.
        closed: likewise.
        engine: of the execution; never ``auto``, so that a row tells it.
        full_settle: every item gets all its time to settle, at rest or not.
    """

    as_packed: bool
    feel: bool
    closed: bool
    engine: EngineName
    full_settle: bool = False


class Worker:
    """What a worker process loads once."""

    store: PlanStore


def prepare(spec: RunSpec, folder: str) -> None:
    """Open the catalogue in this process; plans are kept in the run's folder."""
    planning.prepare(spec, folder)
    catalogue = planning.shelf_of(options_of("default")).catalogue
    Worker.store = PlanStore(Path(folder) / "plans", catalogue, revision(), spec.unit)


def in_turn(
    spec: RunSpec,
    columns: Sequence[Column],
    boxes: tuple[Container, ...],
    draw: Callable[..., list[list[str]]],
) -> Iterator[ExecutionJob]:
    """The jobs, column by column in blocks of orders: so two workers seldom make one plan at once.

    Args:
        spec: what is asked for; its engine is that of rehearsals, too, but of those of ``robotpack pack``.
        columns: ways to plan and execute.
        boxes: an order goes into the first that takes all.
        draw: the orders, of names of items.
    """
    engine = engine_config(spec.engine).name
    shelf = shelf_for(Worker.store.catalogue, CAUTIOUS)
    orders = list(planning.drawn(spec, fitting(shelf.prepared, boxes[-1], shelf.grid), boxes[-1], draw))
    for start in range(0, len(orders), _BLOCK):
        for column in columns:
            options = column.options
            if options.asks_physics:
                options = replace(options, engine=engine)
            for items, index, order in orders[start : start + _BLOCK]:
                yield ExecutionJob(
                    method=column.name,
                    constraints=options.constraints,
                    setting="",
                    items=items,
                    index=index,
                    order=tuple(order),
                    made_of=fingerprints(shelf.shapes, order),
                    boxes=boxes,
                    options=options,
                    as_packed=column.as_packed,
                    feel=column.feel,
                    closed=column.closed,
                    engine=engine,
                )


def planned(job: ExecutionJob) -> tuple[dict[str, Any], Plan]:
    """What the row tells of planning, and the plan."""
    stored = Worker.store.plan(job.order, job.boxes, job.options, as_packed=job.as_packed)
    plan = stored.plan
    told = {
        "planned": plan.complete,
        "left_over": [[left.item, left.reason] for left in plan.leftovers],
        "plan": "" if plan.source is None else f"{plan.source.parent.name}/{plan.source.name}",
        "plan_cpu_s": stored.cpu_s,
    }
    return told, plan


def work(job: ExecutionJob) -> dict[str, Any]:
    """Plan one order in one column and carry it out in both worlds, where it is planned whole."""
    row, plan = planned(job)
    if plan.complete:
        row |= {world: carry_out(job, plan, world) for world in WORLDS}
    return row


def plan_again(job: ExecutionJob) -> Plan | ExecutedPlan:
    """The plan of a job, carried out in the first world in which it fails, else in the last one; alone if not whole."""
    _, plan = planned(job)
    if not plan.complete:
        return plan
    for world in WORLDS:
        done = _executed(job, plan, world)
        if not done.success:
            break
    return done


def _executed(job: ExecutionJob, plan: Plan, world: str) -> ExecutedPlan:
    return execute(
        plan,
        Worker.store.catalogue,
        feel=job.feel,
        closed_loop=job.closed,
        disturb=None if world == "nominal" else job.index,
        full_settle=job.full_settle,
        engine=job.engine,
    )


def carry_out(job: ExecutionJob, plan: Plan, world: str) -> dict[str, Any]:
    """What a row keeps of an execution."""
    start = time.process_time()
    executed = _executed(job, plan, world)
    seconds = time.process_time() - start
    found = figures(executed.execution, shelf_of(plan, Worker.store.catalogue).physics)
    if executed.leftovers:
        found |= {"success": False, "cause": found["cause"] or "left-over"}
    return {**found, "plans": executed.plans or 1, "cpu_s": seconds}


def figures(execution: Execution, physics: Mapping[str, PhysicsItem]) -> dict[str, Any]:
    """What a row keeps of an execution; of lengths only those of items that were released.

    ``ends_m`` are the centres of mass at the end, of all items that the robot took up.
    """
    released = [outcome for outcome in execution.items if not outcome.collided]
    ends = zip((physics[outcome.item] for outcome in execution.items), execution.final, strict=True)
    return {
        "success": execution.success,
        "cause": execution.cause or "",
        "detail": execution.detail,
        "drop_m": [outcome.drop_m for outcome in released],
        "shift_m": [outcome.shift_m for outcome in released],
        "ends_m": [[float(x) for x in item.com_at(pose)] for item, pose in ends],
        "at_rest": all(outcome.at_rest for outcome in execution.items),
        "simulated_s": execution.simulated_s,
    }


def experiment(
    name: str,
    title: str,
    jobs: Callable[[RunSpec], list[ExecutionJob]],
    table: Callable[[RunSpec, Sequence[Row]], Result],
) -> Experiment:
    """An experiment on executions: all of them share their rows."""
    return Experiment(name, title, "execution", TIMEOUT, prepare, work, jobs, table, plan_again)
