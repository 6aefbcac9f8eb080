"""Observations made by hand, as the environment would give them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packenv.env.observation import FEATURES, HEURISTIC_COLUMNS

Observation = Mapping[str, NDArray[Any]]


def random_observation(rng: np.random.Generator, k: int = 12) -> dict[str, NDArray[Any]]:
    """Some candidates present, the rest padded with zeros; some valid; at least one valid action."""
    present = int(rng.integers(0, k + 1))
    rows = np.zeros((k, len(FEATURES)), dtype=np.float32)
    rows[:present, FEATURES.index("present")] = 1.0
    for name in HEURISTIC_COLUMNS:
        # All legal candidates are many more than those shown, and no two share a rank.
        rows[:present, FEATURES.index(f"rank_{name}")] = rng.choice(300, size=present, replace=False)
    mask = np.zeros(k + 1, dtype=np.int8)
    mask[:present] = rng.random(present) < rng.random()
    mask[k] = rng.random() < 0.7 or not mask.any()
    return {"candidates": rows, "action_mask": mask}


def rank(obs: Observation, heuristic: str) -> NDArray[np.float32]:
    """(K,) the column of a heuristic's ranks."""
    return obs["candidates"][:, FEATURES.index(f"rank_{heuristic}")]


def stacked(observations: list[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """As a vector environment gives them."""
    return {name: np.stack([obs[name] for obs in observations]) for name in observations[0]}
