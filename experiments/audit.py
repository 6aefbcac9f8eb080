"""Plan many random orders and audit every plan: ``python -m experiments.audit --catalogue DIR``.

Every plan goes through its file and is read back, as ``robotpack pack`` and ``robotpack verify`` would do it.
Stopped and started again with the same ``--out``, it goes on where it was.
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.orders import fitting, random_orders
from experiments.runs import finish, load_items, order_options
from packenv.audit import audit_plan, misstated_boxes
from packenv.config import GridConfig
from packenv.io.containers import parse_container, read_boxes
from packenv.io.plan_maker import make_plan
from packenv.io.plans import read_plan, write_plan
from packenv.io.rows import row_key
from packenv.planning.packer import by_box_volume, pack
from packenv.planning.scores import HEURISTICS
from packenv.types import Container, OrderLine
from packenv.version import __version__

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
        return row_key(__version__, GRID, self)


class _Worker:
    """What a worker process loads once."""

    meshes: dict[str, Any]
    items: dict[str, Any]
    container: Container


def prepare(catalogue: str, container: Container) -> None:
    """Load the catalogue into this process."""
    _Worker.meshes, _Worker.items = load_items(catalogue, GRID)
    _Worker.container = container


def work(job: Job) -> dict[str, Any]:
    """Plan an order, write the plan, read it back, audit it."""
    start = time.process_time()
    packing = pack(
        by_box_volume(job.order, _Worker.items),
        _Worker.items,
        _Worker.container,
        HEURISTICS[job.heuristic],
        cell_size=GRID.cell_size,
        step=GRID.step_cells,
        seed=job.index,
    )
    planned = time.process_time()
    used = {name: _Worker.meshes[name] for name in job.order}
    lines = tuple(OrderLine(name, qty) for name, qty in Counter(job.order).items())
    made = make_plan(packing, lines, used, GRID, catalogue="builtin", settings={"heuristic": job.heuristic})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.json"
        write_plan(path, made)
        plan = read_plan(path)
    report = audit_plan(plan, used)
    return {
        "key": job.key,
        **{k: v for k, v in asdict(job).items() if k != "meshes"},
        "packed": len(packing.placements),
        "complete": packing.complete,
        "utilization": packing.utilization,
        "overlaps": len(report.overlaps),
        "protrusions": len(report.protrusions),
        "blocked": len(report.blocked),
        "miscounted": len(report.miscounted) + len(misstated_boxes(plan, used)),
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
    names = fitting(_Worker.items, container, GRID)
    jobs = [
        Job(
            container.size,
            heuristic,
            size,
            index,
            tuple(order),
            tuple(_Worker.items[name].sha256[:16] for name in order),
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
    sys.exit(main())
