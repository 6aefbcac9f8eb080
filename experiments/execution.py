"""Plan random orders in several ways and carry them out in physics, in the nominal and in a disturbed world.

``python -m experiments.execution --catalogue DIR --orders 200 --json``. The paper's second table (Sec. V-C),
with more columns. Stopped and started again with the same ``--out``, it goes on.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from packenv.cli.exit_codes import reported
from packenv.execution.execute import execute
from packenv.io.rows import row_key
from packenv.planning.options import PlanOptions
from packenv.sim.disturbance import Disturbance
from packenv.sim.session import Execution, feeling
from packenv.types import Item, Plan
from packenv.version import __version__

from .physics_orders import GRID, Worker, drawn_orders, options, prepare
from .plan_store import fingerprints
from .runner import finish


@dataclass(frozen=True)
class Column:
    """One way to plan and execute.

    Attributes:
        name: of the column.
        options: of the planner.
        closed: in closed loop.
        feel: the robot feels contacts, as it always does in closed loop.
    """

    name: str
    options: PlanOptions
    closed: bool = False
    feel: bool = False


REHEARSED = PlanOptions(rehearse=6)
DROPPED = PlanOptions("hm", stability="physics", clearance=0.01, rehearse=6)
COLUMNS = {
    column.name: column
    for column in (
        Column("overlap", PlanOptions("hm", constraints="overlap", stability="paper", geometry="parts")),
        Column("paper", PlanOptions("hm", stability="paper", clearance=0.0, geometry="parts")),
        Column("default-unguarded", PlanOptions()),
        Column("default", PlanOptions(), feel=True),
        Column("rehearsed", REHEARSED, feel=True),
        Column("closed-loop", REHEARSED, closed=True, feel=True),
        Column("dropped", DROPPED, feel=True),
    )
}
USUAL = ("overlap", "paper", "default-unguarded", "default", "rehearsed", "closed-loop")
"""Columns that are run unless others are named."""


@dataclass(frozen=True)
class Job:
    """One order in one column."""

    column: Column
    index: int
    order: tuple[str, ...]
    items: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        config = Worker.config
        return row_key(__version__, GRID, config, feeling(config), Disturbance(self.index), self)


_BLOCK = 50
"""Orders that are done in all columns before the next ones are begun. With few, a worker comes to carry out
a plan that another one still makes, and makes it too: a hard one takes minutes."""


def in_turn(
    columns: Sequence[Column], orders: Sequence[Sequence[str]], items: Mapping[str, Item]
) -> Iterator[Job]:
    """The jobs, column by column in blocks of orders: so two workers seldom make one plan at once."""
    for start in range(0, len(orders), _BLOCK):
        for column in columns:
            for index, order in enumerate(orders[start : start + _BLOCK], start=start):
                yield Job(column, index, tuple(order), fingerprints(items, order))


def work(job: Job) -> dict[str, Any]:
    """Plan one order in one column and carry it out."""
    stored = Worker.store.plan(job.order, job.column.options)
    row: dict[str, Any] = {
        "key": job.key,
        "index": job.index,
        "column": job.column.name,
        "order": job.order,
        "planned": stored.plan.complete,
        "left_over": [(left.item, left.reason) for left in stored.plan.leftovers],
        "plan_cpu_s": stored.cpu_s,
    }
    if stored.plan.complete:
        row["nominal"] = _carry_out(job.column, stored.plan, None)
        row["disturbed"] = _carry_out(job.column, stored.plan, job.index)
    return row


def _carry_out(column: Column, plan: Plan, disturb: int | None) -> dict[str, Any]:
    start = time.process_time()
    executed = execute(
        plan,
        Worker.store.shelf_of(column.options),
        feel=column.feel,
        closed_loop=column.closed,
        disturb=disturb,
        config=Worker.config,
    )
    return {
        **figures(executed.execution),
        "success": executed.success,
        "plans": executed.plans or 1,
        "cpu_s": time.process_time() - start,
    }


def figures(execution: Execution) -> dict[str, Any]:
    """What a row keeps of an execution; of lengths only those of items that were released."""
    released = [outcome for outcome in execution.items if not outcome.collided]
    return {
        "success": execution.success,
        "cause": execution.cause,
        "detail": execution.detail,
        "drop_m": [outcome.drop_m for outcome in released],
        "shift_m": [outcome.shift_m for outcome in released],
        "at_rest": all(outcome.at_rest for outcome in execution.items),
        "simulated_s": execution.simulated_s,
    }


def summarize(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Columns over the orders that every column planned whole; and the share that each one planned."""
    by_column: dict[str, dict[int, dict[str, Any]]] = defaultdict(dict)
    for row in rows:
        by_column[row["column"]][row["index"]] = row
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


def mean_moves(executions: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    """Mean drop and shift over all released items, cm; None where there are none."""
    moves: dict[str, float | None] = {}
    for name in ("drop", "shift"):
        lengths = [length for found in executions for length in found[f"{name}_m"]]
        moves[f"{name}_cm"] = 100.0 * statistics.mean(lengths) if lengths else None
    return moves


def _world(rows: Sequence[dict[str, Any]], world: str) -> dict[str, Any]:
    if not rows:
        return {"n": 0}
    found = [row[world] for row in rows]
    return {
        "success": statistics.mean(f["success"] for f in found),
        "n": len(found),
        **mean_moves(found),
        "causes": dict(Counter(f["cause"] or "left-over" for f in found if not f["success"])),
        "plans": statistics.mean(f["plans"] for f in found),
        "cpu_s_median": statistics.median(f["cpu_s"] for f in found),
        "cpu_s_mean": statistics.mean(f["cpu_s"] for f in found),
    }


def main() -> int:
    """Run, resume, print the table."""
    parser = options((__doc__ or "").splitlines()[0], orders=200, out="runs/execution.jsonl")
    parser.add_argument("--columns", nargs="+", choices=tuple(COLUMNS), default=list(USUAL))
    arguments = parser.parse_args()
    prepare(arguments.catalogue, arguments.plans, arguments.engine)
    columns = [COLUMNS[name] for name in arguments.columns]
    jobs = list(in_turn(columns, drawn_orders(arguments), Worker.store.shelf.shapes))
    done, failed = finish(
        work,
        jobs,
        out=arguments.out,
        workers=arguments.workers,
        timeout=1800,
        prepare=prepare,
        arguments=(arguments.catalogue, arguments.plans, arguments.engine),
    )
    document = {"columns": summarize([row for row in done if "error" not in row]), "failed_jobs": failed}
    print(json.dumps(document, indent=1))  # noqa: T201
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(reported("experiments.execution", main))
