"""Grasps and the manipulation check: ``python -m benchmarks.manipulation --json``.

Orders of ten items are packed by HM into the 0.32x0.32x0.30 container under non-overlap alone. At every step
the ``--per-step`` best candidates of orientations that have grasps are checked, as the planner would:
``check_ms`` is the median of all of them, ``feasible_ms`` of those that the robot can do, which ask all,
and ``first_ms`` of the first of each step, before which the search has emptied the processor's caches.
``grasps_ms`` is what an orientation's grasps cost, once for each item. Times are CPU times of one thread.

``ungraspable`` lists the items that the cup cannot take in any pose, ``without_flat`` those that have no
flat spot in any; the paper's rule takes all of them, as it asks nothing of the surface.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from packenv.config import GridConfig
from packenv.experiments.orders import fitting, random_orders
from packenv.experiments.shelf import open_shelf
from packenv.geometry.prepare import PreparedItem
from packenv.planning.manipulation.checker import ManipulationChecker
from packenv.planning.manipulation.grasps import Grasp, generate_grasps
from packenv.planning.options import GraspRule
from packenv.planning.search.candidates import grid_search
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import HEURISTICS
from packenv.robot.files import default_cell
from packenv.types import Container, OrientedItem

BOX = Container(0.32, 0.32, 0.30)
GRID = GridConfig()


def survey(
    items: Mapping[str, PreparedItem], rule: GraspRule
) -> tuple[dict[str, Any], dict[OrientedItem, Any]]:
    """Grasps of every orientation: figures, and the grasps themselves."""
    grasps: dict[OrientedItem, tuple[Grasp, ...]] = {}
    times = []
    for item in items.values():
        for oriented in item.orientations:
            generate_grasps(oriented, rule=rule)
            start = time.thread_time()
            grasps[oriented] = generate_grasps(oriented, rule=rule)
            times.append(time.thread_time() - start)
    kinds = Counter(found[0].kind if found else "none" for found in grasps.values())
    best = {
        name: {g.kind for oriented in item.orientations for g in grasps[oriented]}
        for name, item in items.items()
    }
    figures = {
        "grasps_ms": 1e3 * statistics.median(times),
        "grasps_ms_p95": 1e3 * float(np.quantile(times, 0.95)),
        "orientations": dict(kinds),
        "without_flat": sorted(name for name, kinds in best.items() if not kinds & {"centre", "flat"}),
        "ungraspable": sorted(name for name, kinds in best.items() if not kinds),
    }
    return figures, grasps


def check_times(
    items: Mapping[str, PreparedItem],
    grasps: Mapping[OrientedItem, tuple[Grasp, ...]],
    orders: list[list[str]],
    per_step: int,
) -> dict[str, Any]:
    """Check the best candidates of every step of some orders."""
    checker = ManipulationChecker(default_cell().with_container(BOX))
    rng = np.random.default_rng(0)
    times, feasible, firsts = [], [], []
    reasons: Counter[str] = Counter()
    for order in orders:
        surface = ContainerMap.empty(BOX, GRID.cell_size)
        for name in sorted(order, key=lambda n: (-items[n].box_volume, n)):
            some = [o for o in items[name].orientations if grasps[o]]
            found = grid_search(surface, some, GRID.step_cells) if some else ()
            if not len(found):
                continue
            ranked = np.argsort(HEURISTICS["hm"](found, rng), kind="stable")[:per_step]
            for turn, k in enumerate(ranked):
                oriented = found.grids[found.grid_index[k]].oriented
                corner = np.array([found.ix[k], found.iy[k], 0.0]) * GRID.cell_size
                corner[2] = found.z[k]
                start = time.thread_time()
                result = checker.check(oriented, corner, surface, grasps[oriented])
                times.append(time.thread_time() - start)
                reasons[result.reason or "feasible"] += 1
                if result.feasible:
                    feasible.append(times[-1])
                if turn == 0:
                    firsts.append(times[-1])
            best = int(ranked[0])
            oriented = found.grids[found.grid_index[best]].oriented
            surface = surface.with_item(
                oriented, int(found.ix[best]), int(found.iy[best]), float(found.z[best])
            )
    return {
        "checks": len(times),
        "check_ms": 1e3 * statistics.median(times),
        "check_ms_p95": 1e3 * float(np.quantile(times, 0.95)),
        "feasible_ms": 1e3 * statistics.median(feasible),
        "first_ms": 1e3 * statistics.median(firsts),
        "answers": dict(reasons),
    }


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.manipulation", description=__doc__)
    parser.add_argument("--catalogue", default="builtin", help="folder of the catalogue, or builtin")
    parser.add_argument("--rule", choices=("seal", "flat", "paper"), default="seal")
    parser.add_argument("--orders", type=int, default=20)
    parser.add_argument("--per-step", type=int, default=10, help="candidates checked for each item")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="print JSON")
    args = parser.parse_args()
    items = open_shelf(args.catalogue, grid=GRID).prepared
    orders = random_orders(fitting(items, BOX, GRID), 10, args.orders, args.seed)
    figures, grasps = survey(items, args.rule)
    check_times(items, grasps, orders[:1], 1)
    result = {
        "rule": args.rule,
        "items": len(items),
        **figures,
        **check_times(items, grasps, orders, args.per_step),
    }
    if args.json:
        print(json.dumps(result, indent=2))
    else:
        for key, value in result.items():
            print(f"{key:16} {value}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
