"""Planning speed and success: ``python -m benchmarks.planning [--catalogue DIR] --json``.

``cpu_s_median`` is the median CPU time of a whole 10-item plan with HM, reading the cached stable poses and
heightmaps of its items from disk included. ``speedup_vs_reference`` is the median, over orders, of the
reference's CPU time (see :mod:`benchmarks.reference`) divided by that of the product on the same order, in
the same process; the reference casts its heightmaps anew for every order, as the paper does, and
``speedup_search_only`` leaves that casting and the product's reading of its cache out. Loading and hashing
the meshes is outside of all figures.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from benchmarks import reference
from packenv.cli.pack import options_from
from packenv.cli.parser import planning_options
from packenv.execution.planning_job import PlanningJob
from packenv.experiments.orders import fitting, random_orders
from packenv.experiments.shelf import open_shelf
from packenv.io.containers import parse_container, read_boxes
from packenv.items.cache import ItemCache
from packenv.items.catalogue import open_catalogue
from packenv.items.shelf import ONE_USER, ItemShelf
from packenv.planning.assembly import packer
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.types import OrientedItem


def cpu(work: Callable[[], Any]) -> tuple[float, Any]:
    """CPU-seconds of a call, and its result."""
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


@dataclass(frozen=True)
class Timed(Constraint):
    """A constraint that adds the CPU time of its answers to a count."""

    constraint: Constraint
    spent: Counter[str]

    def __hash__(self) -> int:
        """That of the constraint."""
        return hash(self.constraint)

    @property
    def name(self) -> str:
        """That of the constraint."""
        return self.constraint.name

    def start(self, resting: Sequence[Resting] = ()) -> Any:
        """As the constraint."""
        return self.constraint.start(resting)

    def objection(self, oriented: OrientedItem) -> str | None:
        """As the constraint."""
        seconds, answer = cpu(lambda: self.constraint.objection(oriented))
        self.spent[f"{self.name} of orientations"] += seconds
        return answer

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        """As the constraint."""
        seconds, answer = cpu(lambda: self.constraint.check(trial, surface, state))
        self.spent[self.name] += seconds
        self.spent[f"{self.name} checks"] += 1
        return answer


def shares(whole: float, spent: Counter[str]) -> dict[str, Any]:
    """Where the time went: milliseconds a check, and shares of all CPU time; the rest is the search."""
    report: dict[str, Any] = {}
    for name in ("stability", "manipulation"):
        if checks := spent.pop(f"{name} checks", 0):
            report[f"{name}_ms_a_check"] = 1e3 * spent[name] / checks
    if spent:
        report["time_shares"] = {name: seconds / whole for name, seconds in sorted(spent.items())}
    return report


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--container", default="0.32x0.32x0.30")
    parser.add_argument("--orders", type=int, default=50, help="orders of each size")
    parser.add_argument("--sizes", type=int, nargs="+", help="default: 10 16 22 28; under constraints 10")
    parser.add_argument("--heuristics", nargs="+", default=["auto", "hm", "dblf", "mta"])
    planning_options(parser, without=("heuristic", "seed"))
    parser.set_defaults(constraints="overlap", stability="paper")
    parser.add_argument("--reference-orders", type=int, default=10, help="how many the reference packs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="JSON only, no table")
    arguments = parser.parse_args()

    options = options_from(arguments)
    constrained = options.constraints != "overlap"
    options = options if constrained else replace(options, restarts=0)
    if arguments.sizes is None:
        arguments.sizes = [10] if constrained else [10, 16, 22, 28]
    grid = options.grid
    container = parse_container(arguments.container, read_boxes())
    catalogue = open_catalogue(arguments.catalogue)
    meshes = {name: catalogue.item(name) for name in catalogue.names}

    preparation = []
    spent: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        cache = ItemCache(Path(folder))
        cache.prepare(next(iter(meshes.values())), grid)  # compiles the kernels
        for item in tqdm(meshes.values(), desc="preparing", disable=None):
            cache.prepared_file(item, grid).path.unlink(missing_ok=True)
            preparation.append(cpu(lambda item=item: cache.prepare(item, grid))[0])
        items = {name: cache.get(item, grid) for name, item in meshes.items()}
        names = fitting(items, container, grid)

        if constrained:
            fields = [cpu(lambda item=item: cache.surface_field(item))[0] for item in meshes.values()]
            preparation = [a + b for a, b in zip(preparation, fields, strict=True)]

        def order_from_disk(order: list[str], heuristic: str) -> Any:
            fresh = ItemShelf(catalogue, grid, cache=cache, field_memory=ONE_USER, map_memory=ONE_USER)
            return pack_order(order, heuristic, fresh)

        def pack_order(order: list[str], heuristic: str, shelf: ItemShelf) -> Any:
            job = PlanningJob(shelf, replace(options, heuristic=heuristic), margins=False)
            start = time.process_time()
            shelf.load(order)
            loaded = time.process_time()
            shelf.load(order, fields=constrained)
            spent["reading surfaces"] += time.process_time() - loaded
            spent["reading maps"] += loaded - start
            with job.planner(container) as planner:
                timed = tuple(Timed(constraint, spent) for constraint in planner.constraints)
                packing = packer(job.options, replace(planner, constraints=timed), job.shelf.shapes)
                prepared = {name: shelf.prepared[name] for name in order}
                return packing.pack(job.sequence(order), prepared, container)

        rows: list[dict[str, Any]] = []
        for size in arguments.sizes:
            orders = random_orders(names, size, arguments.orders, arguments.seed)
            for heuristic in arguments.heuristics:
                order_from_disk(orders[0], heuristic)
                spent.clear()
                runs = [
                    cpu(lambda order=order, heuristic=heuristic: order_from_disk(order, heuristic))
                    for order in tqdm(orders, desc=f"{size} items, {heuristic}", disable=None)
                ]
                packings = [packing for _, packing in runs]
                rows.append(
                    {
                        "items": size,
                        "heuristic": heuristic,
                        "cpu_s_median": statistics.median(seconds for seconds, _ in runs),
                        "packed_share": sum(p.complete for p in packings) / len(packings),
                        "orders_without_a_graspable_spot": sum(
                            any(left.reason == "no-graspable-spot" for left in p.leftovers) for p in packings
                        ),
                        "item_share": sum(len(p.placements) for p in packings) / (size * len(packings)),
                        "utilization": statistics.mean(p.utilization for p in packings),
                        **shares(sum(seconds for seconds, _ in runs), spent),
                    }
                )

        orders = random_orders(names, 10, arguments.orders, arguments.seed)
        reading = [cpu(lambda o=o: [cache.get(meshes[n], grid) for n in o])[0] for o in orders]
        compared = []
        warm = open_shelf(arguments.catalogue, grid=grid)
        for order in tqdm(orders[: 0 if constrained else arguments.reference_orders], disable=None):
            theirs = reference.plan(order, meshes, items, container, grid)
            runs = [cpu(lambda order=order: order_from_disk(order, "hm")) for _ in range(5)]
            ours = statistics.median(seconds for seconds, _ in runs)
            searching = statistics.median(
                cpu(lambda order=order: pack_order(order, "hm", warm))[0] for _ in range(5)
            )
            compared.append(
                {
                    "placed": len(runs[0][1].placements),
                    "reference_placed": theirs.placed,
                    "whole": theirs.cpu_s / ours,
                    "search": theirs.search_cpu_s / searching,
                    "reference_cpu_s": theirs.cpu_s,
                }
            )

    head = next((r for r in rows if r["items"] == 10 and r["heuristic"] == "hm"), {})

    def median_of(key: str) -> float | None:
        return statistics.median(row[key] for row in compared) if compared else None

    report = {
        "catalogue": arguments.catalogue,
        "container": container.label,
        "constraints": options.constraints,
        "orders": arguments.orders,
        "cpu_s_median": head.get("cpu_s_median"),
        "packed_share": head.get("packed_share"),
        "speedup_vs_reference": median_of("whole"),
        "speedup_search_only": median_of("search"),
        "reference_cpu_s_median": median_of("reference_cpu_s"),
        "reference_orders": len(compared),
        "items_placed": sum(row["placed"] for row in compared),
        "reference_items_placed": sum(row["reference_placed"] for row in compared),
        "cache_reading_cpu_s_median": statistics.median(reading),
        "preparation_cpu_s_an_item": {
            "median": statistics.median(preparation),
            "max": max(preparation),
            "all": sum(preparation),
        },
        "items_that_do_not_fit_alone": sorted(set(meshes) - set(names)),
        "rows": rows,
    }
    if not arguments.json:
        for row in rows:
            print(
                f"{row['items']:>3} items  {row['heuristic']:<10} packed {row['packed_share']:6.1%}  "
                f"utilization {row['utilization']:5.1%}  {row['cpu_s_median'] * 1e3:7.1f} ms",
                file=sys.stderr,
            )
    print(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
