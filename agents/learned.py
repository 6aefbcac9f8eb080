"""The learned agent: a placement policy that ``python -m packenv.train`` has trained."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np

from packenv.errors import InputError
from packenv.types import IntArray

from .protocol import Observation

_INSTALL = "pip install 'robotpack[train]'"


class LearnedAgent:
    """Takes the action that a trained policy likes best among the valid ones.

    The policy runs on plain torch, which is imported when the agent is made; Stable-Baselines3 is needed for
    its own ``.zip`` files alone.
    """

    def __init__(self, weights: Path | str, trust: bool = False) -> None:
        """Read the policy.

        Args:
            weights: a folder with ``policy.safetensors`` and ``config.json``, as
                ``python -m packenv.train`` writes it, or a ``.zip`` that Stable-Baselines3's
                MaskablePPO saved.
            trust: allow such a ``.zip``, which can run any code while it is read.

        Raises:
            InputError: the files are missing, damaged or of another version; the zip is not trusted; or a
                package that reading takes is not installed.
        """
        weights = Path(weights)
        if weights.is_dir():
            self._policy: _Policy = _NetworkPolicy(weights)
        elif not weights.exists():
            raise InputError(f"{weights}: does not exist, give a folder that python -m packenv.train wrote")
        elif not trust:
            raise InputError(
                f"{weights}: is not a folder that python -m packenv.train wrote; a Stable-Baselines3 zip "
                "can run any code while it is read, so it is read with --trust alone"
            )
        else:
            self._policy = _ZipPolicy(weights)

    def act(self, obs: Observation, info: Mapping[str, object]) -> int:
        """The action for one observation.

        Args:
            obs: an observation of RobotPack-v0.
            info: is not looked at; the mask is part of the observation.
        """
        batch = {name: np.asarray(value)[None] for name, value in obs.items()}
        return int(self._policy.actions(batch)[0])

    def act_batch(self, obs: Observation, infos: Mapping[str, object]) -> IntArray:
        """The actions (n,) for n observations, stacked along the first axis of each array."""
        return self._policy.actions(obs)

    def reset(self, seed: int | None = None) -> None:
        """Begin an episode; the policy keeps nothing between steps and draws nothing."""


class _Policy(Protocol):
    def actions(self, obs: Observation) -> IntArray:
        """The best valid action (n,) for each of n observations."""
        ...


class _NetworkPolicy:
    """The project's own format."""

    def __init__(self, folder: Path) -> None:
        try:
            from .placement_network import best_actions
            from .policy_files import read_policy
        except ModuleNotFoundError as problem:
            raise _missing(problem, "a learned policy") from None
        self._network, self._best_actions = read_policy(folder), best_actions

    def actions(self, obs: Observation) -> IntArray:
        return self._best_actions(self._network, obs)


class _ZipPolicy:
    """Stable-Baselines3's format."""

    def __init__(self, path: Path) -> None:
        try:
            from sb3_contrib import MaskablePPO
        except ModuleNotFoundError as problem:
            raise _missing(problem, "a Stable-Baselines3 zip") from None
        try:
            self._model = MaskablePPO.load(path, device="cpu")
        except Exception as problem:
            # Reading a pickle runs its code, so any exception can come out of it.
            raise InputError(
                f"{path}: MaskablePPO cannot read it ({type(problem).__name__}: {problem})"
            ) from None

        self._path = path

    def actions(self, obs: Observation) -> IntArray:
        for name, seen in obs.items():
            trained = self._model.observation_space[name].shape  # type: ignore[index]
            if trained != seen.shape[1:]:
                raise InputError(
                    f"{self._path}: was trained on observations whose {name!r} is {trained}, here it is "
                    f"{seen.shape[1:]}; train it again, or give the environment that it was trained in"
                )
        actions, _ = self._model.predict(dict(obs), action_masks=obs["action_mask"], deterministic=True)
        return np.asarray(actions, dtype=np.int64)


def _missing(problem: ModuleNotFoundError, what: str) -> InputError:
    return InputError(f"{what} needs the package {problem.name}: {_INSTALL}")
