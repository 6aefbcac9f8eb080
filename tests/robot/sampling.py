"""The robots, and random joint angles of theirs."""

import numpy as np

from packenv.robot.files import load_robot
from packenv.robot.protocol import Robot

TX90, KR10 = load_robot("tx90"), load_robot("kr10_r1100")
ROBOTS = [TX90, KR10]
LOWER, UPPER = TX90.lower, TX90.upper


def random_joints(count: int, seed: int, margin: float = 0.0, robot: Robot = TX90) -> np.ndarray:
    """(count, 6) within the limits, ``margin`` rad away from them."""
    lower, upper = robot.lower + margin, robot.upper - margin
    return np.random.default_rng(seed).uniform(lower, upper, (count, 6))


def turn_free(difference: np.ndarray) -> np.ndarray:
    """Angles reduced to [-π, π]."""
    return (difference + np.pi) % (2 * np.pi) - np.pi


def rotation_angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(...) angle between rotations (..., 3, 3), accurate near 0."""
    return 2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=(-2, -1)) / np.sqrt(8), 0, 1))
