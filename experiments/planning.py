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
from dataclasses import dataclass
from typing import Any

from benchmarks.orders import fitting, random_orders, small_orders
from experiments.runs import finish, load_items, order_options
from packenv.config import GridConfig
from packenv.io.containers import read_boxes
from packenv.io.item_cache import ItemCache
from packenv.io.rows import row_key
from packenv.planning.assembly import PlannerChoice, Shelf, assemble
from packenv.planning.orientations import perturbations
from packenv.planning.packer import by_box_volume
from packenv.planning.packing import Packing
from packenv.types import Container
from packenv.version import __version__

GRID = GridConfig()
LARGE = Container(0.32, 0.32, 0.30)
_CHOICE = ("set", "heuristic", "constraints", "stability", "search", "contacts", "grasp", "restarts")
WITNESSES = ("hm", "dblf", "mta", "minz")


@dataclass(frozen=True)
class Job:
    """One order under one choice."""

    set: str
    choice: PlannerChoice
    index: int
    order: tuple[str, ...]
    meshes: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        return row_key(__version__, GRID, self)


class _Worker:
    """What a worker process loads once."""

    shelf: Shelf


def prepare(catalogue: str) -> None:
    """Load the catalogue into this process."""
    meshes, prepared = load_items(catalogue, GRID)
    cache = ItemCache()
    fields = {name: cache.surface_field(item) for name, item in meshes.items()}
    _Worker.shelf = Shelf(meshes, prepared, fields)


def small_boxes() -> list[Container]:
    """The five challenge boxes, smallest volume first."""
    return sorted((box for box in read_boxes() if box.name != "S32"), key=lambda box: box.volume)


def _pack(job: Job, choice: PlannerChoice) -> Packing:
    shelf = _Worker.shelf
    sequence = by_box_volume(job.order, shelf.prepared)
    packing = None
    for box in [LARGE] if job.set == "large" else small_boxes():
        packing = assemble(choice, shelf, box, GRID).pack(sequence, shelf.prepared, box)
        if packing.complete:
            break
    assert packing is not None
    return packing


def _tilt(job: Job) -> None:
    """Have the heightmaps of all perturbed orientations at hand: they depend on the items alone."""
    shelf = _Worker.shelf
    for name in job.order:
        poses = shelf.prepared[name].poses
        for box in [LARGE] if job.set == "large" else small_boxes():
            for _ in perturbations(shelf.meshes[name], poses, GRID, box.size):
                pass


def work(job: Job) -> dict[str, Any]:
    """Plan one order; for the 5D search, ``prepare_cpu_s`` is what the maps of its orientations take."""
    start = time.process_time()
    if job.choice.search == "5d":
        _tilt(job)
    prepared = time.process_time()
    packing = _pack(job, job.choice)
    seconds = time.process_time() - prepared
    feasible = packing.complete or job.set == "small"
    for witness in WITNESSES:
        feasible = feasible or _pack(job, PlannerChoice(witness, "overlap", restarts=0)).complete
    rejections: Counter[str] = Counter()
    for part in (*packing.placements, *packing.leftovers):
        rejections.update(part.rejections)
    return {
        "key": job.key,
        "set": job.set,
        "heuristic": job.choice.heuristic,
        "constraints": job.choice.constraints,
        "stability": job.choice.stability,
        "search": job.choice.search,
        "contacts": job.choice.contacts,
        "grasp": job.choice.grasp,
        "restarts": str(job.choice.restarts),
        "index": job.index,
        "order": job.order,
        "complete": packing.complete,
        "feasible": feasible,
        "container": packing.container.label,
        "leftovers": [(left.item, left.reason) for left in packing.leftovers],
        "routes": Counter(placement.route for placement in packing.placements),
        "checked": sum(placement.checked for placement in packing.placements),
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
    parser.add_argument("--constraints", default="robot", choices=("overlap", "stability", "robot"))
    parser.add_argument("--stability", default="paper", choices=("paper", "cautious", "margin"))
    parser.add_argument("--contacts", default="surface", choices=("surface", "paper"))
    parser.add_argument("--grasp", default="seal", choices=("seal", "flat", "paper"))
    parser.add_argument("--restarts", type=int, default=3)
    parser.add_argument("--search", default="3d", choices=("3d", "5d"))
    parser.add_argument("--json", action="store_true", help="accepted for symmetry: the output is JSON")
    arguments = parser.parse_args()

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
            PlannerChoice(
                heuristic,
                arguments.constraints,
                arguments.stability,
                arguments.search,
                contacts=arguments.contacts,
                grasp=arguments.grasp,
                restarts=arguments.restarts if arguments.set == "large" else 0,
                give_up=arguments.set == "small",
            ),
            index,
            tuple(order),
            tuple(shelf.meshes[name].sha256[:16] for name in order),
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
                "items_that_do_not_fit_alone": sorted(set(shelf.prepared) - set(names)),
            },
            indent=1,
        )
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
