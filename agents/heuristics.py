"""Agents that need nothing but the observation: the positioning heuristics, and chance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from packenv.env.observation import FEATURES
from packenv.types import IntArray

from .protocol import Observation


def first_in_rank(ranks: NDArray[np.floating[Any]], mask: NDArray[Any], *, below: float = np.inf) -> IntArray:
    """The valid candidate of the smallest rank, or *defer*.

    Args:
        ranks: (..., K) place of every candidate among all legal ones, 0 the best.
        mask: (..., K + 1) nonzero where an action is valid, the last one *defer*.
        below: candidates of this rank and beyond are taken only where deferring is not valid.

    Returns:
        (...) action. K (*defer*) also where no action at all is valid: a vector environment asks for one
        after the end of an episode, too, and ignores it.
    """
    open_ranks = np.where(mask[..., :-1] != 0, ranks, np.inf)
    best = open_ranks.argmin(axis=-1)
    lowest = open_ranks.min(axis=-1)
    placed = (lowest < below) | (np.isfinite(lowest) & (mask[..., -1] == 0))
    actions: IntArray = np.where(placed, best, ranks.shape[-1]).astype(np.int64)
    return actions


class RankAgent:
    """Places at the valid candidate that one heuristic ranks first; defers where none is valid."""

    def __init__(self, heuristic: str, *, below: float = np.inf) -> None:
        """Follow a heuristic.

        Args:
            heuristic: one of :data:`packenv.env.observation.HEURISTIC_COLUMNS`.
            below: as in :func:`first_in_rank`.
        """
        self._column = FEATURES.index(f"rank_{heuristic}")
        self._below = below

    def act(self, obs: Observation, info: Mapping[str, object]) -> int:
        """One action for one observation."""
        return int(self.act_batch(obs, info))

    def act_batch(self, obs: Observation, infos: Mapping[str, object]) -> IntArray:
        """(n,) actions for n observations."""
        ranks = obs["candidates"][..., self._column]
        return first_in_rank(ranks, obs["action_mask"], below=self._below)

    def reset(self, seed: int | None = None) -> None:
        """Nothing is kept and nothing is drawn."""


class _Named(RankAgent):
    """A heuristic that the paper compares, as an agent without options."""

    heuristic: ClassVar[str]

    def __init__(self) -> None:
        super().__init__(self.heuristic)


class HM(_Named):
    """Heightmap minimization (paper eq. 11): the smallest heightmap sum after the placement."""

    heuristic = "hm"


class DBLF(_Named):
    """Deepest bottom left first (paper eq. 8): the smallest Z + X + Y."""

    heuristic = "dblf"


class MTA(_Named):
    """Maximum touching area (Wang et al. 2010): the largest area that touches items, walls and floor."""

    heuristic = "mta"


class MinZ(_Named):
    """The rule of HAPE3D (Liu et al. 2015): the lowest centre of mass."""

    heuristic = "minz"


class FirstFit(_Named):
    """The first candidate in the order of Alg. 2: orientation, then x, then y."""

    heuristic = "first-fit"


class Random:
    """Every valid candidate is equally likely; defers where none is valid."""

    def __init__(self) -> None:
        """Draw from fresh entropy until :meth:`reset` is given a seed."""
        self._rng = np.random.default_rng()

    def act(self, obs: Observation, info: Mapping[str, object]) -> int:
        """One action for one observation."""
        mask = obs["action_mask"]
        valid = np.flatnonzero(mask[:-1])
        return int(self._rng.choice(valid)) if len(valid) else len(mask) - 1

    def act_batch(self, obs: Observation, infos: Mapping[str, object]) -> IntArray:
        """(n,) actions for n observations."""
        rows = [self.act({"action_mask": mask}, {}) for mask in obs["action_mask"]]
        return np.array(rows, dtype=np.int64)

    def reset(self, seed: int | None = None) -> None:
        """Draw from the seed's numbers; they differ from those that an environment of the same seed draws."""
        self._rng = np.random.default_rng(None if seed is None else [seed, 1])
