"""Does settling until rest give the verdict of the full 20 s?

``python -m experiments.early_rest --catalogue DIR``.

Every complete plan is carried out twice in one engine, in the nominal world: *early*, settling ends when
everything is at rest by :class:`packenv.sim.rest.RestRule`; *full*, every item gets its 20 s. All else is the
same. In the early mode items also sleep from then on until something touches them, in the full mode none ever
does: what differs between the two is the waiting and the sleep together.

In 20 s of waiting a pile creeps in Bullet. ``--converged`` carries all out, in both modes, with a contact
solver that never stops early and with friction anchors; then a pile creeps hardly at all.

The orders are planned by ``--column``; the paper's rule is the default, for its plans move more than safer
ones. JSON keys:

- ``column``, ``orders``, ``planned``: how the orders were planned, how many they are, how many plans are
  complete;
- ``n``: plans carried out twice; ``same_verdict``: share in which both modes agree on success and its cause;
  ``different``: index of the order and both details, of the others;
- ``success_early``, ``success_full``: shares that succeeded;
- ``apart_mm``: how far an item's farthest point is apart between the two modes' final poses, the largest of
  each plan that succeeded in both: ``median``, ``p95``, ``max`` over plans; ``apart_share_1mm``: share of
  those plans in which no item is farther apart than 1 mm; ``wanderers``: in how many of them each item, by
  name, is farther apart than that;
- ``simulated_s_early``, ``simulated_s_full``: means; ``cpu_s_early``, ``cpu_s_full``: medians a plan;
  ``cpu_saved``: share of all CPU-seconds that early rest saves;
- ``restless_early``: plans that succeeded early though an item was still not at rest after 20 s;
- ``failed_jobs``: rows of jobs that broke.

Stopped and started again with the same ``--out``, it goes on.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from packenv.cli.exit_codes import reported
from packenv.execution.execute import execute
from packenv.items.shelf import ItemShelf
from packenv.sim.engines import engine_config
from packenv.sim.session import Execution, ExecutionConfig
from packenv.types import Plan

from .execution import figures
from .physics_orders import Worker
from .planned_orders import PlanJob, planned_row, run
from .pose_gap import pose_gap, spread_mm

_APART = 0.001


def work(job: PlanJob) -> dict[str, Any]:
    """Plan one order and carry it out twice."""
    row, plan = planned_row(job)
    config = _converged() if "converged" in job.experiment.split() else Worker.config
    return row if plan is None else {**row, **both(plan, Worker.store.shelf, config)}


def _converged() -> ExecutionConfig:
    """A solver that never stops early, and friction anchors; these are PyBullet's alone."""
    engine = replace(engine_config("bullet"), residual=0.0, anchored=True)  # type: ignore[call-arg]
    config = Worker.config
    return replace(config, world=replace(config.world, engine=engine))


def both(plan: Plan, shelf: ItemShelf, config: ExecutionConfig) -> dict[str, Any]:
    """Carry a plan out until rest, and for the full time; how far the final poses are apart."""
    early, early_cpu = _timed(plan, shelf, config)
    full, full_cpu = _timed(plan, shelf, replace(config, motion=replace(config.motion, rest=None)))
    return {
        "items": [p.item for p in plan.placements],
        "early": {**figures(early), "cpu_s": early_cpu},
        "full": {**figures(full), "cpu_s": full_cpu},
        "apart_m": [
            pose_gap(shelf.physics[p.item], a, b)
            for p, a, b in zip(plan.placements, early.final, full.final, strict=False)
        ],
    }


def _timed(plan: Plan, shelf: ItemShelf, config: ExecutionConfig) -> tuple[Execution, float]:
    start = time.process_time()
    executed = execute(plan, shelf, config=config)
    return executed.execution, time.process_time() - start


def summarize(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Figures over the complete plans."""
    tried = [row for row in rows if "early" in row]
    if not tried:
        return {"n": 0}
    agreed = [row for row in tried if row["early"]["success"] and row["full"]["success"]]
    different = [row for row in tried if row["early"]["cause"] != row["full"]["cause"]]
    apart = [1e3 * max(row["apart_m"]) for row in agreed]
    spent = {mode: sum(row[mode]["cpu_s"] for row in tried) for mode in ("early", "full")}
    report: dict[str, Any] = {
        "n": len(tried),
        "same_verdict": 1.0 - len(different) / len(tried),
        "different": [
            {"index": row["index"], "early": row["early"]["detail"], "full": row["full"]["detail"]}
            for row in different
        ],
        "apart_mm": spread_mm(apart),
        "apart_share_1mm": None,
        "wanderers": dict(_wanderers(agreed).most_common()),
        "cpu_saved": 1.0 - spent["early"] / spent["full"],
        "restless_early": sum(row["early"]["success"] and not row["early"]["at_rest"] for row in tried),
    }
    if apart:
        report["apart_share_1mm"] = statistics.mean(d <= 1e3 * _APART for d in apart)
    for mode in ("early", "full"):
        found = [row[mode] for row in tried]
        report[f"success_{mode}"] = statistics.mean(f["success"] for f in found)
        report[f"simulated_s_{mode}"] = statistics.mean(f["simulated_s"] for f in found)
        report[f"cpu_s_{mode}"] = statistics.median(f["cpu_s"] for f in found)
    return report


def _wanderers(rows: Sequence[dict[str, Any]]) -> Counter[str]:
    return Counter(
        name
        for row in rows
        for name in {n for n, d in zip(row["items"], row["apart_m"], strict=True) if d > _APART}
    )


def main() -> int:
    """Run, resume, print."""
    return run(
        work,
        summarize,
        description=(__doc__ or "").splitlines()[0],
        experiment="early_rest",
        orders=100,
        column="paper",
        flags={"converged": "no early stop of the contact solver, friction anchors"},
    )


if __name__ == "__main__":
    sys.exit(reported("experiments.early_rest", main))
