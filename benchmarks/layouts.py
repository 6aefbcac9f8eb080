"""What becomes of layouts: ``python -m benchmarks.layouts [--catalogue DIR] [--json]``.

All items of an order are arranged by ``separate``, for so many CPU-seconds at most. Of the layouts is told how many
are ``free`` of overlap; ``at_once`` have a sequence in which all pieces can be lowered straight from above, and how
many are ``loadable`` after ways that block each other in a cycle were closed. Each layout that is free is then lowered
piece by piece until the meshes touch, what fails at its place comes at the end, by the planner: how many plans are
whole by non-overlap alone, by force balance too, and with the robot (``overlap``, ``stability``, ``robot``), and how
many of the latter PyBullet carries out to the end (``executed``). Stopped and started again with the same ``--out``,
it goes on.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from packenv.agents.summary import mean, proportion
from packenv.cli.exit_codes import reported
from packenv.cli.pack import options_from
from packenv.cli.parser import grid_options, planning_options
from packenv.execution.execute import execute
from packenv.execution.planning_job import PlanningJob
from packenv.experiments.orders import fitting, random_orders
from packenv.experiments.revision import revision
from packenv.experiments.runner import Pool, finish
from packenv.experiments.shelf import open_shelf
from packenv.io.containers import parse_container, read_boxes
from packenv.io.rows import row_key
from packenv.items.plan_maker import make_plan
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import own_code
from packenv.planning.layouts.effort import Effort
from packenv.planning.layouts.layout import Arrangement
from packenv.planning.layouts.layout_packer import LayoutPacker
from packenv.planning.layouts.loading import loading_sequence
from packenv.planning.options import PlanOptions
from packenv.types import Container, Order

LEVELS = ("overlap", "stability", "robot")
"""Constraints by which layouts are lowered."""
OUTCOMES = ("free", "at_once", "loadable", *LEVELS, "executed")
"""What a layout may be, or become."""


@dataclass(frozen=True)
class Job:
    """One order."""

    options: PlanOptions
    container: tuple[float, float, float]
    seconds: float
    order: tuple[str, ...]
    meshes: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        return row_key(self, own_code(self.options))


class _Worker:
    """What a worker process loads once."""

    shelf: ItemShelf


def prepare(catalogue: str, options: PlanOptions) -> None:
    """Open the catalogue in this process."""
    _Worker.shelf = open_shelf(catalogue, options.geometry or "parts", options.grid)


def layout_packer(options: PlanOptions, box: Container, order: Sequence[str]) -> LayoutPacker:
    """What makes layouts and lowers them as the options ask; the items are loaded."""
    job = PlanningJob(_Worker.shelf, options, margins=False)
    job.load(set(order))
    found = job.packer(box)
    assert isinstance(found, LayoutPacker)
    return found


class _Watch:
    """Looks at every layout without overlap, and tries none out."""

    def __init__(self) -> None:
        self.done, self.free, self.at_once, self.loadable = False, False, False, False

    def __call__(self, arrangement: Arrangement) -> bool:
        if arrangement.overlap:
            return False
        everything = np.ones(len(arrangement.pieces), dtype=np.bool_)
        whole = len(loading_sequence(arrangement, everything)) == len(everything)
        self.at_once = self.at_once or (whole and not self.free)
        self.free, self.loadable = True, self.loadable or whole
        return True


def work(job: Job) -> dict[str, Any]:
    """Arrange one order, lower it by each level of constraints, and carry the last plan out."""
    shelf, box = _Worker.shelf, Container(*job.container)
    each = {level: job.options.changed({"constraints": level}) for level in LEVELS}
    packers = {level: layout_packer(options, box, job.order) for level, options in each.items()}
    prepared = {name: shelf.prepared[name] for name in job.order}
    sequence = PlanningJob(shelf, job.options).sequence(job.order)
    watch, began = _Watch(), time.process_time()
    pieces = packers["robot"].movables(sequence, prepared, box, None)
    effort = Effort(job.seconds, clock=time.process_time)
    rng = np.random.default_rng(job.options.seed)
    arrangement = packers["overlap"].arrange(pieces, box, None, rng, effort, watch)
    row: dict[str, Any] = {
        "key": job.key,
        "order": job.order,
        "free": watch.free and len(pieces) == len(sequence),
        "at_once": watch.at_once,
        "loadable": watch.loadable,
        "layout_s": time.process_time() - began,
        "executed": False,
        "placed": {},
    }
    for level, packer in packers.items():
        packing = packer.lowered(arrangement, pieces, sequence, prepared, box, None) if row["free"] else None
        row[level] = packing is not None and packing.complete
        row["placed"][level] = 0 if packing is None else len(packing.placements)
        if level == "robot" and packing is not None and packing.complete:
            plan = make_plan(packing, Order.of(*job.order).lines, shelf, each[level])
            row["executed"] = execute(plan, shelf).success
        packer.__exit__()
    return row


def summarize(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How many layouts become what, with Wilson intervals, and the shares of the items that are placed."""
    free = [row for row in rows if row["free"]]
    counts = {outcome: sum(bool(row[outcome]) for row in rows) for outcome in OUTCOMES}
    return {
        "orders": len(rows),
        "outcomes": {name: {"count": n, **asdict(proportion(n, len(rows)))} for name, n in counts.items()},
        "placed_of_free": {
            level: asdict(mean([row["placed"][level] / len(row["order"]) for row in free]))
            for level in LEVELS
            if free
        },
    }


def table(report: Mapping[str, Any]) -> str:
    """The summary for people; intervals of 95 % in brackets."""
    lines = []
    for name, own in report["outcomes"].items():
        share = report["placed_of_free"].get(name)
        placed = "" if share is None else f"{share['mean']:>9.1%} of the items of free ones placed"
        counts = f"{own['count']:>4} of {report['orders']} ({own['low']:.0%} to {own['high']:.0%})"
        lines.append(f"{name:<11}{counts}{placed}")
    return "\n".join(lines)


def main() -> int:
    """Run, resume, print the summary; exit code 1 where a job failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--container", default="0.32x0.32x0.30")
    parser.add_argument("--size", type=int, default=22, help="items of an order (default: %(default)s)")
    parser.add_argument("--orders", type=int, default=20, help="how many (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=20.0, help="of a layout (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--out", type=Path, default=Path("runs/layouts.jsonl"), help="rows (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="JSON only, no table")
    planning_options(parser, without=("constraints", "method", "budget", "plans", "goal", "seed"))
    grid_options(parser)
    parser.set_defaults(geometry="parts", heuristic="minz")
    arguments = parser.parse_args()
    options = options_from(arguments).changed({"method": "separate"})
    box = parse_container(arguments.container, read_boxes())
    prepare(arguments.catalogue, options)
    shelf = _Worker.shelf
    shelf.load(shelf.catalogue.names)
    jobs = [
        Job(
            options,
            box.size,
            arguments.seconds,
            tuple(order),
            tuple(shelf.items[name].sha256[:16] for name in order),
        )
        for order in random_orders(
            sorted(fitting(shelf.prepared, box, options.grid)),
            arguments.size,
            arguments.orders,
            arguments.seed,
        )
    ]
    found = finish(
        work,
        jobs,
        out=arguments.out,
        pool=Pool("pebble" if arguments.workers > 1 else "serial", arguments.workers),
        revision=revision(work),
        timeout=3600.0,
        prepare=prepare,
        arguments=(arguments.catalogue, options),
    )
    report = {
        "catalogue": arguments.catalogue,
        "container": box.label,
        "items": arguments.size,
        "seconds": arguments.seconds,
        **summarize([row for row in found.rows if "error" not in row]),
        "failed_jobs": list(found.broken),
    }
    print(json.dumps(report, indent=1) if arguments.json else table(report))
    for row in found.broken:
        print(f"layouts: {row['error']}", file=sys.stderr)
    return 1 if found.broken else 0


if __name__ == "__main__":
    sys.exit(reported("benchmarks.layouts", main))
