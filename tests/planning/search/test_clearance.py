"""Clearance: what an item that hangs a little off in the cup still clears on its way to the release."""

from __future__ import annotations

import numpy as np
import pytest

from packenv.planning.search.candidates import grid_search
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.kernels import lowest_at as lowest_z
from tests.planning.search.random_maps import CELL, random_oriented, random_surface

PLAY = 0.01


def brute_spread(surface: ContainerMap, cells: int) -> np.ndarray:
    nx, ny = surface.heights.shape
    spread = np.empty((nx, ny), dtype=np.float32)
    for i in range(nx):
        for j in range(ny):
            inside = cells <= i < nx - cells and cells <= j < ny - cells
            window = surface.heights[max(i - cells, 0) : i + cells + 1, max(j - cells, 0) : j + cells + 1]
            spread[i, j] = window.max() if inside else max(window.max(), surface.container.height)
    return spread


@pytest.mark.parametrize("cells", [1, 2, 5])
def test_a_spread_map_is_the_maximum_over_the_square_around_each_cell(cells: int) -> None:
    surface = random_surface(np.random.default_rng(cells), 23, 31)
    assert np.array_equal(surface.spread(cells).heights, brute_spread(surface, cells))


def test_spreading_by_nothing_changes_nothing() -> None:
    surface = random_surface(np.random.default_rng(1), 20, 20)
    assert np.array_equal(surface.spread(0).heights, surface.heights)


@pytest.mark.parametrize("seed", range(12))
def test_a_candidate_with_clearance_clears_everything_wherever_it_is_off(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface = random_surface(rng, 40, 46)
    oriented = random_oriented(rng, int(rng.integers(2, 14)), int(rng.integers(2, 14)))
    cells, (w, h), (nx, ny) = int(rng.integers(1, 4)), oriented.top.shape, surface.heights.shape
    found = grid_search(surface, [oriented], 5, cells, PLAY)
    for ix, iy, z in zip(found.ix, found.iy, found.z, strict=True):
        for dx in range(-cells, cells + 1):
            for dy in range(-cells, cells + 1):
                x, y = int(ix) + dx, int(iy) + dy
                assert 0 <= x <= nx - w
                assert 0 <= y <= ny - h
                assert lowest_z(surface.heights, oriented.bottom, x, y) <= float(z) + PLAY + 1e-6


@pytest.mark.parametrize("seed", range(8))
def test_clearance_only_takes_candidates_away(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface, oriented = random_surface(rng, 40, 40), random_oriented(rng, 9, 7)

    def places(cells: int) -> set[tuple[int, int, float]]:
        found = grid_search(surface, [oriented], 5, cells, PLAY)
        return {(int(x), int(y), float(z)) for x, y, z in zip(found.ix, found.iy, found.z, strict=True)}

    assert places(3) <= places(2) <= places(1) <= places(0)


def test_on_an_empty_floor_clearance_is_the_distance_from_the_walls() -> None:
    surface = ContainerMap.empty(random_surface(np.random.default_rng(0), 50, 50).container, CELL)
    oriented = random_oriented(np.random.default_rng(3), 10, 10)
    found = grid_search(surface, [oriented], 5, 5, 0.0)
    assert (found.ix.min(), found.ix.max()) == (5, 35)
    assert (found.iy.min(), found.iy.max()) == (5, 35)
