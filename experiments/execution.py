"""Plan random orders in several ways and carry them out in physics, in the nominal and in a disturbed world.

``python -m experiments.execution --catalogue DIR --orders 200 --json``. The paper's second table (Sec. V-C),
with more columns. Stopped and started again with the same ``--out``, it goes on.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.orders import fitting, random_orders
from benchmarks.physics_shelf import load_physics_shelf
from experiments.runs import finish
from packenv import __version__
from packenv.closed_loop import feeling, run_closed_loop
from packenv.config import GridConfig
from packenv.io.assets import assets_dir
from packenv.io.rows import row_key
from packenv.physics_planning import make_planner
from packenv.planning.assembly import PlannerChoice, Shelf
from packenv.planning.packer import Planner, by_box_volume
from packenv.planning.packing import Packing
from packenv.robot.cell import Cell
from packenv.sim.disturbance import Disturbance
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.plan_tasks import run_tasks, task_of
from packenv.sim.session import Execution, ExecutionConfig, Session
from packenv.types import Container

GRID = GridConfig()
BOX = Container(0.32, 0.32, 0.30)
CONFIG = ExecutionConfig()
WORLDS = ("nominal", "disturbed")


@dataclass(frozen=True)
class Column:
    """One way to plan and execute.

    Attributes:
        name: of the column.
        choice: of the planner.
        closed: in closed loop.
    """

    name: str
    choice: PlannerChoice
    closed: bool = False


COLUMNS = {
    column.name: column
    for column in (
        Column("overlap", PlannerChoice(constraints="overlap")),
        Column("paper", PlannerChoice()),
        Column("margin", PlannerChoice(stability="margin")),
        Column("clearance", PlannerChoice(clearance=0.01)),
        Column("physics", PlannerChoice(stability="physics", clearance=0.01)),
        Column("closed-loop", PlannerChoice(stability="physics", clearance=0.01), closed=True),
    )
}


@dataclass(frozen=True)
class Job:
    """One order in all columns that are asked for: columns of one planner share its plan."""

    columns: tuple[Column, ...]
    index: int
    order: tuple[str, ...]
    meshes: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        return row_key(__version__, GRID, CONFIG, self)


class _Worker:
    """What a worker process loads once."""

    shelf: Shelf
    physics: Mapping[str, PhysicsItem]


def prepare(catalogue: str) -> None:
    """Load the catalogue into this process, every item as its envelope."""
    loaded = load_physics_shelf(catalogue, GRID)
    _Worker.shelf, _Worker.physics = loaded.plan, loaded.physics


def work(job: Job) -> dict[str, Any]:
    """Plan one order in every column and carry it out."""
    plans: dict[PlannerChoice, tuple[Planner, Packing, float]] = {}
    columns = {}
    for column in job.columns:
        if column.choice not in plans:
            start = time.process_time()
            planner = _planner(column.choice)
            sequence = by_box_volume(job.order, _Worker.shelf.prepared)
            packing = planner.pack(sequence, _Worker.shelf.prepared, BOX)
            plans[column.choice] = planner, packing, time.process_time() - start
        planner, packing, seconds = plans[column.choice]
        found: dict[str, Any] = {
            "planned": packing.complete,
            "left_over": [(left.item, left.reason) for left in packing.leftovers],
            "plan_cpu_s": seconds,
        }
        if packing.complete:
            found["nominal"] = _carry_out(column, planner, packing, None)
            found["disturbed"] = _carry_out(column, planner, packing, Disturbance(job.index))
        columns[column.name] = found
    return {"key": job.key, "index": job.index, "order": job.order, "columns": columns}


def _planner(choice: PlannerChoice) -> Planner:
    return make_planner(choice, _Worker.shelf, BOX, GRID, _Worker.physics, CONFIG.world)


def _carry_out(
    column: Column, planner: Planner, packing: Packing, disturbance: Disturbance | None
) -> dict[str, Any]:
    start = time.process_time()
    cell, urdf = Cell.beside(BOX), assets_dir() / "robot" / "tx90.urdf"
    plans, success = 1, None
    if column.closed:
        config = feeling(CONFIG if disturbance is None else disturbance.config(CONFIG))
        shelf = _Worker.shelf
        with Session(cell, config, urdf) as session:
            looped = run_closed_loop(
                planner, packing, session, shelf.meshes, shelf.prepared, _Worker.physics, disturbance
            )
        execution, plans, success = looped.execution, looped.plans, looped.success
    else:
        tasks = [task_of(p, _Worker.physics[p.item], BOX) for p in packing.placements]
        execution = run_tasks(tasks, cell, CONFIG, urdf, disturbance)
    return {
        **_figures(execution),
        "success": execution.success if success is None else success,
        "plans": plans,
        "cpu_s": time.process_time() - start,
    }


def _figures(execution: Execution) -> dict[str, Any]:
    return {
        "cause": execution.cause,
        "detail": execution.detail,
        "drop_m": [outcome.drop_m for outcome in execution.items],
        "shift_m": [outcome.shift_m for outcome in execution.items],
        "turned": [outcome.turned_rad for outcome in execution.items],
        "at_rest": all(outcome.at_rest for outcome in execution.items),
        "simulated_s": execution.simulated_s,
    }


def summarize(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Columns over the orders that every column planned whole; and the share that each one planned."""
    by_column: dict[str, dict[int, dict[str, Any]]] = defaultdict(dict)
    for row in rows:
        for name, found in row.get("columns", {}).items():
            by_column[name][row["index"]] = found
    if not by_column:
        return {}
    common = set.intersection(*({i for i, r in c.items() if r["planned"]} for c in by_column.values()))
    columns = {}
    for name in (n for n in COLUMNS if n in by_column):
        column = by_column[name]
        same = [column[i] for i in sorted(common)]
        columns[name] = {
            "planned": statistics.mean(r["planned"] for r in column.values()),
            "orders": len(column),
            "plan_cpu_s_median": statistics.median(r["plan_cpu_s"] for r in column.values()),
            **_world(same, "nominal"),
            "disturbed": _world(same, "disturbed"),
        }
    return columns


def _world(rows: Sequence[dict[str, Any]], world: str) -> dict[str, Any]:
    if not rows:
        return {"n": 0}
    found = [row[world] for row in rows]
    drops, shifts = ([d for f in found for d in f[key]] for key in ("drop_m", "shift_m"))
    return {
        "success": statistics.mean(f["success"] for f in found),
        "n": len(found),
        "drop_cm": 100.0 * statistics.mean(drops),
        "shift_cm": 100.0 * statistics.mean(shifts),
        "causes": dict(Counter(f["cause"] or "left-over" for f in found if not f["success"])),
        "plans": statistics.mean(f["plans"] for f in found),
        "cpu_s_median": statistics.median(f["cpu_s"] for f in found),
        "cpu_s_mean": statistics.mean(f["cpu_s"] for f in found),
    }


def main() -> int:
    """Run, resume, print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--orders", type=int, default=200)
    parser.add_argument("--items", type=int, default=10, help="items an order (default: %(default)s)")
    parser.add_argument("--columns", nargs="+", choices=tuple(COLUMNS), default=list(COLUMNS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/execution.jsonl"))
    parser.add_argument("--json", action="store_true", help="accepted for symmetry: the output is JSON")
    arguments = parser.parse_args()
    prepare(arguments.catalogue)
    shelf = _Worker.shelf
    names = fitting(shelf.prepared, BOX, GRID)
    orders = random_orders(names, arguments.items, arguments.orders, arguments.seed)
    jobs = [
        Job(
            tuple(COLUMNS[name] for name in arguments.columns),
            i,
            tuple(order),
            tuple(shelf.meshes[n].sha256[:16] for n in order),
        )
        for i, order in enumerate(orders)
    ]
    done, failed = finish(
        work,
        jobs,
        out=arguments.out,
        workers=arguments.workers,
        timeout=1800,
        prepare=prepare,
        arguments=(arguments.catalogue,),
    )
    document = {"columns": summarize(done), "failed_jobs": failed}
    print(json.dumps(document, indent=1))  # noqa: T201
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
