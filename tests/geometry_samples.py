"""Random rotations, and points on an item's surface."""

from __future__ import annotations

import numpy as np

from packenv.types import Item


def random_rotation(seed: int) -> np.ndarray:
    """(3, 3) rotation, the same for the same seed."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def surface_samples(item: Item, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) points on the surface, mesh frame, m."""
    corners = item.vertices[item.faces[rng.integers(0, len(item.faces), count)]]
    u, v = rng.random((2, count, 1))
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    return corners[:, 0] + u * (corners[:, 1] - corners[:, 0]) + v * (corners[:, 2] - corners[:, 0])
