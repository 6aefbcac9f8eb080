"""An arrangement knows how much each pair overlaps, and what is in its box is in the container."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from packenv.planning.layouts.layout import Arrangement, pitch_for
from packenv.types import Container
from tests.planning.layouts.arrangements import BOX, arrangement_of, scattered


def grids(arrangement: Arrangement) -> list[np.ndarray]:
    """Each piece as voxels of the whole box."""
    found = []
    for piece in range(len(arrangement.pieces)):
        whole = np.zeros(arrangement.shape, dtype=np.bool_)
        own, (x, y, z) = arrangement.voxels(piece).grid, arrangement.at[piece].tolist()
        w, d, h = own.shape
        whole[x : x + w, y : y + d, z : z + h] = own
        found.append(whole)
    return found


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_overlaps_are_those_of_the_voxels(seed: int) -> None:
    found = scattered(seed)
    wholes = grids(found)
    for i, one in enumerate(wholes):
        for j, other in enumerate(wholes):
            assert found.overlaps[i, j] == (0 if i == j else np.count_nonzero(one & other))
    total = sum(w.astype(int) for w in wholes)
    assert found.overlap == (total * (total - 1) // 2).sum()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_a_place_in_the_voxel_box_is_in_the_container(seed: int) -> None:
    found = scattered(seed)
    for piece in range(len(found.pieces)):
        for kind, oriented in enumerate(found.pieces[piece].orientations):
            last = np.array(found.places(piece, kind)) - 1
            assert (last * found.pitch + oriented.extents <= np.add(BOX.size, 2e-5)).all()
            assert (last + found.voxels(piece, kind).grid.shape <= found.shape).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_what_is_restored_is_as_before(seed: int) -> None:
    found = scattered(seed)
    kept, overlaps = found.layout, found.overlaps.copy()
    found.exchange(0, len(found.pieces) - 1)
    found.restore(kept)
    assert np.array_equal(found.overlaps, overlaps)
    assert found.overlap == kept.overlap


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_what_must_be_below_overlaps_what_it_is_above(seed: int) -> None:
    found = scattered(seed)
    wholes = grids(found)
    pairs = np.zeros_like(found.below)
    pairs[0, 1] = True
    found.keep_below(pairs)
    lid = np.maximum.accumulate(wholes[1], axis=2)
    assert found.overlaps[0, 1] == found.overlaps[1, 0] == np.count_nonzero(wholes[0] & lid)
    found.move(1, int(found.kinds[1]), found.at[1])  # the other one of the pair counts what is below it
    under = np.maximum.accumulate(wholes[0][:, :, ::-1], axis=2)[:, :, ::-1]
    assert found.overlaps[0, 1] == np.count_nonzero(wholes[1] & under)


def test_a_piece_as_large_as_the_box_has_one_place() -> None:
    found = arrangement_of(["brick"], Container(0.05 - 1e-5, 0.04, 0.03 - 1e-5))
    fitting = [k for k in range(len(found.pieces[0].orientations)) if min(found.places(0, k)) > 0]
    assert fitting
    assert found.places(0, fitting[0]) == (1, 1, 1)
    found.move(0, fitting[0], [0, 0, 0])
    assert found.voxels(0).grid.shape == found.shape


@pytest.mark.parametrize(
    ("size", "pitch"), [((0.32, 0.32, 0.30), 0.004), ((0.64, 0.64, 0.60), 0.008), ((0.02,) * 3, 0.0005)]
)
def test_the_pitch_follows_the_box(size: tuple[float, float, float], pitch: float) -> None:
    assert pitch_for(Container(*size)) == pytest.approx(pitch)
