"""Cutting the edge of a hole into triangles: area, winding and inside are kept."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from packenv.geometry.holes import MAX_CORNERS, least_area_cut


def star(n: int, seed: int) -> np.ndarray:
    """A simple polygon with dents, (n, 2)."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, n)) * 0.3 + np.linspace(0, 2 * np.pi, n, endpoint=False) * 0.7
    radius = rng.uniform(0.2, 1.0, n)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def shoelace(points: np.ndarray) -> float:
    x, y = points.T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)


@given(n=st.integers(4, 20), seed=st.integers(0, 2**31), first=st.integers(0, 19))
def test_a_flat_polygon_is_covered_once_whatever_its_dents(n, seed, first):
    flat = np.roll(star(n, seed), first, axis=0)
    faces = least_area_cut(np.column_stack([flat, np.zeros(n)]))
    assert len(faces) == n - 2
    a, b, c = (flat[faces[:, k]] for k in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert (areas > -1e-12).all()
    assert areas.sum() == pytest.approx(shoelace(flat))


def test_a_bent_ring_is_folded_the_way_of_less_area():
    points = np.array([[0, 0, 0.3], [1, 0, 0], [1, 0.5, 0.3], [0, 0.5, 0]])

    def area(faces):
        a, b, c = (points[np.array(faces)[:, k]] for k in range(3))
        return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2

    folds = ([[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]])
    for turn in range(4):
        corners = np.roll(np.arange(4), turn)
        assert area(corners[least_area_cut(points[corners])]) == pytest.approx(min(map(area, folds)))


def test_too_many_corners_are_refused():
    with pytest.raises(ValueError, match="corners"):
        least_area_cut(np.column_stack([star(MAX_CORNERS + 1, 1), np.zeros(MAX_CORNERS + 1)]))
