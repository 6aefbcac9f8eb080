"""The environments that a policy is trained and evaluated in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecMonitor

from packenv.env.pack_env import PackEnv

from .config import TrainConfig

_FIRST_HELD_OUT_SEED = 1_900_000_000


def training_environments(config: TrainConfig) -> VecEnv:
    """As many environments as there are workers, with returns and lengths of their episodes in ``info``."""
    makers: list[Callable[[], gymnasium.Env[Any, Any]]]
    makers = [partial(_make, config.env_config, config.order_generator, config.reward)] * config.workers
    return VecMonitor(DummyVecEnv(makers) if config.workers == 1 else SubprocVecEnv(makers))


def evaluation_environment(config: TrainConfig) -> PackEnv:
    """One environment with the orders of the held-out episodes."""
    orders = config.evaluation_order_generator
    return _make(config.env_config, config.order_generator if orders is None else orders, config.reward)


def training_seed(seed: int, timesteps: int) -> int:
    """The seed that the environments start from at a checkpoint.

    Environments are started anew at every checkpoint, so a run that goes on from one meets the same orders as
    a run that never stopped.
    """
    return int(np.random.SeedSequence([seed, timesteps]).generate_state(1)[0]) % _FIRST_HELD_OUT_SEED


def held_out_seeds(episodes: int) -> range:
    """Seeds of the evaluation's episodes; training never starts an environment with one of them."""
    return range(_FIRST_HELD_OUT_SEED, _FIRST_HELD_OUT_SEED + episodes)


def _make(
    env_config: Mapping[str, Any], orders: Mapping[str, Any] | None, reward: Mapping[str, Any] | None
) -> PackEnv:
    return PackEnv(dict(env_config), order_generator=orders, reward_fn=reward)
