"""The support margin against a plain convex hull of SciPy's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from packenv.env.support import support_margin

CELL = 0.002


def margin(supported: np.ndarray, x: float, y: float) -> float:
    """Of a flat item over a floor that is there only under some of its cells."""
    heights = np.where(supported, 0.0, -1.0).astype(np.float32)
    bottom = np.zeros(supported.shape, dtype=np.float32)
    return float(support_margin(heights, bottom, 0, 0, 0.0, 0.001, CELL, x, y))


def by_hull(supported: np.ndarray, x: float, y: float) -> float:
    """Distance to the hull of all corners of supported cells."""
    i, j = np.nonzero(supported)
    corners = np.concatenate([np.column_stack([i + a, j + b]) for a in (0, 1) for b in (0, 1)]) * CELL
    hull = ConvexHull(corners)
    inside = -(hull.equations @ [x, y, 1.0]).max()
    if inside >= 0.0:
        return float(inside)
    ring = corners[hull.vertices]
    best = math.inf
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        t = np.clip((np.array([x, y]) - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = min(best, float(np.linalg.norm(a + t * (b - a) - [x, y])))
    return -best


def test_it_is_the_distance_to_the_hull() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        shape = tuple(rng.integers(1, 20, 2))
        supported = rng.random(shape) < rng.choice([0.05, 0.3, 1.0])
        if not supported.any():
            continue
        x, y = rng.uniform(-0.01, 0.05, 2)
        assert margin(supported, x, y) == pytest.approx(by_hull(supported, x, y), abs=1e-12)


def test_more_support_never_lessens_it() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        few = rng.random((9, 13)) < 0.1
        more = few | (rng.random((9, 13)) < 0.1)
        x, y = rng.uniform(-0.01, 0.04, 2)
        assert margin(more, x, y) >= margin(few, x, y) - 1e-15


def test_nothing_below_is_no_support() -> None:
    assert margin(np.zeros((3, 4), dtype=bool), 0.0, 0.0) == -math.inf
