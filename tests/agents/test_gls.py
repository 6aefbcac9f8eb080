"""Guided local search as an agent: it goes where its layout says, as far as that is offered, and repeats itself."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

from packenv.agents import make
from packenv.agents.gls import GLS, nearest
from packenv.env.observation import FEATURES
from packenv.env.pack_env import PackEnv
from packenv.errors import InputError

ORDER = ("cracker_box", "foam_brick", "gelatin_box", "padlock", "pudding_box", "foam_brick", "sugar_box")
CONFIG: dict[str, Any] = {
    "mask": "legal",
    "containers": [[0.22, 0.2, 0.16]],
    "grid": {"cell_size": 0.005, "grid_step": 0.01, "n_poses": 3, "n_yaws": 2},
    "candidates": 256,
}
ORDERS = {"kind": "list", "items": list(ORDER)}
AT = [FEATURES.index(name) for name in ("x", "y", "z")]


def episode() -> tuple[list[int], int]:
    """The actions of one, and how many of them the layout decided."""
    env, agent = PackEnv(CONFIG, order_generator=ORDERS), GLS(CONFIG, plans=20)
    obs, info = env.reset(seed=1)
    agent.reset(1)
    layout = agent.layout((0.22, 0.2, 0.16), info["order"])
    assert set(layout) <= {(name, 1 + k) for name in ORDER for k in range(ORDER.count(name))}
    actions: list[int] = []
    by_layout = 0
    ended = False
    while not ended:
        action = agent.act(obs, info)
        place = layout.get((info["item"], info["instance"]))
        best = None if place is None else nearest(obs, place)
        if place is not None and best is not None:
            assert action == best
            row, same = obs["candidates"][action], obs["candidates"][:, 8] == place.pose_index
            away = np.linalg.norm(obs["candidates"][:, AT] - place.corner, axis=1)
            valid = (obs["action_mask"][:-1] != 0) & same & (abs(obs["candidates"][:, 7] - place.yaw) < 1e-4)
            by_layout += 1
            assert np.linalg.norm(row[AT] - place.corner) == pytest.approx(away[valid].min(), abs=1e-6)
        actions.append(action)
        obs, _, ended, _, info = env.step(action)
        assert not info["invalid_action"]
    return actions, by_layout


def test_items_go_to_the_nearest_offered_place_of_the_layout_and_again_the_same() -> None:
    actions, by_layout = episode()
    assert (actions, by_layout) == episode()
    assert by_layout >= len(ORDER) - 2


def test_a_vector_environment_is_played_as_single_ones() -> None:
    envs = gymnasium.vector.SyncVectorEnv([lambda: PackEnv(CONFIG, order_generator=ORDERS)] * 2)
    agent = make("gls", config=CONFIG, plans=20)
    obs, infos = envs.reset(seed=[1, 2])
    for _ in range(3):
        actions = agent.act_batch(obs, infos)
        single = [
            agent.act({k: v[n] for k, v in obs.items()}, {k: v[n] for k, v in infos.items()})
            for n in range(2)
        ]
        assert actions.tolist() == single
        obs, _, _, _, infos = envs.step(actions)


def test_what_hides_the_order_is_refused() -> None:
    with pytest.raises(InputError, match="arrivals is 'online'"):
        GLS({"arrivals": "online"})
    with pytest.raises(InputError, match="plans is 0"):
        GLS(plans=0)
    env = PackEnv({**CONFIG, "arrivals": "online", "sequence": "given"}, order_generator=ORDERS)
    assert env.reset(seed=0)[1]["order"] == ()
