"""Random piles with random limits: no item bears more than it may, by verify, and by the engine's contact forces."""

from __future__ import annotations

import numpy as np
import pytest

import packenv as rp
from packenv.config import GRAVITY
from packenv.items.shelf import ItemShelf
from packenv.limits import NO_LIMITS, ItemLimits
from packenv.sim.rest import RestRule, settle
from packenv.sim.world import World, WorldConfig
from packenv.types import Order, OrderLine, Plan

BOX = rp.Container(0.24, 0.24, 0.3)
STEPS = 60
"""Steps over which forces are averaged."""

CATALOGUE = rp.load_catalogue()


def limited_order(rng: np.random.Generator) -> Order:
    """Nine items; about half of them may bear little or nothing, some must be upright."""
    lines = []
    for name in rng.choice(CATALOGUE.names, 9, replace=False).tolist():
        draw, limits = rng.random(), NO_LIMITS
        if draw < 0.2:
            limits = ItemLimits(fragile=True)
        elif draw < 0.5:
            limits = ItemLimits(max_load_kg=float(rng.uniform(0.05, 0.8)))
        if rng.random() < 0.2:
            limits = limits.joined(ItemLimits(upright="z", max_tilt_deg=10.0))
        lines.append(OrderLine(name, 1, limits))
    return Order(tuple(lines))


def plan_of(order: Order) -> Plan:
    return rp.plan(
        order, BOX, CATALOGUE, constraints="stability", geometry="parts", heuristic="hm", restarts=0
    )


def pushed_down(plan: Plan, shelf: ItemShelf) -> dict[int, float] | None:
    """What other items push each placed item down by once the pile has come to rest, kg by step.

    None where it does not come to rest as planned: an item that fell lies on others.
    """
    with World(plan.container, WorldConfig()) as world:
        bodies = [world.add(shelf.physics[p.item], p.rotation, p.position) for p in plan.placements]
        settled = settle(world, 3.0, RestRule())
        moved = [
            np.linalg.norm(world.pose(body).position - p.position)
            for body, p in zip(bodies, plan.placements, strict=True)
        ]
        if not settled.at_rest or max(moved) > 0.01:
            return None
        found = dict.fromkeys(range(1, len(bodies) + 1), 0.0)
        for _ in range(STEPS):
            world.step()
            for step, body in enumerate(bodies, start=1):
                for push in world.pushes(body):
                    if push.other in bodies and push.force[2] < 0.0:
                        found[step] -= float(push.force[2]) / STEPS
    return {step: force / GRAVITY for step, force in found.items()}


@pytest.mark.slow
def test_no_item_of_200_random_piles_bears_more_than_it_may() -> None:
    rng = np.random.default_rng(19)
    piles, limited, measured, close = 0, 0, 0, 0
    squeezed = []
    while piles < 200:
        order = limited_order(rng)
        plan = plan_of(order)
        piles += 1
        found = rp.verify(plan, CATALOGUE)
        assert not found.limits, (order, found.limits)
        bears = [order.limits.get(p.item, NO_LIMITS).bears for p in plan.placements]
        limited += int(np.isfinite(bears).sum())
        shelf = ItemShelf(CATALOGUE)
        pushed = pushed_down(plan, shelf)
        for step, most in enumerate(bears, start=1):
            if pushed is not None and np.isfinite(most):
                measured += 1
                close += pushed[step] > 0.5 * most > 0.0
                if pushed[step] > 1.05 * most + 0.03:
                    squeezed.append((order, step, pushed[step], most))
    assert limited > 500
    assert measured > 250
    assert close > 10
    # An item that is squeezed in between two others, or against a wall, presses harder than it weighs.
    assert len(squeezed) <= 0.02 * measured, squeezed
