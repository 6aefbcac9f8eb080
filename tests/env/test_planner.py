"""Taking the smallest rank, and deferring where none is among the first N, is the planner (Alg. 3 and 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from packenv.config import GridConfig
from packenv.env.observation import HEURISTIC_COLUMNS
from packenv.env.orders import GeneratedOrder
from packenv.env.pack_env import PackEnv
from packenv.items.catalogue import open_catalogue
from packenv.items.shelf import ItemShelf
from packenv.limits import ItemLimits
from packenv.planning.assembly import assemble
from packenv.planning.constraints import Constraint
from packenv.planning.options import Constraints, HeightRule, PlanOptions
from packenv.planning.packing import Packing
from packenv.planning.planner import by_box_volume
from packenv.types import Container, Placement
from tests.env_samples import COARSE, ITEMS, best_action
from tests.planning.own_rules import Apart

GRID = GridConfig(**COARSE)
NONE: Mapping[str, ItemLimits] = MappingProxyType({})
WORDS: dict[str, Constraints] = {"legal": "overlap", "stable": "stability", "robot": "robot"}
MORE = (*ITEMS, "cracker_box", "apple", "banana", "mug", "scissors", "rubber_duck", "pudding_box", "spoon")


class Given:
    """Gives the order that it was told of last."""

    def __init__(self, limits: Mapping[str, ItemLimits]) -> None:
        self.items: Sequence[str] = ()
        self.limits = limits

    def generate(self, rng: np.random.Generator) -> GeneratedOrder:
        return GeneratedOrder(tuple(self.items), limits=self.limits)


def planned(
    order: list[str],
    heuristic: str,
    mask: str,
    size: Any,
    most: int,
    own: Sequence[str | Constraint] = (),
    heights: HeightRule = "map",
    limits: Mapping[str, ItemLimits] = NONE,
) -> Packing:
    shelf = ItemShelf(open_catalogue("builtin"), GRID).with_limits(limits)
    box = Container(*size)
    options = PlanOptions(
        heuristic,
        constraints=WORDS[mask],
        own_constraints=own,
        restarts=0,
        stability="paper",
        max_checked=most,
        heights=heights,
        places="grid",  # as the environment has them
        grid=GRID,
    )
    return assemble(options, shelf, box).pack(by_box_volume(order, shelf.prepared), shelf.prepared, box)


def told(placement: Placement) -> tuple[Any, ...]:
    return (
        placement.item,
        placement.instance,
        placement.route,
        placement.rotation.tobytes(),
        placement.position.tobytes(),
    )


def compare(
    mask: str,
    size: tuple[float, float, float],
    orders: int,
    seed: int,
    most: int = 12,
    heuristics: Sequence[str] = HEURISTIC_COLUMNS,
    own: Sequence[str | Constraint] = (),
    heights: HeightRule = "map",
    limits: Mapping[str, ItemLimits] = NONE,
) -> set[str]:
    """Place orders by either; returns the routes that were used.

    Args:
        mask: of the environment.
        size: of the container.
        orders: how many.
        seed: of the orders.
        most: N.
        heuristics: that take turns; what is no column is given to the environment.
        own: constraints of the user's own.
        heights: how low items come.
        limits: of the orders.
    """
    settings = {
        "mask": mask,
        "containers": [size],
        "grid": COARSE,
        "max_checked": most,
        "candidates": 16,
        "heuristics": [name for name in heuristics if name not in HEURISTIC_COLUMNS],
        "own_constraints": list(own),
        "heights": heights,
    }
    generator = Given(limits)
    env = PackEnv(settings, order_generator=generator)
    rng = np.random.default_rng(seed)
    routes = set()
    for k in range(orders):
        heuristic = heuristics[k % len(heuristics)]
        generator.items = order = [str(name) for name in rng.choice(MORE, 7)]
        obs, _ = env.reset()
        ended = False
        while not ended:
            obs, _, ended, _, _ = env.step(
                best_action(obs, heuristic, most, env.unwrapped._observer.features)
            )
        packing = planned(order, heuristic, mask, size, most, own, heights, limits)
        ours = env.plan()
        assert [told(p) for p in ours.placements] == [told(p) for p in packing.placements], (k, heuristic)
        assert [(x.item, x.instance) for x in ours.leftovers] == [
            (x.item, x.instance) for x in packing.leftovers
        ]
        apart = [
            [(x.item, x.instance, x.detail) for x in leftovers if x.reason == "kept-apart"]
            for leftovers in (ours.leftovers, packing.leftovers)
        ]
        assert apart[0] == apart[1]
        for name in ("Low", "Apart"):
            assert [p.details.get(name) for p in ours.placements] == [
                p.details.get(name) for p in packing.placements
            ]
        routes |= {p.route for p in ours.placements}
    return routes


@pytest.mark.parametrize(
    ("mask", "size", "orders"),
    [
        ("legal", (0.2, 0.2, 0.12), 15),
        ("stable", (0.18, 0.18, 0.12), 5),
        ("robot", (0.18, 0.18, 0.12), 5),
    ],
)
def test_the_environment_holds_the_planner(mask: str, size: tuple[float, float, float], orders: int) -> None:
    compare(mask, size, orders, seed=0)


@pytest.mark.parametrize("mask", ["legal", "stable", "robot"])
def test_items_come_as_low_as_in_the_planner(mask: str) -> None:
    compare(mask, (0.18, 0.18, 0.12), 4, seed=0, heights="mesh")


@pytest.mark.parametrize(("mask", "orders"), [("legal", 8), ("stable", 4), ("robot", 3)])
def test_limits_are_kept_as_in_the_planner(mask: str, orders: int) -> None:
    limits = {
        "mug": ItemLimits(upright=True, fragile=True, keep_apart="glass"),
        "cracker_box": ItemLimits(max_load_kg=0.1),
        "tuna_can": ItemLimits(keep_apart="food"),
        "apple": ItemLimits(keep_apart="food"),
        "rubber_duck": ItemLimits(upright=True),
        "gelatin_box": ItemLimits(fragile=True),
    }
    compare(mask, (0.18, 0.18, 0.12), orders, seed=7, limits=limits)


def test_perturbed_orientations_come_as_in_the_planner() -> None:
    routes = [compare("stable", (0.15, 0.15, 0.1), 5, seed=seed, most=8) for seed in (3, 4)]
    assert set.union(*routes) == {"first-pass", "later", "5d"}


OWN = "tests.planning.own_rules"


@pytest.mark.parametrize("mask", ["legal", "stable", "robot"])
@pytest.mark.parametrize(
    "own",
    [(f"{OWN}:Low",), (f"{OWN}:Apart",), (Apart(0.05), f"{OWN}:Low")],
    ids=["state-free", "state", "both"],
)
def test_with_own_constraints_it_still_holds_the_planner(own: Sequence[str | Constraint], mask: str) -> None:
    """One that knows no state, one that does and objects to orientations, and both; episode by episode."""
    compare(mask, (0.18, 0.18, 0.12), 4 if len(own) == 1 else 2, seed=5, own=own)


@pytest.mark.parametrize("mask", ["legal", "stable", "robot"])
def test_with_own_constraints_and_an_own_heuristic_it_still_holds_the_planner(mask: str) -> None:
    heuristics = (f"{OWN}:flattest", "hm", f"{OWN}:deepest")
    compare(mask, (0.18, 0.18, 0.12), 6, seed=6, heuristics=heuristics)
    compare(mask, (0.18, 0.18, 0.12), 6, seed=7, heuristics=heuristics, own=(f"{OWN}:Apart",))


def test_under_mask_legal_an_own_constraint_brings_the_fallback_too() -> None:
    """What it refuses on every stable pose may pass tilted."""
    routes = compare("legal", (0.18, 0.18, 0.12), 6, seed=8, most=4, own=(Apart(0.06),))
    assert routes == {"first-pass", "5d"}


def test_an_episode_tells_an_own_constraint_of_the_container_and_frees_it_at_the_end() -> None:
    apart = Apart(0.05)
    settings = {"mask": "legal", "containers": [(0.2, 0.2, 0.12)], "grid": COARSE, "own_constraints": [apart]}
    env = PackEnv(settings)
    for episode in range(1, 4):
        env.reset(options={"order": ["soap_bar", "golf_ball"]})
        assert len(apart.told) == episode
        items, container = apart.told[-1]
        assert container.size == (0.2, 0.2, 0.12)
        assert items["soap_bar"].name == "soap_bar"
        assert apart.closed == episode - 1
    env.close()
    assert apart.closed == 3


@pytest.mark.slow
@pytest.mark.parametrize("mask", ["legal", "stable", "robot"])
def test_the_environment_holds_the_planner_on_many_orders(mask: str) -> None:
    routes = compare(mask, (0.17, 0.17, 0.12), 60, seed=3, most=20)
    assert mask == "legal" or routes == {"first-pass", "later", "5d"}


@pytest.mark.parametrize("seed", range(3))
def test_toy_orders_are_solved_by_the_planner(seed: int) -> None:
    env = PackEnv(
        {"mask": "legal", "grid": {"cell_size": 0.01, "grid_step": 0.01, "n_poses": 3, "n_yaws": 2}},
        order_generator={"kind": "toy", "pieces": [4, 6]},
    )
    obs, info = env.reset(seed=seed)
    ended = False
    while not ended:
        obs, _, ended, _, info = env.step(best_action(obs, "dblf"))
    assert info["left_over"] == []
    assert info["utilization"] == pytest.approx(1.0, abs=1e-4)
