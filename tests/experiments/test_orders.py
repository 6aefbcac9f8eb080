"""Random orders of measurements."""

from __future__ import annotations

from packenv.experiments.orders import random_orders, small_orders

NAMES = [f"item{k}" for k in range(12)]


def test_orders_depend_on_the_seed_alone_and_hold_no_item_twice() -> None:
    for draw in (lambda seed: random_orders(NAMES, 10, 40, seed), lambda seed: small_orders(NAMES, 40, seed)):
        orders = draw(3)
        assert orders == draw(3)
        assert orders != draw(4)
        assert len(orders) == 40
        for order in orders:
            assert len(set(order)) == len(order)
            assert set(order) <= set(NAMES)


def test_small_orders_have_three_to_five_items() -> None:
    assert {len(order) for order in small_orders(NAMES, 200, 0)} == {3, 4, 5}


def test_more_orders_begin_with_the_same_ones() -> None:
    """So a run of 200 goes on where one of 20 ended."""
    assert random_orders(NAMES, 10, 40, 0)[:20] == random_orders(NAMES, 10, 20, 0)
