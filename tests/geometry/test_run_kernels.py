"""What runs of voxels say is what the voxels say, one after another."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from packenv.geometry import run_kernels
from packenv.geometry.run_table import RunTable
from packenv.geometry.voxels import Voxels

BOX = (20, 18, 16)


def drawn(rng: np.random.Generator) -> Voxels:
    """A grid of noise, with many runs in a column, or of a few bars and plates; it may be empty."""
    grid = rng.random(rng.integers(1, 10, 3)) < rng.choice([0.0, 0.1, 0.5, 0.9])
    if rng.random() < 0.5:
        grid = np.maximum.accumulate(grid, axis=int(rng.integers(3)))
    return Voxels(np.ascontiguousarray(grid), np.array(grid.shape, dtype=np.float64), 1.0)


def spread(grid: np.ndarray, at: np.ndarray) -> np.ndarray:
    """A grid as voxels of the box."""
    whole = np.zeros(BOX, dtype=np.int64)
    (x, y, z), (w, d, h) = at.tolist(), grid.shape
    whole[x : x + w, y : y + d, z : z + h] = grid
    return whole


class Scene:
    """A piece, others at places in a box, and their weights."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.table, self.own = RunTable(), drawn(rng)
        voxels = [drawn(rng) for _ in range(rng.integers(1, 7))]
        self.places = np.array([rng.integers(0, np.subtract(BOX, v.grid.shape) + 1) for v in voxels])
        self.wholes = [spread(v.grid, at) for v, at in zip(voxels, self.places, strict=True)]
        self.shape = self.table.of(self.own)
        self.others = np.array([self.table.of(v) for v in voxels])
        self.voxels, self.weights = voxels, rng.integers(1, 200, len(voxels)) / 4
        self.last = np.subtract(BOX, self.own.grid.shape)
        self.at = rng.integers(0, self.last + 1)

    def counts(self, at: np.ndarray) -> np.ndarray:
        """Voxels that the piece shares with each other one."""
        own = spread(self.own.grid, at)
        return np.array([np.sum(own & whole) for whole in self.wholes])

    def cost(self, at: np.ndarray) -> float:
        """Weighted sum of the sides of cubes of as many voxels."""
        return float(np.cbrt(self.counts(at)) @ self.weights)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 10_000))
def test_shared_voxels_are_counted(seed: int) -> None:
    scene = Scene(seed)
    found = np.empty(len(scene.others), dtype=np.int64)
    arrays = scene.table.arrays
    run_kernels.shared_with_each(*arrays, scene.shape, scene.at, scene.others, scene.places, found)
    assert np.array_equal(found, scene.counts(scene.at))
    for axis in range(3):
        costs = np.empty(int(scene.last[axis]) + 1)
        line = [scene.at + (t - scene.at[axis]) * np.eye(3, dtype=int)[axis] for t in range(len(costs))]
        run_kernels.costs_along(
            *arrays, scene.shape, scene.at, scene.others, scene.places, scene.weights, axis, costs
        )
        counted = [scene.counts(at) for at in line]
        assert costs.tolist() == [float(c.sum() + scene.weights[c > 0].sum()) for c in counted]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_what_is_above_and_below_has_no_end(seed: int) -> None:
    scene = Scene(seed)
    up = np.maximum.accumulate(scene.wholes[0], axis=2)
    down = np.maximum.accumulate(scene.wholes[0][:, :, ::-1], axis=2)[:, :, ::-1]
    found = np.empty(4, dtype=np.int64)
    numbers = np.array([scene.table.of(scene.voxels[0], a, b) for b in (False, True) for a in (False, True)])
    places = np.repeat(scene.places[:1], 4, axis=0)
    run_kernels.shared_with_each(*scene.table.arrays, scene.shape, scene.at, numbers, places, found)
    own = spread(scene.own.grid, scene.at)
    assert found.tolist() == [int(np.sum(own & whole)) for whole in (scene.wholes[0], up, down, up | down)]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 4))
def test_a_descent_ends_where_no_neighbour_is_better(seed: int, step: int) -> None:
    scene = Scene(seed)
    start, along = tuple(scene.at.tolist()), np.random.default_rng(seed).choice([-1.0, 1.0], 2).tolist()
    cost, *at = run_kernels.descend(
        *scene.table.arrays,
        scene.shape,
        start,
        scene.last,
        scene.others,
        scene.places,
        scene.weights,
        step,
        *along,
    )
    assert cost == pytest.approx(scene.cost(np.array(at)), abs=1e-9)
    assert cost <= scene.cost(scene.at) + 1e-9

    def worth(place: np.ndarray) -> tuple[float, float]:
        return scene.cost(place), 2 * place[2] + along[0] * place[0] + along[1] * place[1]

    for change in itertools.product((-1, 0, 1), repeat=3):
        place = np.add(at, change)
        if (place >= 0).all() and (place <= scene.last).all():
            assert cost == 0.0 or scene.cost(place) >= cost - 1e-9
            assert worth(place)[0] > cost + 1e-9 or worth(place)[1] >= worth(np.array(at))[1]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_looking_at_every_place_finds_the_least_cost(seed: int) -> None:
    scene = Scene(seed)
    field, found = np.empty(np.add(BOX, 4), dtype=np.int32), np.empty((3, 4))
    weights = (scene.weights * 16).astype(np.int32)
    arrays = scene.table.arrays
    run_kernels.fill_sampled(*arrays, scene.others, scene.places, weights, 1, field)
    total = np.tensordot(scene.weights * 16, scene.wholes, axes=1)
    below = np.concatenate([np.zeros((*BOX[:2], 1)), np.cumsum(total, axis=2)], axis=2)
    assert np.array_equal(field[: BOX[0], : BOX[1], : BOX[2] + 1], below)
    run_kernels.sampled_minima(*arrays, scene.shape, scene.last, 1, field, 1.0, 1.0, found)
    windows = np.lib.stride_tricks.sliding_window_view(total, scene.own.grid.shape)
    costs = np.einsum("xyzijk,ijk->xyz", windows, scene.own.grid.astype(float))
    assert abs(found[0, 0] - costs.min()) < 1e-3
    for cost, *at in found[np.isfinite(found[:, 0])].tolist():
        assert abs(costs[tuple(map(int, at))] - cost) < 1e-3
    assert (np.diff(found[np.isfinite(found[:, 0]), 0]) >= 0).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 5))
def test_looking_at_some_places_finds_places_in_the_box(seed: int, step: int) -> None:
    scene = Scene(seed)
    field, found = np.empty([n // step + 4 for n in BOX], dtype=np.int32), np.empty((3, 4))
    weights = (scene.weights * 16).astype(np.int32)
    run_kernels.fill_sampled(*scene.table.arrays, scene.others, scene.places, weights, step, field)
    run_kernels.sampled_minima(*scene.table.arrays, scene.shape, scene.last, step, field, 1.0, 1.0, found)
    assert np.isfinite(found[0, 0])
    places = found[np.isfinite(found[:, 0]), 1:]
    assert (places >= 0).all()
    assert (places <= scene.last).all()
