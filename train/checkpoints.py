"""Between rollouts: evaluate, write a checkpoint, begin the environments anew."""

from __future__ import annotations

import time
from collections.abc import Callable
from copy import deepcopy

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from packenv.env.pack_env import PackEnv
from packenv.io.rows import row_key

from .config import TrainConfig
from .curve import curve_svg
from .environments import held_out_seeds, training_seed
from .evaluation import NetworkAgent, evaluate
from .policy import PlacementPolicy
from .runs import Checkpoint, RandomStates, Row, RunFolder


class Checkpoints(BaseCallback):
    """Writes a checkpoint before the first step, then every ``checkpoint_every`` steps, and at the end.

    Checkpoints lie between an update and the next rollout, where nothing is half done but the episodes; the
    environments begin new ones there.
    """

    def __init__(
        self,
        folder: RunFolder,
        config: TrainConfig,
        evaluation_env: PackEnv,
        resumed: Checkpoint | None,
        report: Callable[[Row], None],
    ) -> None:
        """Prepare.

        Args:
            folder: of the run.
            config: likewise.
            evaluation_env: for the held-out episodes.
            resumed: the checkpoint that the model goes on from, already loaded into it.
            report: called with every new row of progress.
        """
        super().__init__()
        self._folder, self._config, self._env = folder, config, evaluation_env
        self._resumed, self._report = resumed, report
        self._last = None if resumed is None else resumed.timesteps
        self._started = time.monotonic() - (0.0 if resumed is None else resumed.wall_s)

    def _on_rollout_start(self) -> None:
        if self._resumed is not None:
            self._resumed.random.restore()
            self._resumed = None
            self._begin_environments()
        elif self._due():
            self._checkpoint()
            self._begin_environments()

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        if self._last != self.num_timesteps:
            self._checkpoint()
            self.logger.dump(self.num_timesteps)

    def _due(self) -> bool:
        every = self._config.checkpoint_every
        return self._last is None or self.num_timesteps // every > self._last // every

    def _begin_environments(self) -> None:
        envs = self.training_env
        assert isinstance(envs, VecEnv)
        envs.seed(training_seed(self._config.seed, self.num_timesteps))
        self.model._last_obs = envs.reset()
        self.model._last_episode_starts = np.ones(envs.num_envs, dtype=bool)
        if self.model.ep_info_buffer is not None:
            self.model.ep_info_buffer.clear()

    def _checkpoint(self) -> None:
        assert isinstance(self.model.policy, PlacementPolicy)
        network = self.model.policy.placement_network()
        seeds = held_out_seeds(self._config.evaluation_episodes)
        found = evaluate(NetworkAgent(network), "learned", self._env, seeds)
        finished = [episode["r"] for episode in self.model.ep_info_buffer or ()]
        wall_s = time.monotonic() - self._started
        row: Row = {
            "key": row_key("progress", self.num_timesteps),
            "timesteps": self.num_timesteps,
            **found,
            "training_return": float(np.mean(finished)) if finished else None,
            "wall_s": round(wall_s, 1),
        }
        checkpoint = Checkpoint(
            timesteps=self.num_timesteps,
            updates=self.model._n_updates,
            wall_s=wall_s,
            network=network.state_dict(),
            optimizer=deepcopy(self.model.policy.optimizer.state_dict()),
            random=RandomStates.of_now(),
            row=row,
        )
        self._folder.save(checkpoint, network)
        self._folder.write_curve(curve_svg(self._folder.rows(), self._folder.baselines()))
        self._last = self.num_timesteps
        for name in ("return", "packed_share", "complete", "utilization"):
            self.logger.record(f"held_out/{name}", row[name])
        self._report(row)
