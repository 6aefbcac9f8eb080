"""Fast search and scores against the slow reference, bit for bit, on random maps."""

from __future__ import annotations

import numpy as np
import pytest

from packenv.planning.search.candidates import grid_search
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import (
    HEURISTICS,
    PAPER_CONSTANT,
    DeepestBottomLeft,
    heuristic_named,
    name_of,
)
from packenv.types import Container
from tests.planning.search import reference
from tests.planning.search.random_maps import CELL, random_oriented, random_surface

SEEDS = range(40)


def _case(seed: int) -> tuple[ContainerMap, list, int]:
    rng = np.random.default_rng(seed)
    nx, ny = (int(n) for n in rng.integers(6, 34, 2))
    surface = random_surface(rng, nx, ny)
    orientations = [random_oriented(rng, *(int(n) for n in rng.integers(1, 14, 2))) for _ in range(3)]
    return surface, orientations, int(rng.integers(1, 7))


@pytest.mark.parametrize("seed", SEEDS)
def test_search_equals_the_reference(seed: int) -> None:
    surface, orientations, step = _case(seed)
    expected = reference.search(surface, orientations, step)
    found = grid_search(surface, orientations, step)
    numbers = [orientations.index(grid.oriented) for grid in found.grids]
    got = [
        (numbers[k], int(x), int(y), float(z))
        for k, x, y, z in zip(found.grid_index, found.ix, found.iy, found.z, strict=True)
    ]
    assert got == expected


@pytest.mark.parametrize("name", ["hm", "dblf", "minz", "mta"])
@pytest.mark.parametrize("seed", SEEDS)
def test_scores_equal_the_reference(name: str, seed: int) -> None:
    surface, orientations, step = _case(seed)
    found = grid_search(surface, orientations, step)
    scores = HEURISTICS[name](found, np.random.default_rng(0))
    expected = [
        getattr(reference, name)(surface, found.grids[k].oriented, int(x), int(y), float(z))
        for k, x, y, z in zip(found.grid_index, found.ix, found.iy, found.z, strict=True)
    ]
    assert scores.shape == (len(found),)
    if name == "mta":  # a product of exact sums by the cell size: the last bit may differ
        np.testing.assert_allclose(scores, expected, rtol=1e-12, atol=0)
    else:
        assert scores.tolist() == expected


@pytest.mark.parametrize("c", [1.0, 0.01, 0.0])
@pytest.mark.parametrize("name", ["hm", "dblf"])
def test_the_constant_weighs_x_and_y(name: str, c: float) -> None:
    """Of equal X + Y the constant changes no rank; the score is affine in it."""
    found = grid_search(*_case(3))
    rng = np.random.default_rng(0)
    none, some, one = (heuristic_named(name, k)(found, rng) for k in (0.0, c, 1.0))
    np.testing.assert_allclose(some, none + c * (one - none), atol=1e-12)
    np.testing.assert_allclose(one - none, found.xy_sum, atol=1e-9)


def test_deepest_comes_before_bottom_left() -> None:
    """A candidate that is 1 cm lower beats one that is nearer the corner by the container's whole side."""
    found = grid_search(*_case(3))
    low = np.argmin(HEURISTICS["dblf"](found, np.random.default_rng(0)))
    assert found.z[low] <= found.z.min() + 0.01 * float(np.ptp(found.xy_sum))


def test_names_and_heuristics_belong_together() -> None:
    for name, heuristic in HEURISTICS.items():
        assert name_of(heuristic) == name
        assert heuristic_named(name) == heuristic
        assert name_of(heuristic_named(name, 0.5)) == name
    assert name_of(lambda candidates, rng: candidates.z) == "own"
    assert heuristic_named("dblf", PAPER_CONSTANT) == DeepestBottomLeft(1.0)


def test_some_cases_have_candidates_and_some_have_none() -> None:
    counts = [len(grid_search(*_case(seed))) for seed in SEEDS]
    assert min(counts) == 0 or any(c < 5 for c in counts)
    assert sum(c > 50 for c in counts) > 10


@pytest.mark.parametrize("seed", range(4))
def test_sums_stay_exact_in_a_two_metre_container(seed: int) -> None:
    """The worst case of the float32 partial sums: the tallest container and item, bare walls beside it."""
    rng = np.random.default_rng(seed)
    surface = random_surface(rng, 30, 30, height=0.2)
    surface = ContainerMap(Container(0.0601, 0.0601, 2.0), CELL, surface.heights)
    tall = random_oriented(rng, 24, 24, height=1.8)
    found = grid_search(surface, [tall], 1)
    assert len(found) == 49
    for name in ("hm", "mta"):
        scores = HEURISTICS[name](found, rng)
        expected = [
            getattr(reference, name)(surface, tall, int(x), int(y), float(z))
            for x, y, z in zip(found.ix, found.iy, found.z, strict=True)
        ]
        np.testing.assert_allclose(scores, expected, rtol=1e-12, atol=0)


@pytest.mark.parametrize("seed", range(10))
def test_taller_surroundings_never_lower_an_item(seed: int) -> None:
    surface, orientations, step = _case(seed)
    rng = np.random.default_rng(seed)
    raised = surface.heights + rng.integers(0, 2000, surface.heights.shape).astype(np.float32) / 2**20
    higher = ContainerMap(surface.container, CELL, raised.astype(np.float32))
    before = grid_search(surface, orientations, step)
    after = grid_search(higher, orientations, step)
    at = {
        (id(before.grids[k].oriented), int(x), int(y)): float(z)
        for k, x, y, z in zip(before.grid_index, before.ix, before.iy, before.z, strict=True)
    }
    for k, x, y, z in zip(after.grid_index, after.ix, after.iy, after.z, strict=True):
        assert float(z) >= at[(id(after.grids[k].oriented), int(x), int(y))]


def test_first_fit_and_random_rank_every_candidate() -> None:
    surface, orientations, step = _case(1)
    found = grid_search(surface, orientations, step)
    first = HEURISTICS["first-fit"](found, np.random.default_rng(0))
    assert first.tolist() == list(range(len(found)))
    a = HEURISTICS["random"](found, np.random.default_rng(3))
    b = HEURISTICS["random"](found, np.random.default_rng(3))
    assert a.tolist() == b.tolist()
    assert len(set(a.tolist())) == len(found) > 1


def test_random_prefers_no_candidate() -> None:
    surface, orientations, step = _case(1)
    found = grid_search(surface, orientations, step)
    rng = np.random.default_rng(0)
    best = [int(np.argmin(HEURISTICS["random"](found, rng))) for _ in range(2000)]
    third = len(found) / 3
    shares = np.histogram(best, bins=[0, third, 2 * third, len(found)])[0] / len(best)
    np.testing.assert_allclose(shares, 1 / 3, atol=0.05)


def test_an_item_as_large_as_the_container_has_one_candidate() -> None:
    rng = np.random.default_rng(0)
    surface = ContainerMap.empty(Container(0.04, 0.03, 0.05), CELL)
    item = random_oriented(rng, 20, 15)
    found = grid_search(surface, [item], 5)
    assert [(int(x), int(y), float(z)) for x, y, z in zip(found.ix, found.iy, found.z, strict=True)] == [
        (0, 0, 0.0)
    ]
    assert len(grid_search(surface, [random_oriented(rng, 21, 15)], 5)) == 0
