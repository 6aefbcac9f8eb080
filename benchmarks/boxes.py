"""How small a box a search finds for small orders: ``python -m benchmarks.boxes [--catalogue DIR] [--json]``.

Orders of three to five items go into the smallest of several boxes, by the first of them, from the smallest on, into
which HM packs all items in one pass (``hm``), or one of the rules of ``auto`` (``auto``), and by a search of
``--seconds`` (``budget``). The ``bound`` is the smallest box that is as large as the items' volume, and takes each of
them alone at one of its stable poses: no plan by stable poses is in a smaller one. Stopped and started again with the
same ``--out``, it goes on.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from packenv.cli.exit_codes import reported
from packenv.cli.pack import options_from
from packenv.cli.parser import grid_options, planning_options
from packenv.execution.planning_job import PlanningJob
from packenv.execution.smallest_box import pack_smallest
from packenv.experiments.orders import fitting, small_orders
from packenv.experiments.revision import revision
from packenv.experiments.runner import Pool, finish
from packenv.experiments.shelf import open_shelf
from packenv.io.containers import read_boxes
from packenv.io.rows import row_key
from packenv.items.plan_maker import make_plan
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import own_code
from packenv.planning.options import PlanOptions
from packenv.types import Container, Order
from packenv.verification.exact_meshes import audit_plan

METHODS: Mapping[str, Mapping[str, Any]] = {
    "hm": {"heuristic": "hm", "restarts": 0},
    "auto": {"heuristic": "auto"},
    "budget": {"heuristic": "auto"},
}
"""Options of each method."""


@dataclass(frozen=True)
class Job:
    """One order by every method."""

    options: tuple[PlanOptions, ...]
    boxes: tuple[Container, ...]
    order: tuple[str, ...]
    meshes: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        sizes = [box.size for box in self.boxes]
        own = [own_code(options) for options in self.options]
        return row_key((self.options, sizes, self.order, self.meshes), own)


class _Worker:
    """What a worker process loads once."""

    shelf: ItemShelf


def prepare(catalogue: str, options: PlanOptions) -> None:
    """Open the catalogue in this process."""
    _Worker.shelf = open_shelf(catalogue, options.geometry or "mesh", options.grid)


def work(job: Job) -> dict[str, Any]:
    """The box that each method finds, by label, and what it took; none where not all items are placed."""
    shelf = _Worker.shelf
    row: dict[str, Any] = {"key": job.key, "order": job.order, "bound": bound(job)}
    for method, options in zip(METHODS, job.options, strict=True):
        planning = PlanningJob(shelf, options, margins=False)
        planning.load(set(job.order))
        began = time.perf_counter()
        packing = pack_smallest(planning, job.boxes, planning.sequence(job.order))
        seconds = time.perf_counter() - began
        plan = make_plan(packing, Order.of(*job.order).lines, shelf, options)
        audit = audit_plan(plan, {name: shelf.items[name] for name in set(job.order)})
        row[method] = {
            "volume": packing.container.volume if packing.complete else None,
            "seconds": seconds,
            "faults": len(audit.overlaps) + len(audit.protrusions) + len(audit.blocked),
        }
    return row


def bound(job: Job) -> float | None:
    """Volume of the smallest box that the order's volume and each of its items alone do not rule out, m³."""
    items = {name: _Worker.shelf.prepared[name] for name in job.order}
    volume = sum(items[name].volume for name in job.order)
    grid = job.options[0].grid
    fits = (box for box in job.boxes if volume <= box.volume and len(fitting(items, box, grid)) == len(items))
    return next((box.volume for box in fits), None)


def summarize(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean volumes over the orders that every method packs whole, dm³, and seconds."""
    whole = [row for row in rows if row["bound"] and all(row[method]["volume"] for method in METHODS)]
    found: dict[str, Any] = {"orders": len(rows), "whole_by_all": len(whole), "methods": {}}
    if not whole:
        return found
    found["bound_dm3"] = 1e3 * statistics.fmean(row["bound"] for row in whole)
    for method in METHODS:
        found["methods"][method] = {
            "box_dm3": 1e3 * statistics.fmean(row[method]["volume"] for row in whole),
            "smaller_than_hm": sum(row[method]["volume"] < row["hm"]["volume"] for row in whole),
            "whole": sum(row[method]["volume"] is not None for row in rows),
            "seconds_median": statistics.median(row[method]["seconds"] for row in whole),
            "faults": sum(row[method]["faults"] for row in rows),
        }
    return found


def table(report: Mapping[str, Any]) -> str:
    """The summary for people."""
    lines = [f"{'method':<8}{'whole':>7}{'mean box, dm³':>15}{'smaller than hm':>17}{'seconds':>9}"]
    for method, own in report["methods"].items():
        figures = f"{own['box_dm3']:>15.2f}{own['smaller_than_hm']:>17}{own['seconds_median']:>9.2f}"
        lines.append(f"{method:<8}{own['whole']:>7}{figures}")
    if report["methods"]:
        lines.append(f"{'bound':<15}{report['bound_dm3']:>15.2f}")
    return "\n".join(lines)


def main() -> int:
    """Run, resume, print the summary; exit code 1 where a plan failed its audit or a job its run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--boxes", type=Path, help="a table of boxes (default: the built-in ones)")
    parser.add_argument("--orders", type=int, default=50, help="how many (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=5.0, help="of a search (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--out", type=Path, default=Path("runs/boxes.jsonl"), help="rows (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="JSON only, no table")
    planning_options(parser, without=("heuristic", "method", "budget", "plans", "goal", "seed"))
    grid_options(parser)
    parser.set_defaults(constraints="overlap")
    arguments = parser.parse_args()
    options = options_from(arguments)
    boxes = tuple(sorted(read_boxes(arguments.boxes), key=lambda box: box.volume))
    prepare(arguments.catalogue, options)
    shelf = _Worker.shelf
    shelf.load(shelf.catalogue.names)
    fits = {name for box in boxes for name in fitting(shelf.prepared, box, options.grid)}
    each = tuple(
        options.changed({**own, "budget": arguments.seconds if method == "budget" else None})
        for method, own in METHODS.items()
    )
    jobs = [
        Job(each, boxes, tuple(order), tuple(shelf.items[name].sha256[:16] for name in order))
        for order in small_orders(sorted(fits), arguments.orders, arguments.seed)
    ]
    found = finish(
        work,
        jobs,
        out=arguments.out,
        pool=Pool("serial"),
        revision=revision(work),
        timeout=3600.0,
        prepare=prepare,
        arguments=(arguments.catalogue, options),
    )
    report = {
        "catalogue": arguments.catalogue,
        "boxes": [box.full_label for box in boxes],
        "seconds": arguments.seconds,
        "constraints": options.constraints,
        **summarize([row for row in found.rows if "error" not in row]),
        "failed_jobs": list(found.broken),
    }
    print(json.dumps(report, indent=1) if arguments.json else table(report))
    for row in found.broken:
        print(f"boxes: {row['error']}", file=sys.stderr)
    return 1 if found.broken or any(own["faults"] for own in report["methods"].values()) else 0


if __name__ == "__main__":
    sys.exit(reported("benchmarks.boxes", main))
