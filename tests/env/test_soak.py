"""Ten thousand random actions, valid and invalid ones, in every mode."""

from __future__ import annotations

import gc
from typing import Any

import numpy as np
import pytest

from tests.env_samples import Drawn, make_env

psutil = pytest.importorskip("psutil", reason="psutil tells the memory in use: install robotpack[dev]")

MODES: dict[str, dict[str, Any]] = {
    "legal": {"mask": "legal"},
    "stable": {"mask": "stable", "max_checked": 4},
    "robot": {"mask": "robot", "max_checked": 4},
    "no-fallback": {"mask": "robot", "fallback": False},
    "online": {"mask": "robot", "arrivals": "online", "buffer": 2},
    "terminate": {"mask": "stable", "on_infeasible": "terminate"},
    "physics": {"mask": "legal", "physics": True},
    "robot-physics": {"mask": "robot", "physics": True, "fallback": False},
}

GROWTH = 40e6
"""Most that the second half of a run may add to the process, bytes."""


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_ten_thousand_actions(mode: str) -> None:
    env = make_env(**MODES[mode], order_generator=Drawn())
    rng = np.random.default_rng(1)
    process = psutil.Process()
    obs, info = env.reset(seed=0)
    halfway = 0.0
    for step in range(10_000):
        mask = info["action_mask"]
        draw = rng.random()
        if env.config.physics and draw < 0.85:  # a placement in physics takes its time
            action = int(rng.choice(np.append(np.flatnonzero(mask == 0), [-1, len(mask)])))
        elif draw < 0.3:
            action = int(rng.integers(-2, len(mask) + 2))
        else:
            action = int(rng.choice(np.flatnonzero(mask)))
        obs, reward, terminated, truncated, info = env.step(action)
        assert env.observation_space.contains(obs)
        assert all(np.isfinite(value).all() for value in obs.values())
        assert np.isfinite(reward)
        if terminated or truncated:
            obs, info = env.reset()
        if step == 4_999:
            gc.collect()
            halfway = process.memory_info().rss
    gc.collect()
    assert process.memory_info().rss - halfway < GROWTH
    env.close()
