"""Carry the same plans out in PyBullet and in MuJoCo, and compare verdicts, poses and time.

``python -m experiments.both_engines --catalogue DIR``.

The same convex parts (balls as spheres), masses, inertia, friction, rolling resistance, robot, way down and rule of
rest; another engine. Every complete plan is carried out in both, with guarded moves, in the nominal world and in one
that is disturbed by the order's index. JSON keys, for ``nominal`` and ``disturbed`` each:

- ``n``: plans; ``bullet``, ``mujoco``: share that succeeds, with ``drop_cm`` and ``shift_cm``, means over the
  released items, and ``cpu_s_median``;
- ``agreement``: share of plans on which both agree whether they succeed; ``different``: index, and what each says, of
  the others;
- ``apart_mm``: distance of an item's farthest point between the two engines' final poses, over the plans that
  succeed in both: ``median``, ``p95``, ``max``;
- ``column``, ``orders``, ``planned``: how the orders were planned, how many, and how many whole;
- ``failed_jobs``: rows of jobs that broke.

Stopped and started again with the same ``--out``, it goes on.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Sequence
from typing import Any

from packenv.cli.exit_codes import reported
from packenv.execution.execute import execute
from packenv.items.shelf import ItemShelf
from packenv.robot.files import default_cell
from packenv.sim.session import Execution, ExecutionConfig
from packenv.types import Plan

from .execution import COLUMNS, figures, mean_moves
from .physics_orders import Worker
from .planned_orders import PlanJob, planned_row, run
from .pose_gap import pose_gap, spread_mm

ENGINES = ("bullet", "mujoco")
WORLDS = ("nominal", "disturbed")


def work(job: PlanJob) -> dict[str, Any]:
    """Plan one order and carry it out in one engine, then in the other."""
    row, plan = planned_row(job)
    if plan is None:
        return row
    shelf = Worker.store.shelf_of(COLUMNS[job.column].options)
    return {**row, "nominal": _in_both(plan, shelf, None), "disturbed": _in_both(plan, shelf, job.index)}


def _in_both(plan: Plan, shelf: ItemShelf, disturb: int | None) -> dict[str, Any]:
    done: dict[str, Execution] = {}
    found: dict[str, Any] = {}
    for engine in ENGINES:
        config = ExecutionConfig.of(default_cell(), engine)
        start = time.process_time()
        done[engine] = execute(plan, shelf, feel=True, disturb=disturb, config=config).execution
        found[engine] = {**figures(done[engine]), "cpu_s": time.process_time() - start}
    physics = shelf.physics
    poses = (done[engine].final for engine in ENGINES)
    found["apart_m"] = [
        pose_gap(physics[p.item], a, b) for p, a, b in zip(plan.placements, *poses, strict=False)
    ]
    return found


def summarize(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Figures over the complete plans."""
    tried = [row for row in rows if "nominal" in row]
    return {world: _world([{"index": row["index"], **row[world]} for row in tried]) for world in WORLDS}


def _world(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    if not rows:
        return {"n": 0}
    different = [row for row in rows if row["bullet"]["success"] != row["mujoco"]["success"]]
    both = [row for row in rows if row["bullet"]["success"] and row["mujoco"]["success"]]
    apart = [1e3 * d for row in both for d in row["apart_m"]]
    return {
        "n": len(rows),
        **{engine: _engine([row[engine] for row in rows]) for engine in ENGINES},
        "agreement": 1.0 - len(different) / len(rows),
        "different": [
            {"index": row["index"], **{engine: row[engine]["detail"] for engine in ENGINES}}
            for row in different
        ],
        "apart_mm": spread_mm(apart),
    }


def _engine(found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {
        "success": statistics.mean(f["success"] for f in found),
        **mean_moves(found),
        "cpu_s_median": statistics.median(f["cpu_s"] for f in found),
    }


def main() -> int:
    """Run, resume, print."""
    return run(
        work,
        summarize,
        description=(__doc__ or "").splitlines()[0],
        experiment="both_engines",
        orders=100,
        column="default-unguarded",
    )


if __name__ == "__main__":
    sys.exit(reported("experiments.both_engines", main))
