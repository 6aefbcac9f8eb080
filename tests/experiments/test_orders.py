"""Random orders of measurements."""

from __future__ import annotations

from pathlib import Path

import pytest

from packenv.errors import InputError
from packenv.experiments.orders import random_orders, small_orders, unseen_items

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
    assert small_orders(NAMES, 40, 0)[:20] == small_orders(NAMES, 20, 0)


def test_unseen_items_are_every_second_one_or_those_of_a_file(tmp_path: Path) -> None:
    assert unseen_items(["d", "a", "c", "b"], "second-half") == ["b", "d"]
    file = tmp_path / "names"
    file.write_text("c\n\n a\n")
    assert unseen_items(["a", "b", "c"], str(file)) == ["a", "c"]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a\nbananna\n", "no item 'bananna'; did you mean 'banana'"),
        ("\n", "is empty"),
        (None, "cannot be read"),
    ],
)
def test_a_wrong_file_of_unseen_items_is_one_line(tmp_path: Path, text: str | None, told: str) -> None:
    file = tmp_path / "names"
    if text is not None:
        file.write_text(text)
    with pytest.raises(InputError) as problem:
        unseen_items(["a", "banana"], str(file))
    assert told in str(problem.value)
    assert "names" in str(problem.value)
    assert "\n" not in str(problem.value)
