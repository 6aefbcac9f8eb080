"""How ``auto`` and the rules that it is made of do: ``python -m experiments.portfolio --catalogue DIR``.

Every second item, by name, is of the first half, the others are of the second: rules are chosen on orders of the
one and measured on orders of the other. Each order is planned once by each rule, without restarts unless
``--restarts`` says otherwise; *lowest* and *fullest* are what the best of the single rules gave, order by order.
Stopped and started again with the same ``--out``, it goes on.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from benchmarks.orders import fitting, random_orders
from benchmarks.runs import finish
from benchmarks.shelf import open_shelf
from experiments.runs import order_options
from packenv import api
from packenv.cli.exit_codes import reported
from packenv.cli.pack import options_from
from packenv.cli.parser import planning_options
from packenv.config import GridConfig
from packenv.io.rows import row_key
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import MEMBERS, own_code
from packenv.planning.options import AUTO, PlanOptions
from packenv.types import Container, Order
from packenv.version import __version__

GRID = GridConfig()
CONTAINER = Container(0.32, 0.32, 0.30)
HALVES = ("first", "second", "all")


@dataclass(frozen=True)
class Job:
    """One order under one rule."""

    half: str
    options: PlanOptions
    size: int
    index: int
    order: tuple[str, ...]
    meshes: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        return row_key(__version__, GRID, self, own_code(self.options))


class _Worker:
    """What a worker process loads once."""

    shelf: ItemShelf


def prepare(catalogue: str) -> None:
    """Open the catalogue in this process."""
    _Worker.shelf = open_shelf(catalogue, grid=GRID)


def half_of(names: Sequence[str], half: str) -> list[str]:
    """The items of a half: every second one by name."""
    first = HALVES.index(half)
    return sorted(names) if half == "all" else sorted(names)[first::2]


def work(job: Job) -> dict[str, Any]:
    """Plan one order."""
    _Worker.shelf.load(job.order, fields=job.options.constraints != "overlap")
    start = time.process_time()
    plan = api.plan(Order.of(*job.order), CONTAINER, _Worker.shelf, job.options, margins=False)
    return {
        "key": job.key,
        "half": job.half,
        "size": job.size,
        "index": job.index,
        "rule": str(job.options.to_mapping()["heuristic"]),
        "order": job.order,
        "placed": len(plan.placements),
        "complete": plan.complete,
        "height": plan.metrics["height"],
        "made_by": plan.made_by,
        "cpu_s": time.process_time() - start,
    }


def summarize(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """One line for each half, size and rule."""
    orders = defaultdict(list)
    groups = defaultdict(list)
    for row in rows:
        if "error" not in row:
            orders[row["half"], row["size"], row["index"]].append(row)
            groups[row["half"], row["size"], row["rule"]].append(row)
    lines = []
    for (half, size, rule), group in sorted(groups.items()):
        others = [[o for o in orders[half, size, r["index"]] if o["rule"] != AUTO] for r in group]
        lines.append(
            {
                "half": half,
                "items": size,
                "rule": rule,
                "orders": len(group),
                "whole": statistics.mean(row["complete"] for row in group),
                "placed": sum(row["placed"] for row in group) / (size * len(group)),
                "height_mean": statistics.mean(row["height"] for row in group),
                "cpu_s_median": statistics.median(row["cpu_s"] for row in group),
                "cpu_s_mean": statistics.mean(row["cpu_s"] for row in group),
                "fullest": sum(
                    row["placed"] >= max(o["placed"] for o in rest or [row])
                    for row, rest in zip(group, others, strict=True)
                ),
                "lowest_mean": statistics.mean(
                    _lowest(rest or [row]) for row, rest in zip(group, others, strict=True)
                ),
                "made_by": dict(Counter(row["made_by"] for row in group)),
            }
        )
    return lines


def _lowest(rows: Sequence[dict[str, Any]]) -> float:
    """The lowest of the fullest plans, m."""
    most = max(row["placed"] for row in rows)
    return min(float(row["height"]) for row in rows if row["placed"] == most)


def main() -> int:
    """Run, resume, print the summary."""
    parser = order_options((__doc__ or "").splitlines()[0], orders=60, out="runs/portfolio.jsonl")
    parser.set_defaults(heuristics=[AUTO, *MEMBERS])
    parser.add_argument("--halves", nargs="+", choices=HALVES, default=["second"])
    parser.add_argument("--sizes", type=int, nargs="+", default=[10, 16, 22, 28])
    parser.add_argument("--without", nargs="+", default=[], help="items that are in no order")
    planning_options(parser, without=("heuristic", "seed"))
    parser.set_defaults(constraints="overlap", restarts=0)
    arguments = parser.parse_args()

    options = options_from(arguments)
    prepare(arguments.catalogue)
    shelf = _Worker.shelf
    names = sorted(set(fitting(shelf.prepared, CONTAINER, GRID)) - set(arguments.without))
    jobs = [
        Job(
            half,
            replace(options, heuristic=heuristic),
            size,
            index,
            tuple(order),
            tuple(shelf.items[name].sha256[:16] for name in order),
        )
        for half in arguments.halves
        for size in arguments.sizes
        for index, order in enumerate(
            random_orders(half_of(names, half), size, arguments.orders, arguments.seed)
        )
        for heuristic in arguments.heuristics
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
    print(json.dumps({"rows": summarize(done), "failed_jobs": failed}, indent=1))  # noqa: T201
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(reported("experiments.portfolio", main))
