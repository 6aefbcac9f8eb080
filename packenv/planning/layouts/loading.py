"""In which sequence the pieces of a layout can be lowered into the box, straight from above.

A piece blocks another one's way down where, in a column of voxels that both have, its top is above the other's bottom:
then the other one has to be in the box before it.
"""

from __future__ import annotations

import numpy as np

from packenv.planning.layouts.layout import Arrangement
from packenv.types import BoolArray, IntArray


def blocking(arrangement: Arrangement) -> BoolArray:
    """(n + 1, n + 1) whether one piece, by row, blocks the way down of another one, by column.

    What is fixed is there first: it may block and waits for nothing. Pieces that are nowhere block nothing. Of two that
    overlap the one that has less of it above the other counts as the one below.
    """
    n = len(arrangement.pieces)
    found = np.zeros((n + 1, n + 1), dtype=np.bool_)
    there = np.flatnonzero(arrangement.kinds >= 0).tolist()
    maps = {k: _extremes(arrangement.voxels(k).grid, arrangement.at[k]) for k in there}
    if arrangement.fixed is not None:
        maps[n] = _extremes(arrangement.fixed, np.zeros(3, dtype=np.int64))
    for i, (low_i, top, _) in maps.items():
        for j, (low_j, _, bottom) in maps.items():
            if i == j or j == n:
                continue
            low = np.maximum(low_i, low_j)
            high = np.minimum(low_i + top.shape, low_j + bottom.shape)
            if (low >= high).any():
                continue
            own = tuple(slice(*pair) for pair in zip(low - low_i, high - low_i, strict=True))
            other = tuple(slice(*pair) for pair in zip(low - low_j, high - low_j, strict=True))
            found[i, j] = (top[own] > bottom[other]).any()
    for i, j in np.argwhere(found & found.T & (arrangement.overlaps > 0)).tolist():
        if i < j < n:
            lower = (i, j) if above(arrangement, i, j) < above(arrangement, j, i) else (j, i)
            found[lower] = False
    return found


def loading_sequence(
    arrangement: Arrangement, chosen: BoolArray, ignored: BoolArray | None = None
) -> list[int]:
    """Pieces in a sequence in which each has a free way down; of those that may be next the lowest one is.

    Args:
        arrangement: free of overlap among the chosen pieces.
        chosen: (n,) bool, those that are meant.
        ignored: (n + 1, n + 1) blocked ways that do not count; None counts all.

    Returns:
        Their numbers, less those in a cycle of pieces that block each other and those that wait for such a one.
    """
    n, left, found = len(arrangement.pieces), chosen.copy(), list[int]()
    blocks = blocking(arrangement)
    if ignored is not None:
        blocks &= ~ignored
    while True:
        # Who blocks a piece that is still to come has to wait for it; what is fixed waits for nobody.
        free = np.flatnonzero(left & ~blocks[:n, :n][:, left].any(axis=1) & ~blocks[n, :n])
        if not len(free):
            return found
        found.append(int(free[np.argmin(arrangement.at[free, 2])]))
        left[found[-1]] = False


def loadable(arrangement: Arrangement, slack: float) -> list[int]:
    """A loading sequence of as many pieces as are found to do: of cycles, what is in most is taken out.

    Args:
        arrangement: the pieces.
        slack: share of a piece's voxels that may be another one's, too, or above another one and in its way.
    """
    n, chosen, tangled = (
        len(arrangement.pieces),
        free_of_overlap(arrangement, slack),
        to_untangle(arrangement),
    )
    sizes = np.array([arrangement.voxels(k).count if chosen[k] else 0 for k in range(n)])
    slight = np.zeros(tangled.shape, dtype=np.bool_)
    slight[:n] = (tangled[:n] > 0) & (tangled[:n] <= slack * sizes[:, None])
    in_the_way = ((tangled > 0) & ~slight)[:n, :n]
    while True:
        found = loading_sequence(arrangement, chosen, slight)
        left = np.setdiff1d(np.flatnonzero(chosen), found)
        among = in_the_way[np.ix_(left, left)]
        counts = among.sum(axis=0) + among.sum(axis=1)
        if not counts.any():  # none is left, or what is fixed is in the way of those that are
            return found
        most = left[counts == counts.max()]
        chosen[most[np.argmin(sizes[most])]] = False


def to_untangle(arrangement: Arrangement) -> IntArray:
    """(n + 1, n + 1) blocked ways of which none may stay if there is to be a sequence: one, by row, above another one.

    Of each cycle it is the one in which least of a piece is above the other: how many voxels, and 0 for other pairs.
    """
    blocks = blocking(arrangement)
    found = np.zeros(blocks.shape, dtype=np.int64)
    amount = {(i, j): above(arrangement, i, j) for i, j in np.argwhere(blocks[:-1]).tolist()}
    while True:
        reach = blocks.copy()
        for k in range(len(blocks)):
            reach |= reach[:, [k]] & reach[[k], :]
        tangled = [(amount[i, j], i, j) for i, j in np.argwhere((blocks & reach.T)[:-1]).tolist()]
        if not tangled:
            return found
        least, i, j = min(tangled)
        found[i, j], blocks[i, j] = least, False


def above(arrangement: Arrangement, piece: int, other: int) -> int:
    """How many voxels of a piece are straight above another one's bottom."""
    low, _, bottom = _extremes(arrangement.voxels(other).grid, arrangement.at[other])
    x, y, z = np.nonzero(arrangement.voxels(piece).grid)
    at = arrangement.at[piece]
    x, y = x + at[0] - low[0], y + at[1] - low[1]
    inside = (x >= 0) & (y >= 0) & (x < bottom.shape[0]) & (y < bottom.shape[1])
    return int(np.count_nonzero(z[inside] + at[2] >= bottom[x[inside], y[inside]]))


def _extremes(grid: BoolArray, at: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Where a grid begins (2,), and the top and the bottom of each of its columns in the box, voxels."""
    height = grid.shape[2]
    any_ = grid.any(axis=2)
    top = np.where(any_, at[2] + height - grid[:, :, ::-1].argmax(axis=2), -1)
    bottom = np.where(any_, at[2] + grid.argmax(axis=2), np.iinfo(np.int64).max)
    return at[:2], top, bottom


def free_of_overlap(arrangement: Arrangement, slack: float = 0.0) -> BoolArray:
    """(n,) pieces that can stay: those that overlap are taken out one by one, what overlaps most pieces first.

    Of pieces that overlap equally many, the smaller one goes. What shares voxels with what is fixed goes at once.

    Args:
        arrangement: the pieces.
        slack: share of the smaller piece's voxels that may be the other's, too.
    """
    n = len(arrangement.pieces)
    stays: BoolArray = (arrangement.overlaps[:n, n] == 0) & (arrangement.kinds >= 0)
    sizes = np.array([arrangement.voxels(k).count if stays[k] else 0 for k in range(n)])
    too_much = arrangement.overlaps[:n, :n] > slack * np.minimum(sizes, sizes[:, None])
    while True:
        pairs = too_much & stays & stays[:, None]
        counts = pairs.sum(axis=1)
        if not counts.any():
            return stays
        most = np.flatnonzero(counts == counts.max())
        stays[most[np.argmin(sizes[most])]] = False
