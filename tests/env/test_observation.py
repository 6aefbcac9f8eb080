"""What the arrays of an observation say, against a plain reading of the state behind them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from packenv.env.observation import FEATURES, HEURISTIC_COLUMNS, ITEM_FEATURES, STATE_FEATURES
from packenv.env.pack_env import PackEnv
from packenv.planning.search.candidates import grid_search
from packenv.planning.search.heuristics import HEURISTICS
from tests.env_samples import ITEMS, best_action, make_env, random_action


def column(obs: dict[str, np.ndarray], name: str) -> np.ndarray:
    return obs["candidates"][:, FEATURES.index(name)]


def filled(env: PackEnv, steps: int, seed: int = 0) -> dict[str, np.ndarray]:
    """The observation after some placements."""
    obs, _ = env.reset(seed=seed)
    for _ in range(steps):
        obs, *_ = env.step(best_action(obs, "dblf"))
    return obs


def pooled(cells: np.ndarray, step: int, how: Any) -> np.ndarray:
    """Blocks, one by one."""
    nx, ny = (math.ceil(n / step) for n in cells.shape)
    blocks = [
        [cells[i * step : (i + 1) * step, j * step : (j + 1) * step] for j in range(ny)] for i in range(nx)
    ]
    return np.array([[how(block) for block in row] for row in blocks])


@pytest.mark.parametrize("map_step", [1, 3, 5])
def test_the_container_is_its_heightmap_in_blocks(map_step: int) -> None:
    env = make_env(mask="legal", map_step=map_step)
    obs = filled(env, 3)
    heights = env.unwrapped._episode.arrangement.pile.surface.heights  # type: ignore[union-attr]
    np.testing.assert_array_equal(obs["container"], pooled(heights, map_step, np.max))


def test_what_lies_outside_a_smaller_container_is_as_high_as_it() -> None:
    env = make_env(mask="legal", containers=[[0.16, 0.12, 0.10]])
    obs, _ = env.reset(options={"container": (0.1, 0.08, 0.05)})
    inside = (math.ceil(0.1 / 0.004 / 5), math.ceil(0.08 / 0.004 / 5))
    assert (obs["container"][: inside[0], : inside[1]] == 0.0).all()
    assert (obs["container"][inside[0] :] == np.float32(0.05)).all()
    assert (obs["container"][:, inside[1] :] == np.float32(0.05)).all()


def test_item_maps_are_those_of_its_stable_poses() -> None:
    env = make_env(mask="legal", map_step=3)
    obs, info = env.reset(seed=0)
    prepared = env.unwrapped._shelf.prepared[info["item"]]
    side = max(env.observation_space["container"].shape)
    assert obs["item"].shape == (2, 3, side, side)
    for oriented in prepared.orientations:
        if oriented.yaw != 0.0:
            continue
        top, bottom, share = obs["item"][oriented.pose_index]
        w, h = (min(side, math.ceil(n / 3)) for n in oriented.top.shape)
        np.testing.assert_allclose(top[:w, :h], pooled(oriented.top, 3, np.max)[:w, :h].clip(0, 0.1))
        lowest = pooled(oriented.bottom, 3, np.min)[:w, :h]
        np.testing.assert_allclose(bottom[:w, :h], np.where(np.isfinite(lowest), lowest, 0.0).clip(0, 0.1))
        touched = pooled(oriented.footprint, 3, np.sum)[:w, :h] / 9
        np.testing.assert_allclose(share[:w, :h], touched, rtol=1e-6)
        assert not obs["item"][oriented.pose_index][:, w:].any()
    for pose in range(len(prepared.poses), 2):
        assert not obs["item"][pose].any()


@pytest.mark.parametrize("mask", ["legal", "robot"])
def test_ranks_and_scores_are_the_heuristics(mask: str) -> None:
    env = make_env(mask=mask)
    obs = filled(env, 2)
    episode = env.unwrapped._episode
    assert episode is not None
    orientations = [
        o
        for o in episode.current.orientations  # type: ignore[union-attr]
        if all(c.objection(o) is None for c in episode.constraints)
    ]
    candidates = grid_search(episode.arrangement.pile.surface, orientations, 5)
    oriented = [candidates.grids[g].oriented for g in candidates.grid_index]
    keys = [
        (o.pose_index, round(o.yaw, 3), int(ix), int(iy))
        for o, ix, iy in zip(oriented, candidates.ix, candidates.iy, strict=True)
    ]
    assert len(set(keys)) == len(keys)
    rows = np.flatnonzero(column(obs, "present"))
    told = np.column_stack(
        [column(obs, "pose"), column(obs, "yaw"), column(obs, "x") / 0.004, column(obs, "y") / 0.004]
    )[rows]
    which = [keys.index((round(p), round(yaw, 3), round(x), round(y))) for p, yaw, x, y in told.tolist()]
    assert which == sorted(which)
    for name in HEURISTIC_COLUMNS:
        scores = HEURISTICS[name](candidates, np.random.default_rng(0))
        place = np.empty(len(scores), dtype=int)
        place[np.argsort(scores, kind="stable")] = np.arange(len(scores))
        np.testing.assert_array_equal(column(obs, f"rank_{name}")[rows], place[which])
        scaled = column(obs, f"score_{name}")[rows]
        ranks = column(obs, f"rank_{name}")[rows]
        assert scaled.min() == 0.0
        assert scaled.max() <= 1.0
        assert (np.diff(scaled[np.argsort(ranks)]) >= 0.0).all()


def test_rows_are_candidates_in_their_order_then_padding() -> None:
    env = make_env(mask="legal", candidates=200)
    obs = filled(env, 4)
    present = column(obs, "present")
    count = int(present.sum())
    assert 0 < count < 200
    assert (present[:count] == 1.0).all()
    assert not obs["candidates"][count:].any()
    assert not obs["action_mask"][count:-1].any()
    ranks = column(obs, "rank_first-fit")[:count]
    np.testing.assert_array_equal(ranks, np.sort(ranks))


def test_a_placement_lands_where_its_row_says() -> None:
    env = make_env(mask="legal")
    rng = np.random.default_rng(5)
    obs, _ = env.reset(seed=0)
    ended = False
    while not ended:
        action = random_action(obs["action_mask"], rng)
        row = dict(zip(FEATURES, obs["candidates"][action % 12], strict=True))
        before = len(env.plan().placements)
        obs, _, ended, _, _ = env.step(action)
        placements = env.plan().placements
        if action < 12:
            placed = placements[-1]
            assert len(placements) == before + 1
            np.testing.assert_allclose(placed.corner, [row["x"], row["y"], row["z"]], atol=1e-6)
            np.testing.assert_allclose(
                placed.extents, [row["length"], row["width"], row["height"]], atol=1e-6
            )
            assert placed.yaw == pytest.approx(row["yaw"])
            assert row["com_height"] > row["z"]
            top = placed.corner + placed.extents
            assert (top <= np.array([0.16, 0.12, 0.10]) + 1e-6).all()


def test_an_item_on_the_floor_is_supported_one_over_an_edge_is_not() -> None:
    env = make_env(mask="legal")
    obs, _ = env.reset(seed=0)
    present = column(obs, "present") == 1
    assert (column(obs, "z")[present] == 0.0).all()
    assert (column(obs, "support_margin")[present] > 0.0).all()
    many = make_env(mask="legal", candidates=200)
    found = [filled(many, steps)["candidates"] for steps in range(1, 5)]
    margins = np.concatenate([rows[:, FEATURES.index("support_margin")] for rows in found])
    assert margins.min() < 0.0


def test_items_and_state_follow_the_episode() -> None:
    env = make_env(mask="legal")
    obs, info = env.reset(seed=0)
    shelf = env.unwrapped._shelf
    waiting = sorted(ITEMS, key=lambda n: (-shelf.prepared[n].box_volume, n))
    deferred: list[str] = []
    ended, k = False, 0
    while not ended:
        table = obs["remaining"]
        assert int(table[:, 0].sum()) == len(waiting) == info["items_left"]
        for row, name in zip(table, waiting, strict=False):
            told = dict(zip(ITEM_FEATURES, row, strict=True))
            item, box = shelf.items[name], shelf.prepared[name].orientations[0].extents
            assert [told["length"], told["width"], told["height"]] == pytest.approx(box.tolist(), rel=1e-5)
            assert told["volume"] == pytest.approx(item.volume, rel=1e-5)
            assert told["mass"] == pytest.approx(item.mass, rel=1e-5)
            assert told["share_filled"] == pytest.approx(item.volume / box.prod(), rel=1e-5)
            assert told["deferred"] == (name in deferred)
        state = dict(zip(STATE_FEATURES, obs["state"], strict=True))
        assert state["utilization"] == pytest.approx(info["utilization"])
        assert state["packed_share"] == pytest.approx(info["packed_items"] / len(ITEMS))
        assert state["left_share"] == pytest.approx(info["items_left"] / len(ITEMS))
        assert state["stage"] == info["stage"]
        assert info["item"] == waiting[0]
        action = 12 if k in (0, 2) else best_action(obs)
        name = waiting.pop(0)
        if action == 12:
            deferred.append(name)
            waiting.append(name)
        k += 1
        obs, _, ended, _, info = env.step(action)
        waiting = [n for n in waiting if n not in info["left_over"]]
        if info["item"] is not None and waiting[0] != info["item"]:
            # Passed over: nothing of it is legal.
            at = waiting.index(info["item"])
            deferred += [n for n in waiting[:at] if n not in deferred]
            waiting = waiting[at:] + waiting[:at]
    assert k > len(ITEMS)


def test_online_shows_the_buffer_alone() -> None:
    env = make_env(mask="legal", arrivals="online", buffer=2)
    obs, info = env.reset(seed=0)
    assert info["item"] == ITEMS[0]
    assert int(obs["remaining"][:, 0].sum()) == 2
    _, _, _, _, info = env.step(12)
    assert (info["item"], info["stage"]) == (ITEMS[1], 0)
    obs, _, _, _, info = env.step(best_action(obs))
    assert (info["item"], info["stage"]) == (ITEMS[0], 1)
