"""The default terms and their weights."""

from __future__ import annotations

import pytest

from packenv.reward import WEIGHTS, Outcome, make_reward

NOTHING = Outcome(False, 0, 0.0, 0, 0.0, False, 0, False, False, 4)


def outcome(**changes: object) -> Outcome:
    return Outcome(**{**vars(NOTHING), **changes})  # type: ignore[arg-type]


def test_nothing_is_worth_nothing() -> None:
    terms = make_reward(None)(NOTHING)
    assert set(terms) == set(WEIGHTS)
    assert not any(terms.values())


@pytest.mark.parametrize(
    ("changes", "term", "value"),
    [
        ({"placed": 1, "placed_volume": 0.1}, "packed", 0.25),
        ({"placed": 1, "placed_volume": 0.1}, "utilization", 0.1),
        ({"ended": True, "complete": True}, "complete", 1.0),
        ({"ended": False, "complete": True}, "complete", 0.0),
        ({"outside": 1, "outside_volume": 0.2}, "outside", -0.45),
        ({"outside": -1, "outside_volume": -0.2}, "outside", 0.45),
        ({"collided": True}, "collision", -1.0),
        ({"invalid": True}, "invalid", -0.1),
        ({"left_over": 2}, "left_over", 0.0),
    ],
)
def test_terms(changes: dict[str, object], term: str, value: float) -> None:
    assert make_reward(None)(outcome(**changes))[term] == pytest.approx(value)


def test_weights_scale_their_terms_alone() -> None:
    some = outcome(placed=1, placed_volume=0.1, left_over=2, invalid=True)
    plain, weighted = make_reward(None)(some), make_reward({"left_over": 3.0, "packed": 2.0})(some)
    assert weighted["left_over"] == pytest.approx(-1.5)
    assert weighted["packed"] == pytest.approx(2 * plain["packed"])
    assert weighted["utilization"] == plain["utilization"]


def test_an_item_that_falls_out_takes_back_what_it_gave() -> None:
    reward = make_reward(None)
    gave = sum(reward(outcome(placed=1, placed_volume=0.1)).values())
    took = sum(reward(outcome(outside=1, outside_volume=0.1)).values())
    assert gave + took == pytest.approx(0.0)
