"""Plan many random orders under all constraints: ``python -m experiments.planning --catalogue DIR --json``.

``--set large``: orders of ten different items into 0.32 x 0.32 x 0.30 m. *Feasible* are those that HM, DBLF,
MTA or MinZ packs without overlap (the paper takes sets that one of its methods packs). ``--set small``:
orders of three to five items into the smallest of the five Amazon Robotics Challenge boxes that takes them;
feasible are those whose items each fit the largest box alone. Stopped and started again with the same
``--out``, it goes on.
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

from benchmarks.orders import fitting, random_orders, small_orders
from benchmarks.runs import finish
from benchmarks.shelf import open_shelf
from experiments.runs import order_options
from packenv import api
from packenv.cli.exit_codes import reported
from packenv.cli.pack import options_from
from packenv.cli.parser import planning_options
from packenv.config import GridConfig
from packenv.io.containers import read_boxes
from packenv.io.rows import row_key
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import own_code
from packenv.planning.options import PlanOptions
from packenv.planning.search.orientations import perturbations
from packenv.types import Container, Order, Plan
from packenv.version import __version__

GRID = GridConfig()
LARGE = Container(0.32, 0.32, 0.30)
_CHOICE = ("set", "heuristic", "constraints", "stability", "search", "contacts", "grasp", "restarts")
WITNESSES = ("hm", "dblf", "mta", "minz")


@dataclass(frozen=True)
class Job:
    """One order under one choice."""

    set: str
    options: PlanOptions
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


def small_boxes() -> list[Container]:
    """The five challenge boxes, smallest volume first."""
    return sorted((box for box in read_boxes() if box.name != "S32"), key=lambda box: box.volume)


def _boxes(job: Job) -> list[Container]:
    return [LARGE] if job.set == "large" else small_boxes()


def _plan(job: Job, options: PlanOptions) -> Plan:
    return api.plan(Order.of(*job.order), _boxes(job), _Worker.shelf, options, margins=False)


def _tilt(job: Job) -> None:
    """Have the heightmaps of all perturbed orientations at hand: they depend on the items alone."""
    shelf = _Worker.shelf
    for name in job.order:
        poses = shelf.prepared[name].poses
        for box in _boxes(job):
            for _ in perturbations(shelf.shapes[name], poses, GRID, box.size):
                pass


def work(job: Job) -> dict[str, Any]:
    """Plan one order; for the 5D search, ``prepare_cpu_s`` is what the maps of its orientations take."""
    _Worker.shelf.load(job.order, fields=job.options.constraints != "overlap")
    start = time.process_time()
    if job.options.search == "5d":
        _tilt(job)
    prepared = time.process_time()
    plan = _plan(job, job.options)
    seconds = time.process_time() - prepared
    feasible = plan.complete or job.set == "small"
    for witness in WITNESSES:
        overlap = PlanOptions(heuristic=witness, constraints="overlap", restarts=0)
        feasible = feasible or _plan(job, overlap).complete
    rejections: Counter[str] = Counter()
    for part in (*plan.placements, *plan.leftovers):
        rejections.update(part.rejections)
    return {
        "key": job.key,
        "set": job.set,
        **{name: str(job.options.to_mapping()[name]) for name in _CHOICE[1:]},
        "index": job.index,
        "order": job.order,
        "complete": plan.complete,
        "feasible": feasible,
        "container": plan.container.label,
        "leftovers": [(left.item, left.reason) for left in plan.leftovers],
        "routes": Counter(placement.route for placement in plan.placements),
        "checked": sum(placement.checked for placement in plan.placements),
        "rejections": rejections,
        "cpu_s": seconds,
        "prepare_cpu_s": prepared - start,
    }


def summarize(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """One line for each choice."""
    groups = defaultdict(list)
    for row in rows:
        if "error" not in row and row["feasible"]:
            groups[tuple(row[name] for name in _CHOICE)].append(row)
    lines = []
    for key, group in sorted(groups.items()):
        routes: Counter[str] = Counter()
        reasons: Counter[str] = Counter()
        for row in group:
            routes.update(row["routes"])
            reasons.update(f"{item}: {reason}" for item, reason in row["leftovers"])
        lines.append(
            {
                "choice": " ".join(key),
                "orders": len(group),
                "success": statistics.mean(row["complete"] for row in group),
                "cpu_s_median": statistics.median(row["cpu_s"] for row in group),
                "cpu_s_mean": statistics.mean(row["cpu_s"] for row in group),
                "cpu_s_max": max(row["cpu_s"] for row in group),
                "prepare_cpu_s_median": statistics.median(row["prepare_cpu_s"] for row in group),
                "prepare_cpu_s_max": max(row["prepare_cpu_s"] for row in group),
                "checked_an_item": sum(r["checked"] for r in group) / max(1, sum(routes.values())),
                "routes": dict(routes),
                "containers": dict(Counter(row["container"] for row in group)),
                "left_over": dict(reasons.most_common(12)),
            }
        )
    return lines


def main() -> int:
    """Run, resume, print the summary."""
    parser = order_options((__doc__ or "").splitlines()[0], orders=300, out="runs/planning.jsonl")
    parser.add_argument("--set", choices=("large", "small"), default="large")
    planning_options(parser, without=("heuristic", "seed"))
    arguments = parser.parse_args()

    options = options_from(arguments)
    if arguments.set == "small":
        options = replace(options, restarts=0)
    prepare(arguments.catalogue)
    shelf = _Worker.shelf
    box = LARGE if arguments.set == "large" else small_boxes()[-1]
    names = fitting(shelf.prepared, box, GRID)
    if arguments.set == "large":
        orders = random_orders(names, 10, arguments.orders, arguments.seed)
    else:
        orders = small_orders(names, arguments.orders, arguments.seed)
    jobs = [
        Job(
            arguments.set,
            replace(options, heuristic=heuristic),
            index,
            tuple(order),
            tuple(shelf.items[name].sha256[:16] for name in order),
        )
        for index, order in enumerate(orders)
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
    print(  # noqa: T201
        json.dumps(
            {
                "rows": summarize(done),
                "failed_jobs": failed,
                "items_that_do_not_fit_alone": sorted(set(shelf.items) - set(names)),
            },
            indent=1,
        )
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(reported("experiments.planning", main))
