"""A training run from its configuration to its last checkpoint."""

from __future__ import annotations

from collections.abc import Callable

import torch
from sb3_contrib import MaskablePPO
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecEnv

from packenv.agents import make
from packenv.agents.placement_network import ObservationLayout
from packenv.agents.policy_files import current_layout
from packenv.env.config import PackConfig
from packenv.env.pack_env import PackEnv

from .checkpoints import Checkpoints
from .config import TrainConfig
from .environments import evaluation_environment, held_out_seeds, training_environments
from .evaluation import evaluate
from .policy import PlacementPolicy
from .runs import Checkpoint, Row, RunFolder

BASELINES = ("random", "hm")
"""Agents that a policy is compared with on the held-out episodes."""


def run(folder: RunFolder, config: TrainConfig, report: Callable[[Row], None]) -> list[Row]:
    """Train, from the folder's last checkpoint where there is one.

    Args:
        folder: where everything is written.
        config: of the run; on going on, only ``timesteps``, ``workers`` and ``threads`` may differ from what
            the run was begun with.
        report: called with every new row, of progress and of the baselines.

    Returns:
        All rows of progress.

    Raises:
        InputError: a configuration that cannot be used, or a damaged checkpoint.
    """
    torch.set_num_threads(config.threads)
    evaluation_env = evaluation_environment(config)
    envs = None
    try:
        folder.begin(config, _layout(config))
        _measure_baselines(folder, config, evaluation_env, report)
        envs = training_environments(config)
        model = new_model(config, envs)
        model.set_logger(configure(str(folder.path / "tensorboard"), ["tensorboard"]))
        checkpoint = folder.load()
        if checkpoint is not None:
            _go_on(model, folder, checkpoint)
        left = config.timesteps - model.num_timesteps
        if left > 0:
            callback = Checkpoints(folder, config, evaluation_env, checkpoint, report)
            model.learn(left, callback, log_interval=1, reset_num_timesteps=False)
    finally:
        evaluation_env.close()
        if envs is not None:
            envs.close()
    return folder.rows()


def _layout(config: TrainConfig) -> ObservationLayout:
    settings = PackConfig.from_mapping(config.env_config)
    return current_layout(settings.grid.cell_size * settings.map_step)


def _measure_baselines(
    folder: RunFolder, config: TrainConfig, env: PackEnv, report: Callable[[Row], None]
) -> None:
    found = folder.baselines()
    for name in BASELINES:
        if name not in found:
            found[name] = evaluate(make(name), name, env, held_out_seeds(config.evaluation_episodes))
            folder.write_baselines(found)
            report(found[name])


def new_model(config: TrainConfig, envs: VecEnv) -> MaskablePPO:
    """MaskablePPO with fresh weights.

    Raises:
        InputError: the environment's configuration is wrong.
    """
    ppo = config.ppo
    return MaskablePPO(
        PlacementPolicy,
        envs,
        learning_rate=lambda remaining: ppo.learning_rate * (0.1 + 0.9 * remaining),
        n_steps=ppo.rollout // config.workers,
        batch_size=ppo.batch_size,
        n_epochs=ppo.n_epochs,
        gamma=ppo.gamma,
        gae_lambda=ppo.gae_lambda,
        clip_range=ppo.clip_range,
        ent_coef=ppo.ent_coef,
        vf_coef=ppo.vf_coef,
        max_grad_norm=ppo.max_grad_norm,
        target_kl=ppo.target_kl,
        policy_kwargs={"layout": _layout(config), "network": config.network},
        seed=config.seed,
        device="cpu",
    )


def _go_on(model: MaskablePPO, folder: RunFolder, checkpoint: Checkpoint) -> None:
    assert isinstance(model.policy, PlacementPolicy)
    folder.restore(checkpoint, model.policy.placement_network())
    model.policy.optimizer.load_state_dict(checkpoint.optimizer)
    model.num_timesteps = checkpoint.timesteps
    model._n_updates = checkpoint.updates
