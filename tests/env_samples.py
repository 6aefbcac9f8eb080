"""Small environments that are quick to run: coarse cells, few orientations, light items."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from packenv.env.observation import FEATURES
from packenv.env.orders import GeneratedOrder
from packenv.env.pack_env import PackEnv
from packenv.env.reward import Outcome

ITEMS = ("gelatin_box", "soap_bar", "golf_ball", "tuna_can", "toy_brick_2x4", "foam_brick")
"""Of the built-in catalogue."""

COARSE: dict[str, Any] = {"cell_size": 0.004, "grid_step": 0.02, "n_poses": 2, "n_yaws": 2}

CONFIG: dict[str, Any] = {
    "containers": [[0.16, 0.12, 0.10]],
    "grid": COARSE,
    "candidates": 12,
    "max_items": 8,
    "max_checked": 10,
}

ORDER: dict[str, Any] = {"kind": "list", "items": list(ITEMS)}


def make_env(**changes: Any) -> PackEnv:
    """A small environment; ``order_generator``, ``reward_fn`` and ``render_mode`` are its own arguments."""
    own = {k: changes.pop(k) for k in ("order_generator", "reward_fn", "render_mode") if k in changes}
    return PackEnv({**CONFIG, **changes}, **{"order_generator": ORDER, **own})


class Drawn:
    """Orders of three of :data:`ITEMS`."""

    def generate(self, rng: np.random.Generator) -> GeneratedOrder:
        return GeneratedOrder(tuple(str(name) for name in rng.choice(ITEMS, 3)))


def volume_alone(outcome: Outcome) -> float:
    """A reward of one's own, as a plain number."""
    return outcome.placed_volume


def random_action(mask: np.ndarray, rng: np.random.Generator) -> int:
    """One of the valid actions; mostly a placement."""
    valid = np.flatnonzero(mask)
    return int(rng.choice(valid))


def best_action(
    obs: dict[str, np.ndarray],
    heuristic: str = "hm",
    below: float = np.inf,
    features: Sequence[str] = FEATURES,
) -> int:
    """What the planner does: the valid candidate of the smallest rank if among the first, else defer."""
    mask = obs["action_mask"]
    ranks = np.where(mask[:-1] == 1, obs["candidates"][:, features.index(f"rank_{heuristic}")], np.inf)
    return int(ranks.argmin()) if ranks.min() < below else len(ranks)


def run_episode(env: PackEnv, rng: np.random.Generator, **reset: Any) -> Iterator[tuple[Any, ...]]:
    """Every step of an episode of random valid actions: action, and what ``step`` returned."""
    obs, _ = env.reset(**reset)
    ended = False
    while not ended:
        action = random_action(obs["action_mask"], rng)
        obs, reward, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
        yield action, obs, reward, terminated, truncated, info
