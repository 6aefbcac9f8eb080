"""Environments by name."""

from __future__ import annotations

import statistics

import gymnasium
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

import packenv  # noqa: F401  registers them
from packenv import agents
from packenv.agents.running import run_episode
from packenv.env.pack_env import PackEnv
from packenv.env.presets import PRESETS, env_id


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_an_environment_that_json_can_say(name: str) -> None:
    spec = gymnasium.spec(env_id(name))
    assert EnvSpec.from_json(spec.to_json()) == spec
    made = gymnasium.make(env_id(name)).unwrapped
    assert isinstance(made, PackEnv)
    assert made.config == PackEnv(PRESETS[name].config).config
    made.close()


def test_a_preset_passes_gymnasiums_checks() -> None:
    check_env(gymnasium.make(env_id("tight-online")).unwrapped)


@pytest.mark.parametrize("name", ["tight-offline", "tight-online"])
def test_tight_presets_tell_agents_apart(name: str) -> None:
    """Chance packs clearly less than HM, and neither packs everything."""
    env = gymnasium.make(env_id(name))
    returns = {
        who: [
            run_episode(env, agents.make(who), name=who, episode=seed, seed=seed).total_reward
            for seed in range(12)
        ]
        for who in ("random", "hm")
    }
    gaps = [hm - chance for hm, chance in zip(returns["hm"], returns["random"], strict=True)]
    # One-sided, 95 %: Student's 1.796 with 11 degrees of freedom.
    assert statistics.fmean(gaps) > 1.796 * statistics.stdev(gaps) / 12**0.5
    assert min(returns["hm"]) < 2.0
    env.close()
