"""The default terms and their weights, and rewards of one's own."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from packenv.env.reward import WEIGHTS, Outcome, make_reward
from packenv.errors import InputError
from tests.env_samples import best_action, make_env, volume_alone

NOTHING = Outcome(
    False, 0, 0.0, 0, 0.0, False, 0, False, False, 4, placements=(), heights=np.zeros((2, 2), np.float32)
)
NO_REWARD = 3.0


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


@pytest.mark.parametrize("number", [2.0, 2, np.float32(2), np.int64(2), Fraction(2)])
def test_a_number_is_a_term_of_its_own(number: Any) -> None:
    terms = make_reward(lambda outcome: number)(NOTHING)
    assert terms == {"custom": 2.0}
    assert type(terms["custom"]) is float
    assert make_reward(lambda outcome: {"a": number, "b": -1})(NOTHING) == {"a": 2.0, "b": -1.0}


@pytest.mark.parametrize(
    ("returned", "told"),
    [
        (None, "reward_fn returned None, give a finite number"),
        ("much", "reward_fn returned 'much', give a finite number"),
        (True, "reward_fn returned True, give a finite number"),
        (math.nan, "reward_fn returned nan, give a finite number"),
        (-math.inf, "reward_fn returned -inf, give a finite number"),
        (10**400, "give a finite number"),
        ([1.0, 2.0], r"reward_fn returned \[1.0, 2.0\], give a finite number"),
        (np.zeros((2, 2)), "reward_fn returned array"),
        ({"a": 1.0, "b": None}, "reward_fn returned None as its term 'b', give finite numbers by name"),
        ({"a": "much"}, "reward_fn returned 'much' as its term 'a'"),
        ({"a": math.inf}, "reward_fn returned inf as its term 'a'"),
        ({3: 1.0}, "as its term 3, give finite numbers by name"),
    ],
)
def test_anything_else_is_told_in_one_line(returned: Any, told: str) -> None:
    with pytest.raises(InputError, match=told) as caught:
        make_reward(lambda outcome: returned)(NOTHING)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="reward_fn returned"):
        make_env(mask="legal", reward_fn=lambda outcome: returned).reset(seed=0)


@pytest.mark.parametrize(
    ("choice", "told"),
    [
        ("tests.env.test_reward:NO_REWARD", r"NO_REWARD: is 3\.0, name a function"),
        ("tests.env.test_reward:no_such_reward", "has no 'no_such_reward'"),
        ("packed", "my_module:my_r"),
        (1.0, r"reward_fn is 1\.0, give weights by term, a function"),
        ([1.0], r"reward_fn is \[1\.0\], give weights by term, a function"),
    ],
)
def test_what_is_no_reward_is_told_in_one_line(choice: Any, told: str) -> None:
    with pytest.raises(InputError, match=told) as caught:
        make_env(reward_fn=choice)
    assert "reward_fn" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("reward_fn", [volume_alone, "tests.env_samples:volume_alone"])
def test_a_plain_number_is_the_reward_of_the_environment(reward_fn: Any) -> None:
    env = make_env(mask="legal", reward_fn=reward_fn)
    obs, info = env.reset(seed=0)
    assert [key for key in info if key.startswith("reward_")] == ["reward_custom"]
    assert info["reward_custom"] == 0.0
    obs, reward, _, _, info = env.step(best_action(obs))
    assert reward == info["reward_custom"] == info["utilization"] > 0.0
    copy = pickle.loads(pickle.dumps(env))
    action = best_action(obs)
    assert copy.step(action)[1] == env.step(action)[1]


def _ask(mask: str, check: Callable[[Outcome], None] | None = None) -> list[Outcome]:
    """The outcomes of an episode, each after ``check`` had it."""
    seen: list[Outcome] = []

    def reward(outcome: Outcome) -> float:
        seen.append(outcome)
        if check is not None:
            check(outcome)
        return 0.0

    env = make_env(mask=mask, reward_fn=reward)
    obs, _ = env.reset(seed=0)
    ended = False
    while not ended:
        surface = env._episode.arrangement.pile.surface  # type: ignore[union-attr]
        assert (surface.heights == seen[-1].heights).all() or check is not None
        obs, _, ended, _, _ = env.step(best_action(obs))
    plan = env.plan()
    assert [p.item for p in seen[-1].placements] == [p.item for p in plan.placements]
    assert all((p.position < 1.0).all() and p.details for p in plan.placements)
    env.close()
    return seen


def test_an_outcome_shows_the_placements_and_the_heightmap_after_the_action() -> None:
    seen = _ask("stable")
    assert seen[0].placements == ()
    assert not seen[0].heights.any()
    assert (seen[0].heights.shape, seen[0].heights.dtype) == ((40, 30), np.float32)
    for before, after in pairwise(seen):
        assert after.placements[: len(before.placements)] == before.placements
        assert len(after.placements) == len(before.placements) + after.placed
        assert (after.heights >= before.heights).all()
        if after.placed:
            newest = after.placements[-1]
            assert after.heights.max() >= newest.corner[2] + newest.extents[2] - 1e-6
            assert "stability" in newest.details


def test_what_a_reward_writes_into_an_outcome_changes_nothing() -> None:
    def spoil(outcome: Outcome) -> None:
        outcome.heights[:] = 9.0
        for placement in outcome.placements:
            placement.rotation[:] = placement.position[:] = placement.corner[:] = placement.extents[:] = 9.0
            placement.details.clear()
            placement.rejections.clear()

    plain, spoiled = _ask("stable"), _ask("stable", spoil)
    assert [len(o.placements) for o in spoiled] == [len(o.placements) for o in plain]
    assert [o.placed_volume for o in spoiled] == [o.placed_volume for o in plain]
