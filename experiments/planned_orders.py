"""Random orders, each planned and handed on to be carried out: what experiments on executions share.

Orders, container and columns are those of :mod:`experiments.execution`, so the rows of both tell of the same
plans, and share the files of those that are made.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from packenv.io.rows import row_key
from packenv.types import Plan
from packenv.version import __version__

from .execution import COLUMNS
from .physics_orders import GRID, Worker, drawn_orders, options, prepare
from .plan_store import fingerprints
from .runner import finish

_TIMEOUT = 3600.0


@dataclass(frozen=True)
class PlanJob:
    """One order in one column, for one experiment.

    Attributes:
        experiment: its name and whatever else its rows depend on.
        column: whose planner is asked.
        index: of the order.
        order: names of the items.
        items: what the results depend on of each of them.
    """

    experiment: str
    column: str
    index: int
    order: tuple[str, ...]
    items: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        return row_key(__version__, GRID, Worker.config, COLUMNS[self.column], self)


def planned_row(job: PlanJob) -> tuple[dict[str, Any], Plan | None]:
    """The row of a job as far as planning goes, and the plan; None where it leaves items over."""
    stored = Worker.store.plan(job.order, COLUMNS[job.column].options)
    row = {
        "key": job.key,
        "column": job.column,
        "index": job.index,
        "order": job.order,
        "planned": stored.plan.complete,
        "plan_cpu_s": stored.cpu_s,
    }
    return row, stored.plan if stored.plan.complete else None


def run(
    work: Callable[[PlanJob], dict[str, Any]],
    summarize: Callable[[Sequence[dict[str, Any]]], dict[str, Any]],
    *,
    description: str,
    experiment: str,
    orders: int,
    column: str,
    flags: Mapping[str, str] | None = None,
) -> int:
    """The program of an experiment: options, jobs without a row yet, JSON.

    Args:
        work: a job to its row; module-level, since it is pickled.
        summarize: rows without failed ones to the figures that are printed.
        description: one line.
        experiment: name of the file of rows, and what the rows depend on beside the job.
        orders: how many, unless the user says otherwise.
        column: likewise.
        flags: further options without a value, by name, with their help; those that the user gives are
            appended to ``experiment``.

    Returns:
        exit code: 1 where a job failed.
    """
    parser = options(description, orders=orders, out=f"runs/{experiment.split()[0]}.jsonl")
    blind = [name for name, c in COLUMNS.items() if not c.feel]
    parser.add_argument("--column", choices=blind, default=column, help="how to plan (default: %(default)s)")
    flags = flags or {}
    for name, text in flags.items():
        parser.add_argument(f"--{name}", action="store_true", help=text)
    arguments = parser.parse_args()
    experiment = " ".join([experiment, *(name for name in flags if getattr(arguments, name))])
    prepare(arguments.catalogue, arguments.plans, arguments.engine)
    jobs = [
        PlanJob(
            experiment, arguments.column, index, tuple(order), fingerprints(Worker.store.shelf.shapes, order)
        )
        for index, order in enumerate(drawn_orders(arguments))
    ]
    rows, failed = finish(
        work,
        jobs,
        out=arguments.out,
        workers=arguments.workers,
        timeout=_TIMEOUT,
        prepare=prepare,
        arguments=(arguments.catalogue, arguments.plans, arguments.engine),
    )
    sound = [row for row in rows if "error" not in row]
    report = {
        "column": arguments.column,
        "orders": len(sound),
        "planned": sum(row["planned"] for row in sound),
        **summarize(sound),
        "failed_jobs": failed,
    }
    print(json.dumps(report, indent=1))  # noqa: T201
    return 1 if failed else 0
