"""A loading sequence is one in which the exact audit finds no item in the way of another one."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given, settings, strategies as st

from packenv.planning.layouts.effort import Effort
from packenv.planning.layouts.layout import Arrangement
from packenv.planning.layouts.loading import (
    blocking,
    free_of_overlap,
    loadable,
    loading_sequence,
    to_untangle,
)
from packenv.planning.layouts.separation import Separation
from packenv.types import Placement, Plan
from packenv.verification.exact_meshes import audit_plan
from tests.planning.layouts.arrangements import BOX, arrangement_of, drawn, scattered, shelf


def separated(seed: int) -> Arrangement:
    found = arrangement_of(drawn(seed, 5, 12))
    Separation().run(found, np.random.default_rng(seed), Effort(moves=60))
    return found


def placement(arrangement: Arrangement, piece: int) -> Placement:
    movable = arrangement.pieces[piece]
    oriented = movable.orientations[arrangement.kinds[piece]]
    corner = arrangement.at[piece] * arrangement.pitch
    return Placement(
        movable.item.name,
        1,
        oriented.rotation,
        oriented.offset + corner,
        corner,
        oriented.extents,
        0,
        0.0,
        0.0,
        0,
    )


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_a_sequence_is_free_of_collision_on_the_way_down(seed: int) -> None:
    found = separated(seed)
    stays = free_of_overlap(found)
    assert not found.overlaps[:-1, :-1][np.ix_(stays, stays)].any()
    sequence = loading_sequence(found, stays)
    assert len(set(sequence)) == len(sequence)
    assert stays[sequence].all()
    plan = Plan(BOX, tuple(placement(found, piece) for piece in sequence), ())
    report = audit_plan(plan, shelf().items)
    assert report.ok, report


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_a_sequence_is_whole_exactly_where_there_is_no_cycle(seed: int) -> None:
    found = scattered(seed)
    n = len(found.pieces)
    blocks = blocking(found)
    whole = len(loading_sequence(found, np.ones(n, dtype=np.bool_))) == n
    assert whole == (not to_untangle(found).any())
    if n <= 6:
        sequences = itertools.permutations(range(n))
        # A later piece must not be blocked by an earlier one.
        assert whole == any(not any(blocks[a, b] for a, b in itertools.combinations(s, 2)) for s in sequences)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_without_the_ways_to_untangle_there_is_a_sequence(seed: int) -> None:
    found = scattered(seed)
    pairs, left = to_untangle(found) > 0, blocking(found)
    assert (left | ~pairs).all()
    left &= ~pairs
    while left.any():  # take out who blocks nobody, again and again
        free = ~left.any(axis=1)
        before = left.sum()
        left[:, free] = False
        assert left.sum() < before


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_most_is_loadable_and_nothing_of_it_blocks_what_comes_later(seed: int) -> None:
    found = scattered(seed)
    sequence, blocks = loadable(found, 0.0), blocking(found)
    assert not found.overlaps[np.ix_(sequence, sequence)].any()
    assert not any(blocks[a, b] for a, b in itertools.combinations(sequence, 2))
    stays = free_of_overlap(found)
    assert set(loading_sequence(found, stays)) <= set(sequence) <= set(np.flatnonzero(stays).tolist())
    assert len(sequence) >= min(1, stays.sum())


def test_a_stick_in_two_rings_is_a_cycle_that_separation_undoes() -> None:
    """A stick through two rings that stand upright: it would have to be there before and after each."""
    found = arrangement_of(["ring", "stick", "ring"])
    upright = next(k for k, o in enumerate(found.pieces[0].orientations) if o.extents[2] > 0.05)
    ring = np.array(found.voxels(0, upright).grid.shape)
    axis = int(np.argmin(ring[:2]))  # of the rings, and of the stick
    lying = (k for k, o in enumerate(found.pieces[1].orientations) if o.extents[axis] > 0.1)
    level = min(lying, key=lambda k: found.voxels(1, k).count)
    corner = np.array([4, 4, 0])
    for piece, where in ((0, 6), (2, 16)):
        corner[axis] = where
        found.move(piece, upright, corner)
    corner += (ring - found.voxels(1, level).grid.shape) // 2
    corner[axis] = 0
    found.move(1, level, corner)
    assert found.overlap == 0
    assert loading_sequence(found, np.ones(3, dtype=np.bool_)) == []
    found.keep_below(to_untangle(found) > 0)
    assert found.overlap > 0
    Separation().run(found, np.random.default_rng(0), Effort(moves=100))
    assert sorted(loading_sequence(found, np.ones(3, dtype=np.bool_))) == [0, 1, 2]
