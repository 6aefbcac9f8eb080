"""Compare heuristics, one of your own among them, on the same random orders."""

from statistics import mean

import numpy as np

import packenv as rp
from examples.my_heuristic import flattest

ORDERS, ITEMS = 5, 16
BOX = rp.Container(0.32, 0.32, 0.30)

catalogue = rp.load_catalogue("builtin")
shelf = rp.ItemShelf(catalogue)  # keeps what was loaded, from one plan to the next
rng = np.random.default_rng(0)
orders = [rp.Order.of(*rng.choice(catalogue.names, ITEMS, replace=False)) for _ in range(ORDERS)]

packed = {}
for heuristic in ("hm", "dblf", "mta", "minz", "random", flattest):
    plans = [
        rp.plan(order, BOX, shelf, heuristic=heuristic, constraints="overlap", restarts=0) for order in orders
    ]
    name = heuristic if isinstance(heuristic, str) else heuristic.__name__
    packed[name] = mean(len(plan.placements) for plan in plans)
    height = mean(plan.metrics["height"] for plan in plans)
    print(f"{name:<8}  {packed[name]:5.1f} of {ITEMS} items, pile {height:.3f} m")

assert packed["random"] <= max(packed.values())
assert all(rp.verify(plan, shelf).ok for plan in plans)
