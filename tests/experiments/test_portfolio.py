"""The experiment on ``auto``: halves that share no item, and figures that are those of its rows."""

from __future__ import annotations

from typing import Any

from hypothesis import given, strategies as st

from experiments.portfolio import half_of, summarize


@given(st.sets(st.text("abc", min_size=1)))
def test_the_halves_share_no_item_and_lack_none(names: set[str]) -> None:
    first, second = half_of(list(names), "first"), half_of(list(names), "second")
    assert sorted([*first, *second]) == half_of(list(names), "all") == sorted(names)
    assert 0 <= len(first) - len(second) <= 1


def row(index: int, rule: str, placed: int, height: float) -> dict[str, Any]:
    return {
        "half": "second", "size": 4, "index": index, "rule": rule, "placed": placed, "complete": placed == 4,
        "height": height, "made_by": "minz", "cpu_s": 0.1 * (index + 1),
    }  # fmt: skip


def test_figures_are_compared_with_the_single_rules_order_by_order() -> None:
    rows = [
        row(0, "auto", 4, 0.2), row(0, "hm", 4, 0.3), row(0, "minz", 3, 0.1),
        row(1, "auto", 2, 0.2), row(1, "hm", 3, 0.5), row(1, "minz", 3, 0.4),
        {"half": "second", "size": 4, "index": 2, "rule": "auto", "error": "lost"},
    ]  # fmt: skip
    by_rule = {line["rule"]: line for line in summarize(rows)}
    auto = by_rule["auto"]
    assert (auto["orders"], auto["whole"], auto["placed"], auto["fullest"]) == (2, 0.5, 0.75, 1)
    assert abs(auto["height_mean"] - 0.2) < 1e-12
    assert abs(auto["lowest_mean"] - (0.3 + 0.4) / 2) < 1e-12
    assert (by_rule["hm"]["fullest"], by_rule["minz"]["fullest"]) == (2, 1)
