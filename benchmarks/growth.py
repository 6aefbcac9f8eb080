"""How planning time grows with the order: ``python -m benchmarks.growth [--catalogue DIR] [--svg FILE]``.

For each size, orders of so many items, drawn as :mod:`packenv.experiments.orders` does (with repetition beyond the
catalogue), are planned in one pass, without restarts. ``cpu_s`` are CPU-seconds of whole plans, surfaces and maps read
before; ``check_ms`` are those of single questions to the stability checker, in a second run of the first order, for
asking the time has its price. ``--svg`` draws the medians over the sizes.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

from tqdm import tqdm

from packenv.cli.pack import options_from
from packenv.cli.parser import planning_options
from packenv.execution.planning_job import PlanningJob
from packenv.experiments.orders import fitting, random_orders
from packenv.experiments.shelf import open_shelf
from packenv.io.containers import parse_container, read_boxes
from packenv.planning.stability.checker import StabilityChecker
from packenv.types import Contacts, Container


def checks_of(job: PlanningJob, box: Container, order: list[str], largest: int) -> list[float]:
    """Milliseconds of the questions to the stability checker in one plan, of piles of so many items and more.

    The CPU clock's own price, 0.2 ms where the system is slow to tell it, is in them.
    """
    spent: list[float] = []
    real = StabilityChecker.check

    def timed(checker: StabilityChecker, contacts: Contacts, masses: Any, *rest: Any, **named: Any) -> Any:
        start = time.process_time()
        result = real(checker, contacts, masses, *rest, **named)
        if len(masses) >= largest:
            spent.append(1e3 * (time.process_time() - start))
        return result

    with mock.patch.object(StabilityChecker, "check", timed):
        job.pack(box, job.sequence(order))
    return spent


def draw(rows: list[dict[str, Any]], file: Path) -> None:
    """The medians over the sizes, a line for each level of constraints."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.4, 3.6), layout="constrained")
    for level in dict.fromkeys(row["constraints"] for row in rows):
        own = [row for row in rows if row["constraints"] == level]
        sizes, seconds = [row["items"] for row in own], [row["cpu_s"]["median"] for row in own]
        axes.plot(sizes, seconds, marker="o", label=level)
        axes.fill_between(
            sizes, [row["cpu_s"]["min"] for row in own], [row["cpu_s"]["max"] for row in own], alpha=0.15
        )
    axes.set(xlabel="items", ylabel="CPU-seconds a plan", yscale="log")
    axes.grid(alpha=0.3)
    axes.legend(title="constraints")
    figure.savefig(file, metadata={"Date": None})


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--container", default="0.60x0.40x0.32")
    parser.add_argument("--orders", type=int, default=5, help="orders of each size")
    parser.add_argument("--sizes", type=int, nargs="+", default=[10, 20, 40, 60, 80, 100])
    parser.add_argument("--levels", nargs="+", default=["overlap", "stability"], help="sets of constraints")
    parser.add_argument("--svg", type=Path, help="draw the curve into this file")
    planning_options(parser, without=("seed", "constraints"))
    parser.set_defaults(heuristic="minz", restarts=0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    options = options_from(arguments)
    box = parse_container(arguments.container, read_boxes())
    shelf = open_shelf(arguments.catalogue, grid=options.grid)
    names = sorted(fitting(shelf.prepared, box, options.grid))
    rows = []
    for level in arguments.levels:
        job = PlanningJob(shelf, replace(options, constraints=level), margins=False)
        for size in arguments.sizes:
            orders = random_orders(names, size, arguments.orders, arguments.seed)
            seconds, placed = [], 0
            job.load(set(names))
            job.pack(box, job.sequence(orders[0][:10]))  # compiled before it is measured
            for order in tqdm(orders, desc=f"{level}, {size} items", disable=None):
                start = time.process_time()
                packing = job.pack(box, job.sequence(order))
                seconds.append(time.process_time() - start)
                placed += len(packing.placements)
            checks = checks_of(job, box, orders[0], 3 * size // 4)
            rows.append(
                {
                    "constraints": level,
                    "items": size,
                    "placed": placed / len(orders),
                    "cpu_s": {"min": min(seconds), "median": statistics.median(seconds), "max": max(seconds)},
                    "check_ms": {"median": statistics.median(checks), "max": max(checks)} if checks else None,
                    "checks": len(checks),
                }
            )
            print(json.dumps(rows[-1]), file=sys.stderr)
    if arguments.svg:
        draw(rows, arguments.svg)
    print(json.dumps({"catalogue": arguments.catalogue, "container": box.label, "rows": rows}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
