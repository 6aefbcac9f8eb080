"""Carry out in MuJoCo the plans that succeed in PyBullet.

``python -m experiments.second_engine --catalogue DIR``.

The same convex parts (balls as spheres), masses, inertia, friction and rolling resistance; another engine.
Item by item an ideal hand, of no size, releases 1 cm above the planned pose and without speed; then all
settle until they are at rest by the same rule, or 20 s. **The way down is not repeated**: that robot and held
item meet nothing on it is checked in PyBullet alone, against the poses that PyBullet measured. Success is
what it is there: no item more than 2 mm in another one, or in the container, when it is released, and at the
end no item more than 2 mm outside.

Only plans that are complete and succeed in PyBullet, open loop in the nominal world, are carried out again.
JSON keys:

- ``column``: how the orders were planned, as in :mod:`experiments.execution`; ``orders``, ``planned``: how
  many;
- ``n``: how many succeeded in PyBullet and were carried out in MuJoCo; ``success``: the share of ``n`` that
  succeeded there too; ``causes``: how many of the others failed by what; ``failures``: order and detail of
  each;
- ``drop_cm``, ``shift_cm``: means over all items in MuJoCo; ``first``: the same plans' ``drop_cm``,
  ``shift_cm`` in PyBullet;
- ``apart_mm``: distance of an item's farthest point between the two engines' final poses, over the plans that
  succeeded in both: ``median``, ``p95``, ``max``;
- ``restless``: successful executions in MuJoCo in which something still moved after 20 s;
- ``cpu_s_median``: CPU-seconds of an execution in MuJoCo; ``failed_jobs``: rows of jobs that broke.

Stopped and started again with the same ``--out``, it goes on. Needs the extra ``second-engine``.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.execution import figures, mean_moves
from experiments.mujoco_execution import execute_in_mujoco
from experiments.mujoco_pile import MujocoConfig
from experiments.physics_orders import BOX, CONFIG, Worker
from experiments.planned_orders import PlanJob, planned_row, run
from experiments.pose_gap import pose_gap
from packenv.cli.exit_codes import reported
from packenv.execution.execute import execute
from packenv.robot.files import default_cell
from packenv.sim.plan_tasks import task_of

MUJOCO = MujocoConfig()


def work(job: PlanJob) -> dict[str, Any]:
    """Plan one order and carry it out in one engine, then in the other."""
    row, plan = planned_row(job)
    if plan is None:
        return row
    shelf = Worker.store.shelf
    first = execute(plan, shelf, config=CONFIG).execution
    row["first"] = figures(first)
    if not first.success:
        return row
    tasks = [task_of(p, shelf.physics[p.item], default_cell().with_container(BOX)) for p in plan.placements]
    start = time.process_time()
    second = execute_in_mujoco(tasks, BOX, MUJOCO, CONFIG.motion)
    row["second"] = {**figures(second), "cpu_s": time.process_time() - start}
    row["apart_m"] = [
        pose_gap(task.item, a, b) for task, a, b in zip(tasks, first.final, second.final, strict=False)
    ]
    return row


def summarize(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Figures over the plans that succeeded in the first engine."""
    tried = [row for row in rows if "second" in row]
    if not tried:
        return {"n": 0}
    second = [row["second"] for row in tried]
    apart = [1e3 * d for row in tried if row["second"]["success"] for d in row["apart_m"]]
    return {
        "n": len(tried),
        "success": statistics.mean(s["success"] for s in second),
        **mean_moves(second),
        "causes": dict(Counter(s["cause"] for s in second if not s["success"])),
        "failures": [
            {"index": row["index"], "detail": row["second"]["detail"]}
            for row in tried
            if not row["second"]["success"]
        ],
        "first": mean_moves([row["first"] for row in tried]),
        "apart_mm": {
            "median": float(np.median(apart)),
            "p95": float(np.quantile(apart, 0.95)),
            "max": max(apart),
        }
        if apart
        else None,
        "restless": sum(s["success"] and not s["at_rest"] for s in second),
        "cpu_s_median": statistics.median(s["cpu_s"] for s in second),
    }


def main() -> int:
    """Run, resume, print."""
    return run(
        work,
        summarize,
        description=(__doc__ or "").splitlines()[0],
        experiment=f"second_engine {MUJOCO}",
        orders=50,
        column="physics",
    )


if __name__ == "__main__":
    sys.exit(reported("experiments.second_engine", main))
