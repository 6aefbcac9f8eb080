"""The map of overlaps at every place says what counting voxels one place after another says."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings, strategies as st

from packenv.planning.layouts.overlap_map import OverlapMap


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_map_equals_counting(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 15, 3)
    field = rng.integers(0, 4, shape).astype(np.float32)
    grid = rng.random([rng.integers(1, n + 1) for n in shape]) < 0.6
    places = tuple(int(n) for n in shape - grid.shape + 1)
    found = OverlapMap(field).at(grid, places)
    assert found.shape == places
    windows = np.lib.stride_tricks.sliding_window_view(field, grid.shape)
    counted = np.einsum("xyzijk,ijk->xyz", windows, grid.astype(np.float32))
    assert np.array_equal(np.rint(found), counted)
    assert np.abs(found - counted).max() < 0.01
