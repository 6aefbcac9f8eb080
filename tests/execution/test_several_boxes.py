"""One order in several boxes: every piece in one of them, each a plan that verifies, as few boxes as must be."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

import packenv as rp
from packenv.config import GridConfig
from packenv.io.plans import plan_to_json
from packenv.items.catalogue import Catalogue
from packenv.types import Container, Order
from tests.shapes import box

GRID = GridConfig(cell_size=0.004, grid_step=0.02, n_poses=2, n_yaws=2)
OVERLAP: dict[str, Any] = {"constraints": "overlap", "grid": GRID}
SMALL, FLAT, LARGE = (
    Container(0.12, 0.10, 0.08, "small"),
    Container(0.30, 0.20, 0.06, "flat"),
    Container(0.20, 0.18, 0.14, "large"),
)
KINDS = [SMALL, FLAT, LARGE]
_SIZES = np.random.default_rng(5).integers(2, 11, (12, 3)) * 0.01
ITEMS = {f"b{k:02}": box(*size, f"b{k:02}") for k, size in enumerate(_SIZES.tolist())}
NAMES = sorted(ITEMS)
CATALOGUE = Catalogue.of_items(
    {**ITEMS, "rod": box(0.28, 0.03, 0.03, "rod"), "beam": box(0.9, 0.1, 0.1, "beam")}
)


def drawn(seed: int, count: int) -> Order:
    return Order.of(*map(str, np.random.default_rng(seed).choice(NAMES, count)))


def boxed(order: Order, most: int, kinds: list[Container] | None = None, **words: Any) -> tuple[rp.Plan, ...]:
    return rp.plan_boxes(order, kinds or KINDS, CATALOGUE, boxes_max=most, **{**OVERLAP, **words})


def ordered(plans: tuple[rp.Plan, ...]) -> Counter[str]:
    return Counter(line.item for plan in plans for line in plan.order for _ in range(line.qty))


def pieces(plan: rp.Plan) -> list[tuple[str, int]]:
    return sorted((piece.item, piece.instance) for piece in (*plan.placements, *plan.leftovers))


def cubes(side: float, count: int, name: str = "cube") -> tuple[Catalogue, Order]:
    return Catalogue.of_items({name: box(side, side, side, name)}), Order.of(*[name] * count)


@pytest.mark.parametrize(("seed", "most"), [(0, 1), (1, 2), (2, 9), (3, 9)])
def test_every_piece_of_an_order_is_in_one_plan_of_at_most_so_many(seed: int, most: int) -> None:
    order = drawn(seed, 20)
    plans = boxed(order, most)
    assert len(plans) <= most
    assert ordered(plans) == Counter(order.names)
    for plan in plans:
        numbers = Counter(line.item for line in plan.order for _ in range(line.qty))
        assert pieces(plan) == sorted((name, k) for name, n in numbers.items() for k in range(1, n + 1))
        assert plan.placements
        assert plan.metrics["ordered"] == sum(numbers.values())
        assert rp.verify(plan, CATALOGUE).ok
    assert all(plan.complete for plan in plans[:-1])
    if most == 9:
        assert plans[-1].complete


@pytest.mark.parametrize("constraints", ["stability", "robot"])
def test_each_plan_of_a_robot_verifies(constraints: str) -> None:
    kinds = [SMALL, Container(0.15, 0.14, 0.10)]
    plans = boxed(drawn(3, 12), 9, kinds, constraints=constraints, heuristic="minz")
    assert len(plans) > 1
    assert all(rp.verify(plan, CATALOGUE).ok for plan in plans)


@pytest.mark.parametrize("count", [1, 8, 9, 24])
def test_cubes_take_as_many_boxes_as_they_must(count: int) -> None:
    catalogue, order = cubes(0.05, count)
    kind = Container(0.10, 0.10, 0.10)
    plans = rp.plan_boxes(order, kind, catalogue, boxes_max=9, constraints="overlap", cell_size=0.005)
    assert len(plans) == -(-count // 8)
    assert sum(len(plan.placements) for plan in plans) == count


@pytest.mark.parametrize(
    ("count", "expected"), [(3, ["four"]), (6, ["eight"]), (9, ["one", "eight"]), (12, ["four", "eight"])]
)
def test_of_as_many_boxes_those_with_least_volume_are_taken(count: int, expected: list[str]) -> None:
    catalogue, order = cubes(0.05, count)
    kinds = [
        Container(0.05, 0.05, 0.05, "one"),
        Container(0.1, 0.1, 0.05, "four"),
        Container(0.1, 0.1, 0.1, "eight"),
    ]
    plans = rp.plan_boxes(order, kinds, catalogue, boxes_max=9, constraints="overlap", cell_size=0.005)
    assert sorted(str(plan.container.name) for plan in plans) == sorted(expected)


def test_two_boxes_of_a_middle_size_go_before_a_large_one_and_a_small_one() -> None:
    """13 cubes do not fit one of 12: 12 and 4 places are more volume than 7 and 7."""
    catalogue, order = cubes(0.05, 13)
    row = [Container(0.05 * n, 0.05, 0.05, f"row {n}") for n in (4, 7, 12)]
    plans = rp.plan_boxes(order, row, catalogue, boxes_max=3, constraints="overlap", cell_size=0.005)
    assert [plan.container.name for plan in plans] == ["row 7", "row 7"]


@pytest.mark.parametrize("seed", range(2))
def test_one_box_is_the_plan_of_today(seed: int) -> None:
    short, long = drawn(seed, 5), drawn(seed, 20)
    for order, most in ((short, 1), (long, 1), (short, 5)):
        (plan,) = boxed(order, most)
        assert plan_to_json(plan) == plan_to_json(rp.plan(order, KINDS, CATALOGUE, **OVERLAP))


@pytest.mark.parametrize("heuristic", ["auto", "random"])
def test_the_same_seed_gives_the_same_boxes(heuristic: str) -> None:
    once, again = (boxed(drawn(1, 20), 9, heuristic=heuristic, seed=4) for _ in range(2))
    assert [plan_to_json(plan) for plan in once] == [plan_to_json(plan) for plan in again]


def test_what_fits_no_box_is_left_over_and_opens_none() -> None:
    alone = boxed(Order.of("b01", "beam"), 5)
    assert len(alone) == 1
    assert [(left.item, left.reason) for left in alone[0].leftovers] == [("beam", "larger-than-container")]
    order = Order.of("beam", *drawn(0, 20).names, "beam")
    plans, without = boxed(order, 9), boxed(drawn(0, 20), 9)
    assert [plan.container for plan in plans] == [plan.container for plan in without]
    assert ordered(plans) == Counter(order.names)
    assert [left.item for plan in plans for left in plan.leftovers] == ["beam", "beam"]
    assert len(boxed(Order.of("beam", "beam"), 5)) == 1


def test_what_the_largest_box_does_not_take_goes_into_another_kind() -> None:
    """A rod of 28 cm lies in the flat box alone, whose volume is less than the large one's."""
    assert LARGE.volume > FLAT.volume
    plans = boxed(Order.of("rod", *drawn(2, 20).names), 9)
    assert all(plan.complete for plan in plans)
    (where,) = (plan.container for plan in plans if any(p.item == "rod" for p in plan.placements))
    assert where is FLAT


@pytest.mark.parametrize("count", [2, 3, 5])
def test_what_a_box_may_hold_counts_for_each(count: int) -> None:
    catalogue, order = cubes(0.05, count)
    mass = box(0.05, 0.05, 0.05).mass
    kind = Container(0.2, 0.2, 0.2, max_kg=2.5 * mass)
    plans = rp.plan_boxes(order, kind, catalogue, boxes_max=4, constraints="overlap", cell_size=0.005)
    assert len(plans) == -(-count // 2)
    assert all(len(plan.placements) <= 2 and plan.complete for plan in plans)
    heavy = Container(0.2, 0.2, 0.2, max_kg=0.5 * mass)
    (refused,) = rp.plan_boxes(order, heavy, catalogue, boxes_max=4, constraints="overlap", cell_size=0.005)
    assert [left.reason for left in refused.leftovers] == ["box-overweight"] * count


class OneOfAName(rp.Constraint):
    """Like groups that are kept apart: no second piece of one item beside the first."""

    def start(self, resting: Any = ()) -> Any:
        return ()

    def check(self, trial: rp.Trial, surface: Any, state: Any) -> rp.Verdict:
        name = trial.oriented.item
        return rp.Verdict(name not in state, "twice", state=(*state, name))


def test_what_is_refused_beside_others_goes_into_a_box_of_its_own() -> None:
    order = Order.of("b01", "b01", "b01", "b02")
    plans = boxed(order, 5, own_constraints=[OneOfAName()], heuristic="minz")
    assert len(plans) == 3
    assert all(plan.complete for plan in plans)
    two = boxed(order, 2, own_constraints=[OneOfAName()], heuristic="minz")
    assert [len(plan.leftovers) for plan in two] == [0, 1]


@pytest.mark.parametrize("most", [0, -1, 1.5, True, "2", None])
def test_a_number_of_boxes_that_is_none_is_refused(most: Any) -> None:
    with pytest.raises(rp.InputError, match=r"boxes_max is .*whole number"):
        boxed(drawn(0, 3), most)


def test_groups_that_are_kept_apart_go_into_boxes_of_their_own() -> None:
    names = ["soup_can", "tuna_can", "padlock", "pliers", "sponge"]
    groups = {"soup_can": "food", "tuna_can": "food", "padlock": "tools", "pliers": "tools"}
    limits = {name: rp.ItemLimits(keep_apart=group) for name, group in groups.items()}
    order = rp.Order.of(*names, limits=limits)
    words = {"constraints": "overlap", "heuristic": "hm"}
    plans = rp.plan_boxes(order, "0.3x0.3x0.2", boxes_max=3, **words)
    assert len(plans) == 2
    assert sorted(p.item for plan in plans for p in plan.placements) == sorted(names)
    for plan in plans:
        assert len({groups[p.item] for p in plan.placements if p.item in groups}) == 1
        assert rp.verify(plan).ok
    (one,) = rp.plan_boxes(order, "0.3x0.3x0.2", boxes_max=1, **words)
    assert {left.reason for left in one.leftovers} == {"kept-apart"}
