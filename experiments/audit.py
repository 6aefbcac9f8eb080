"""Plan many random orders and audit every plan: ``python -m experiments.audit --catalogue DIR``.

Every plan goes through its file and is read back, as ``robotpack pack`` and ``robotpack verify`` would do it.
Stopped and started again with the same ``--out``, it goes on where it was; after a change of the product it starts
anew.
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.orders import fitting, random_orders
from benchmarks.runs import finish, product_code
from benchmarks.shelf import open_shelf
from experiments.runs import order_options
from packenv import api
from packenv.cli.exit_codes import reported
from packenv.config import GridConfig
from packenv.io.containers import parse_container, read_boxes
from packenv.io.rows import row_key
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import own_code
from packenv.planning.options import PlanOptions
from packenv.types import Container, Order
from packenv.verification.report import verify

GRID = GridConfig()
FINDINGS = ("overlaps", "protrusions", "blocked", "miscounted")


@dataclass(frozen=True)
class Job:
    """One order under one heuristic."""

    container: tuple[float, float, float]
    heuristic: str
    size: int
    index: int
    order: tuple[str, ...]
    meshes: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        return row_key(product_code(), GRID, self, own_code(PlanOptions(heuristic=self.heuristic)))


class _Worker:
    """What a worker process loads once."""

    shelf: ItemShelf
    container: Container


def prepare(catalogue: str, container: Container) -> None:
    """Open the catalogue in this process."""
    _Worker.shelf, _Worker.container = open_shelf(catalogue, grid=GRID), container


def work(job: Job) -> dict[str, Any]:
    """Plan an order, write the plan, read it back, audit it."""
    shelf = _Worker.shelf
    shelf.load(job.order)
    start = time.process_time()
    options = PlanOptions(heuristic=job.heuristic, constraints="overlap", restarts=0, seed=job.index)
    made = api.plan(Order.of(*job.order), _Worker.container, shelf, options)
    planned = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.json"
        api.save_plan(made, path)
        plan = api.load_plan(path, shelf)
    found = verify(plan, shelf)
    report = found.audit
    return {
        "key": job.key,
        **{k: v for k, v in asdict(job).items() if k != "meshes"},
        "packed": len(made.placements),
        "complete": made.complete,
        "utilization": made.metrics["utilization"],
        "overlaps": len(report.overlaps),
        "protrusions": len(report.protrusions),
        "blocked": len(report.blocked),
        "miscounted": len(report.miscounted) + len(found.misstated),
        "plan_cpu_s": planned - start,
        "audit_cpu_s": time.process_time() - planned,
    }


def summarize(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """One line for each size and heuristic."""
    groups = defaultdict(list)
    for row in rows:
        if "error" not in row:
            groups[row["size"], row["heuristic"]].append(row)
    return [
        {
            "items": size,
            "heuristic": heuristic,
            "orders": len(group),
            "packed_share": statistics.mean(row["complete"] for row in group),
            "utilization": statistics.mean(row["utilization"] for row in group),
            "placements": sum(row["packed"] for row in group),
            **{name: sum(row[name] for row in group) for name in FINDINGS},
            "plan_cpu_s_median": statistics.median(row["plan_cpu_s"] for row in group),
            "audit_cpu_s_median": statistics.median(row["audit_cpu_s"] for row in group),
        }
        for (size, heuristic), group in sorted(groups.items())
    ]


def main() -> int:
    """Run, resume, print the summary; exit code 1 where any plan failed its audit or any job its run."""
    parser = order_options((__doc__ or "").splitlines()[0], orders=1000, out="runs/audit.jsonl")
    parser.add_argument("--container", default="0.32x0.32x0.30")
    parser.add_argument("--sizes", type=int, nargs="+", default=[10])
    arguments = parser.parse_args()

    container = parse_container(arguments.container, read_boxes())
    prepare(arguments.catalogue, container)
    shelf = _Worker.shelf
    names = fitting(shelf.prepared, container, GRID)
    jobs = [
        Job(
            container.size,
            heuristic,
            size,
            index,
            tuple(order),
            tuple(shelf.items[name].sha256[:16] for name in order),
        )
        for size in arguments.sizes
        for index, order in enumerate(random_orders(names, size, arguments.orders, arguments.seed))
        for heuristic in arguments.heuristics
    ]
    done, failed = finish(
        work,
        jobs,
        out=arguments.out,
        workers=arguments.workers,
        timeout=600,
        prepare=prepare,
        arguments=(arguments.catalogue, container),
    )
    summary = summarize(done)
    print(json.dumps({"rows": summary, "failed_jobs": failed}, indent=1))  # noqa: T201
    found = sum(row[name] for row in summary for name in FINDINGS)
    return 1 if found or failed else 0


if __name__ == "__main__":
    sys.exit(reported("experiments.audit", main))
