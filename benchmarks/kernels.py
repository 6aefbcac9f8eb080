"""Speed of the search kernels: ``python -m benchmarks.kernels --json``.

Lowest Z and HM for every translation of a 160 × 160-cell container at *every cell* (a step of 2 mm), for the
four yaws of one pose. One row an item of the catalogue; ``cpu_s_median`` is the median over the items, on a
container that is already half full.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import time

import numpy as np

from packenv.config import GridConfig
from packenv.experiments.orders import random_orders
from packenv.experiments.shelf import open_shelf
from packenv.planning.planner import Planner, by_box_volume
from packenv.planning.search.candidates import grid_search
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import HEURISTICS
from packenv.types import Container


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()

    grid = GridConfig(n_poses=1)
    items = open_shelf(arguments.catalogue, grid=grid).prepared
    container = Container(0.32, 0.32, 0.30)
    order = random_orders(sorted(items), 5, 1, seed=0)[0]
    planner = Planner(HEURISTICS["hm"], grid)
    half_full = planner.pack(by_box_volume(order, items), items, container).surfaces[-1]
    rng = np.random.default_rng(0)

    def translations(shape: tuple[int, ...]) -> int:
        nx, ny = half_full.heights.shape
        return (nx - shape[0] + 1) * (ny - shape[1] + 1)

    def evaluate(orientations: tuple) -> tuple[int, int]:
        surface = ContainerMap(container, grid.cell_size, half_full.heights)
        candidates = grid_search(surface, orientations, 1)
        HEURISTICS["hm"](candidates, rng)
        return len(candidates), sum(g.n_cells * translations(g.oriented.top.shape) for g in candidates.grids)

    rows = []
    for name, item in items.items():
        evaluate(item.orientations)
        seconds = []
        for _ in range(arguments.repeats):
            start = time.process_time()
            legal, updates = evaluate(item.orientations)
            seconds.append(time.process_time() - start)
        median = statistics.median(seconds)
        cells = int(sum(o.footprint.sum() for o in item.orientations))
        rows.append(
            {
                "item": name,
                "footprint_cells": cells,
                "legal_candidates": legal,
                "cpu_s": median,
                "giga_cell_updates_per_s": updates / median / 1e9,
            }
        )
    report = {
        "cells": [*half_full.heights.shape],
        "step_cells": 1,
        "orientations": grid.n_yaws,
        "cpu_s_median": statistics.median(row["cpu_s"] for row in rows),
        "cpu_s_max": max(row["cpu_s"] for row in rows),
        "rows": rows,
    }
    print(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
