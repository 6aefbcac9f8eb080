"""Stable-Baselines3's and sb3-contrib's own policies learn in the environment as it comes."""

from __future__ import annotations

from typing import Any

import gymnasium
import pytest

torch = pytest.importorskip("torch", reason="training needs torch (pip install 'robotpack[train]')")
pytest.importorskip("stable_baselines3", reason="training needs it (pip install 'robotpack[train]')")
pytest.importorskip("sb3_contrib", reason="training needs sb3-contrib (pip install 'robotpack[train]')")

from sb3_contrib import MaskablePPO  # noqa: E402
from stable_baselines3 import PPO  # noqa: E402
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv  # noqa: E402

import packenv  # noqa: E402, F401
from tests.env_samples import CONFIG, make_env  # noqa: E402


def made() -> gymnasium.Env[Any, Any]:
    """A small environment with all that gymnasium wraps around it."""
    order = {"kind": "list", "items": ["golf_ball", "soap_bar"]}
    return gymnasium.make("RobotPack-v0", config={**CONFIG, "mask": "legal"}, order_generator=order)


@pytest.mark.parametrize("vector", [DummyVecEnv, SubprocVecEnv])
@pytest.mark.parametrize("algorithm", [PPO, MaskablePPO])
def test_a_default_policy_learns(algorithm: type[PPO], vector: type[VecEnv]) -> None:
    envs = vector([made, made])
    try:
        model = algorithm("MultiInputPolicy", envs, n_steps=8, batch_size=8, n_epochs=1, device="cpu")
        before = {name: p.detach().clone() for name, p in model.policy.named_parameters()}
        model.learn(16)
        assert model.num_timesteps == 16
        after = dict(model.policy.named_parameters())
        assert any(not torch.equal(before[name], after[name]) for name in before)
    finally:
        envs.close()


def test_no_key_of_the_observation_is_an_attribute_of_a_module() -> None:
    """Stable-Baselines3 keeps an extractor for each key in a ModuleDict, which refuses names of its own."""
    env = make_env()
    keys = set(env.observation_space.spaces)
    taken = {name for module in (torch.nn.ModuleDict(), torch.nn.Module()) for name in dir(module)}
    assert keys & taken == set()
    env.close()
