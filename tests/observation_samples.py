"""Observations of RobotPack-v0 made by hand: inside its bounds, with no environment behind them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from packenv.env.observation import FEATURES, HEURISTIC_COLUMNS, ITEM_FEATURES, STATE_FEATURES

PIXEL = 0.01


def observations(
    batch: int, *, candidates: int = 12, side: int = 20, items: int = 6, poses: int = 4, seed: int = 0
) -> dict[str, NDArray[Any]]:
    """A batch of random observations, stacked; about a third of the candidate rows are padding."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((batch, candidates, len(FEATURES)), dtype=np.float32)
    present = rng.random((batch, candidates)) < 0.7
    column = {name: i for i, name in enumerate(FEATURES)}
    ranges = {
        **dict.fromkeys(("x", "y", "z"), (0.0, 0.1)),
        **dict.fromkeys(("length", "width", "height", "com_height"), (0.02, 0.1)),
        "yaw": (0.0, 3.0),
        "probability": (0.0, 1.0),
        "support_margin": (-0.02, 0.03),
        **{f"score_{name}": (0.0, 1.0) for name in HEURISTIC_COLUMNS},
    }
    for name, (lowest, highest) in ranges.items():
        rows[..., column[name]] = rng.uniform(lowest, highest, (batch, candidates))
    rows[..., column["pose"]] = rng.integers(0, poses, (batch, candidates))
    for name in HEURISTIC_COLUMNS:
        rows[..., column[f"rank_{name}"]] = rng.permuted(np.tile(np.arange(candidates), (batch, 1)), axis=1)
    rows[..., column["present"]] = 1
    rows *= present[..., None]

    pieces = rng.uniform(0, 0.1, (batch, items, len(ITEM_FEATURES))).astype(np.float32)
    pieces[..., 0] = np.arange(items) < rng.integers(1, items + 1, (batch, 1))
    pieces *= pieces[..., :1]
    state = np.tile(np.array([0.2, 0.18, 0.15, 0.2, 0.3, 0.7, 0], dtype=np.float32), (batch, 1))
    assert state.shape[1] == len(STATE_FEATURES)
    maps = rng.uniform(0, 0.1, (batch, poses, 3, side, side)).astype(np.float32)
    maps[:, :, 2] = rng.random((batch, poses, side, side)) < 0.5
    maps[:, -1] = 0
    mask = np.ones((batch, candidates + 1), dtype=np.int8)
    mask[:, :-1] = present & (rng.random((batch, candidates)) < 0.8)
    return {
        "container": rng.uniform(0, 0.15, (batch, side, side)).astype(np.float32),
        "item": maps,
        "candidates": rows,
        "remaining": pieces,
        "state": state,
        "action_mask": mask,
    }
