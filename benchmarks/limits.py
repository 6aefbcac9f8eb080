"""What limits of items cost: ``python -m benchmarks.limits [--orders 20] --json``.

Each order is planned three times in one process: without limits; with limits that bind nothing (every item may bear
100 kg), so that the plan is the same and the price is that of looking; and with limits as users set them (a third
bears nothing or little, a fifth must be upright), where candidates are refused and items wait. ``ratio_looking`` and
``ratio_limited`` are medians over orders of CPU time over that without limits.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import time

import numpy as np

import packenv as rp
from packenv.experiments.orders import random_orders
from packenv.limits import NO_LIMITS, ItemLimits
from packenv.types import Order, OrderLine

BOX = rp.Container(0.32, 0.32, 0.30)


def usual(rng: np.random.Generator) -> ItemLimits:
    """Limits as users set them."""
    draw, upright = rng.random(), rng.random() < 0.2
    if draw < 0.15:
        return ItemLimits(fragile=True, upright=upright)
    if draw < 0.35:
        return ItemLimits(max_load_kg=float(rng.uniform(0.2, 2.0)), upright=upright)
    return ItemLimits(upright=upright)


def measure(count: int, size: int, constraints: str, seed: int) -> dict[str, object]:
    """CPU time and packed items of every order in the three ways."""
    catalogue = rp.load_catalogue()
    rng = np.random.default_rng(seed)
    ways = ("free", "looking", "limited")
    seconds: dict[str, list[float]] = {way: [] for way in ways}
    packed = dict.fromkeys(ways, 0)
    same = 0
    for names in random_orders(list(catalogue.names), size, count, seed):
        loose = [ItemLimits(max_load_kg=100.0)] * size
        limits = {"free": [NO_LIMITS] * size, "looking": loose, "limited": [usual(rng) for _ in names]}
        orders = {
            way: Order(tuple(OrderLine(n, 1, g) for n, g in zip(names, given, strict=True)))
            for way, given in limits.items()
        }
        plans = {}
        for way, order in orders.items():  # what is read from the cache is read once
            rp.plan(order, BOX, catalogue, constraints=constraints, heuristic="hm", restarts=0, margins=False)
            start = time.process_time()
            plans[way] = rp.plan(
                order, BOX, catalogue, constraints=constraints, heuristic="hm", restarts=0, margins=False
            )
            seconds[way].append(time.process_time() - start)
            packed[way] += len(plans[way].placements)
        places = [[p.position.tolist() for p in plans[way].placements] for way in ("free", "looking")]
        same += places[0] == places[1]
    ratios = {
        way: statistics.median(np.divide(seconds[way], seconds["free"]).tolist())
        for way in ("looking", "limited")
    }
    return {
        "orders": count,
        "items": size,
        "constraints": constraints,
        "cpu_s_median": {way: round(statistics.median(times), 4) for way, times in seconds.items()},
        "ratio_looking": round(ratios["looking"], 3),
        "ratio_limited": round(ratios["limited"], 3),
        "packed_share": {way: round(n / (count * size), 4) for way, n in packed.items()},
        "same_plans": same,
    }


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else None)
    parser.add_argument("--orders", type=int, default=20)
    parser.add_argument("--items", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    given = parser.parse_args()
    rows = [
        measure(given.orders, given.items, constraints, given.seed) for constraints in ("stability", "robot")
    ]
    if given.json:
        print(json.dumps(rows, indent=1))
        return
    for row in rows:
        print(
            f"{row['constraints']}: looking costs {row['ratio_looking']} times, usual limits {row['ratio_limited']} "
            f"times; packed {row['packed_share']}, {row['same_plans']} of {row['orders']} plans the same"
        )


if __name__ == "__main__":
    main()
