"""The environment with physics on: measured poses, what sticks out, collisions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from packenv.env.arrangement import Landing
from packenv.env.pack_env import PackEnv
from packenv.planning.search.measured import Resting, measured_map
from tests.env_samples import best_action, make_env

pytestmark = pytest.mark.usefixtures("auto")


def play(env: PackEnv, steps: int) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    obs, info = env.reset(seed=0)
    for _ in range(steps):
        obs, _, ended, _, info = env.step(best_action(obs, "dblf"))
        if ended:
            break
    return obs, info


@pytest.mark.parametrize("mask", ["legal", "robot"])
def test_the_heightmap_is_that_of_the_measured_poses(mask: str) -> None:
    env = make_env(mask=mask, physics=True)
    play(env, 3)
    episode = env._episode
    assert episode is not None
    poses = episode.arrangement.poses
    assert len(poses) == len(episode.placements) == 3
    resting = [
        Resting(episode.shelf.shapes[p.item], *pose)
        for p, pose in zip(episode.placements, poses, strict=True)
    ]
    known = measured_map(episode.container, 0.004, resting)
    np.testing.assert_array_equal(episode.arrangement.pile.surface.heights, known.heights)
    env.close()


def test_drop_and_shift_are_told_and_zero_without_physics() -> None:
    for physics in (False, True):
        env = make_env(mask="stable", physics=physics)
        obs, info = env.reset(seed=0)
        assert info["drop"] == info["shift"] == 0.0
        drops = []
        for _ in range(3):
            obs, _, _, _, info = env.step(best_action(obs, "dblf"))
            assert info["shift"] >= 0.0
            drops.append(info["drop"])
        # Released a centimetre above its place.
        assert [0.005 < drop < 0.03 for drop in drops] == [physics] * 3
        env.close()


@pytest.mark.parametrize("robot", [False, True])
def test_the_robot_is_in_the_world_where_the_mask_asks_it(robot: bool) -> None:
    env = make_env(mask="robot" if robot else "stable", physics=True)
    play(env, 1)
    session = env._episode.arrangement.session  # type: ignore[union-attr]
    assert (session._robot is not None) is robot
    assert (env.plan().placements[0].path is not None) is robot
    env.close()


def landing(env: PackEnv, monkeypatch: pytest.MonkeyPatch, fake: Landing) -> tuple[Any, ...]:
    """The second step of an episode, told that this came of it."""
    obs, _ = env.reset(seed=0)
    obs, *_ = env.step(best_action(obs, "dblf"))
    arrangement = env._episode.arrangement  # type: ignore[union-attr]
    real = arrangement.place

    def place(*args: Any) -> Landing:
        real(*args)
        return fake

    monkeypatch.setattr(arrangement, "place", place)
    return env.step(best_action(obs, "dblf"))


def test_what_sticks_out_counts_no_more_and_the_episode_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    env = make_env(mask="legal")
    _, _, ended, _, info = landing(env, monkeypatch, Landing(outside=frozenset({0})))
    assert not ended
    first = env.plan().placements[0].item
    assert info["outside"] == [first]
    assert info["packed_items"] == 1
    share = env._shelf.items[first].volume / env._episode.container.volume  # type: ignore[union-attr]
    assert info["reward_outside"] == pytest.approx(-(1 / 6 + share))


@pytest.mark.parametrize("fake", [Landing(collided=True), Landing(outside=frozenset({1}), lost=True)])
def test_a_collision_or_a_lost_item_ends_the_episode(monkeypatch: pytest.MonkeyPatch, fake: Landing) -> None:
    env = make_env(mask="legal")
    _, _, ended, _, info = landing(env, monkeypatch, fake)
    assert ended
    assert info["collision"] is fake.collided
    assert info["reward_collision"] == (-1.0 if fake.collided else 0.0)
    assert info["reward_complete"] == 0.0
    assert len(info["left_over"]) == 4


def test_an_item_hung_over_the_rim_is_outside_and_one_beside_is_lost() -> None:
    env = make_env(mask="legal", physics=True)
    play(env, 1)
    arrangement = env._episode.arrangement  # type: ignore[union-attr]
    name = env.plan().placements[0].item
    shape = env._shelf.shapes[name]
    inside = -shape.vertices.min(axis=0) + 0.001
    cases = ((0.0, False, False), (-0.01, True, False), (-1.0, True, True))
    for shift, over, lost in cases:
        at = inside + np.array([shift, 0.0, 0.0])
        found = arrangement._beyond([Resting(shape, np.eye(3), at)])
        assert found == ({0} if over else set(), {0} if lost else set())
    env.close()
