"""Random joint angles and paths."""

import numpy as np

from packenv.robot.tx90_data import LOWER, UPPER


def random_joints(count: int, seed: int, margin: float = 0.0) -> np.ndarray:
    """(count, 6) within the limits, ``margin`` rad away from them."""
    return np.random.default_rng(seed).uniform(LOWER + margin, UPPER - margin, (count, 6))


def turn_free(difference: np.ndarray) -> np.ndarray:
    """Angles reduced to [-π, π]."""
    return (difference + np.pi) % (2 * np.pi) - np.pi


def rotation_angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(...) angle between rotations (..., 3, 3), accurate near 0."""
    return 2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=(-2, -1)) / np.sqrt(8), 0, 1))
