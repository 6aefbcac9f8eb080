"""Whether what a plan says that its piles withstand tells which executions succeed.

Orders are planned without and with a clearance, and carried out with guarded moves and without. Each figure of a plan
is the least over its steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from packenv.items.plan_items import shelf_of
from packenv.planning.options import PlanOptions
from packenv.planning.robustness import least_of, measure_robustness

from .columns import Column
from .execution import ways
from .execution_jobs import (
    TIMEOUT,
    WORLDS,
    ExecutionJob,
    Worker,
    carry_out,
    in_turn,
    plan_again,
    planned,
    prepare,
)
from .execution_tables import Figures, Way, table
from .experiment import Experiment, Row
from .orders import random_orders
from .results import Result
from .spec import RunSpec

MEASURED = {"tilt": "min_tilt_deg", "push": "min_push", "offset": "min_offset_m"}
"""What a plan says of its piles, and its name in rows."""


def _both(clearance: float) -> tuple[Column, Column]:
    """Open loop and guarded."""
    options = PlanOptions("hm", clearance=clearance, geometry="parts")
    name = f"open loop, {clearance * 1e3:g} mm"
    return Column(name, options), Column(f"guarded, {clearance * 1e3:g} mm", options, name, feel=True)


COLUMNS = (*_both(0.0), *_both(0.005))


def jobs(spec: RunSpec) -> list[ExecutionJob]:
    """Every order with each clearance, guarded and in open loop."""
    return list(in_turn(spec, COLUMNS, (spec.box,), partial(random_orders, size=spec.items)))


def work(job: ExecutionJob) -> dict[str, Any]:
    """Plan, measure, carry out."""
    row, plan = planned(job)
    if plan.complete:
        shelf = shelf_of(plan, Worker.store.catalogue)
        row |= least_of(measure_robustness(plan, shelf.shapes, shelf.fields, job.options).values())
        row |= {world: carry_out(job, plan, world) for world in WORLDS}
    return row


def summarize(spec: RunSpec, rows: Sequence[Row]) -> Result:
    """By clearance, way and world: success, and what each figure tells of it."""
    return table(ROBUSTNESS.name, ROBUSTNESS.title, spec, ways(COLUMNS, rows, {}), more=_more)


def _more(way: Way, rows: Sequence[Row], world: str) -> Figures:
    successes = [row[world]["success"] for row in rows]
    found: Figures = {}
    for name, figure in MEASURED.items():
        values = [row[figure] for row in rows]
        found[f"{name}: thirds, %"] = " / ".join(f"{100 * share:.0f}" for share in thirds(values, successes))
        tells = told(values, successes)
        found[f"{name} tells, %"] = None if tells is None else 100.0 * tells
    return found


def thirds(figures: Sequence[float], successes: Sequence[bool]) -> list[float]:
    """Success in the third of the executions with the least figures, in the middle and in the upper one."""
    good = np.array(successes, dtype=bool)[np.argsort(figures, kind="stable")]
    return [float(third.mean()) for third in np.array_split(good, 3) if len(third)]


def told(figures: Sequence[float], successes: Sequence[bool]) -> float | None:
    """How often an execution that succeeds has a larger figure than one that fails, ties by half.

    0.5 where the figure says nothing, 1 where it says all; None where all or none succeed.
    """
    good = np.array(successes, dtype=bool)
    values = np.array(figures)
    higher, lower = values[good][:, None], values[~good]
    pairs = (higher > lower) + 0.5 * (higher == lower)
    return float(pairs.mean()) if pairs.size else None


ROBUSTNESS = Experiment(
    "robustness",
    "What figures of robustness tell",
    "robustness",
    TIMEOUT,
    prepare,
    work,
    jobs,
    summarize,
    plan_again,
)
