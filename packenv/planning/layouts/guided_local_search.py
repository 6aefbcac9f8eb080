"""Guided local search: the fourth method of the paper's Table 1.

After Egeblad, Nielsen and Odgaard (Fast neighborhood search for two- and three-dimensional nesting problems, 2007) and
Egeblad (2009): in a box of fixed size the sum of pairwise overlap volumes, and λ times the sum of the penalties of the
pairs that overlap, is made smaller by moving one item along x, y or z, or to another allowed orientation. In a local
minimum the pair with the largest overlap / (1 + penalty) is penalized. Here overlap is counted in voxels, by which the
exact volume is at most too large.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from packenv.geometry.run_kernels import costs_along
from packenv.planning.layouts.effort import Effort
from packenv.planning.layouts.layout import Arrangement, Layout, WillDo, without_overlap
from packenv.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class GuidedLocalSearch:
    """Searches for an arrangement without overlap.

    Attributes:
        weight: λ, as a share of the mean number of voxels of a piece.
        tries: orientations that are looked at in a move besides the present one.
        restarts: random starts, each with an equal share of the effort (the paper: 5).
    """

    weight: float = 0.02
    tries: int = 3
    restarts: int = 5

    def run(
        self,
        arrangement: Arrangement,
        rng: np.random.Generator,
        effort: Effort,
        will_do: WillDo = without_overlap,
    ) -> Layout:
        """Search until a layout will do or the effort is spent.

        Args:
            arrangement: is moved; the first start is from where its pieces are.
            rng: the same one makes the same moves.
            effort: how long to go on.
            will_do: is asked of each layout that has less overlap than all before it.

        Returns:
            The layout with least overlap, where the arrangement then is.
        """
        best: Layout | None = None
        for left in range(self.restarts, 0, -1):
            share = effort.share(left)
            if left < self.restarts:
                arrangement.kinds[:] = -1
            least = math.inf if best is None else best.overlap
            found, done = self.climb(arrangement, rng, share, will_do, least)
            effort.spent += share.spent
            if best is None or found.overlap < best.overlap:
                best = found
            if done or not effort.left():
                break
        assert best is not None
        arrangement.restore(best)
        return best

    def climb(
        self,
        arrangement: Arrangement,
        rng: np.random.Generator,
        effort: Effort,
        will_do: WillDo,
        least: float,
    ) -> tuple[Layout, bool]:
        """One start: pieces that are nowhere at random places, then moves and penalties.

        Args:
            arrangement: as for :meth:`run`.
            rng: likewise.
            effort: likewise.
            will_do: likewise.
            least: overlap of the best layout before.

        Returns:
            the layout with least overlap, and whether it will do.
        """
        n = len(arrangement.pieces)
        for piece in np.flatnonzero(arrangement.kinds < 0).tolist():
            kind = int(rng.integers(len(arrangement.pieces[piece].orientations)))
            arrangement.move(piece, kind, rng.integers(0, arrangement.places(piece, kind)))
        sizes = [arrangement.voxels(piece).count for piece in range(n)]
        unit = self.weight * float(np.mean(sizes))
        penalties, best = np.zeros((n + 1, n + 1)), arrangement.layout
        active, done = set(range(n)), best.overlap < least and will_do(arrangement)
        while not done and effort.left():
            if not active:
                active = self.penalize(arrangement, penalties)
            # In order of number: a set's own order is nobody's promise.
            piece = sorted(active)[int(rng.integers(len(active)))]
            effort.spent += 1
            before = set(np.flatnonzero(arrangement.overlaps[piece, :n]).tolist())
            if not self.improve(arrangement, piece, penalties[piece] * unit, rng):
                active.discard(piece)
                continue
            active |= before | set(np.flatnonzero(arrangement.overlaps[piece, :n]).tolist())
            if arrangement.overlap < best.overlap:
                best = arrangement.layout
                done = best.overlap < least and will_do(arrangement)
        return best, done

    def penalize(self, arrangement: Arrangement, penalties: FloatArray) -> set[int]:
        """Raise the penalty of the pair with the largest overlap / (1 + penalty), in place; the two of it."""
        n = len(arrangement.pieces)
        usefulness = arrangement.overlaps / (1.0 + penalties)
        a, b = sorted(np.unravel_index(int(usefulness.argmax()), usefulness.shape))
        penalties[a, b] += 1.0
        penalties[b, a] = penalties[a, b]
        return {int(k) for k in (a, b) if k < n}

    def improve(
        self, arrangement: Arrangement, piece: int, penalties: FloatArray, rng: np.random.Generator
    ) -> bool:
        """Make the best move of a piece that lowers the objective; False where there is none.

        Args:
            arrangement: is changed.
            piece: its number.
            penalties: (n + 1,) λ times the penalty with each other piece, voxels.
            rng: draws orientations.
        """
        row = arrangement.overlaps[piece]
        best = float(row.sum() + penalties[row > 0].sum()) - 0.5
        found: tuple[int, IntArray] | None = None
        if best <= 0.0:
            return False
        for kind, at in self.starts(arrangement, piece, rng):
            for axis in range(3):
                costs = self.along(arrangement, piece, kind, at, axis, penalties)
                k = int(costs.argmin())
                if costs[k] < best:
                    best, place = float(costs[k]), at.copy()
                    place[axis] = k
                    found = kind, place
        if found is None:
            return False
        arrangement.move(piece, *found)
        return True

    def starts(
        self, arrangement: Arrangement, piece: int, rng: np.random.Generator
    ) -> Iterator[tuple[int, IntArray]]:
        """Where the lines of a move go through: the piece as it is, and turned about its middle."""
        now, at = int(arrangement.kinds[piece]), arrangement.at[piece]
        yield now, at.copy()
        middle = at + np.array(arrangement.voxels(piece).grid.shape) // 2
        drawn = rng.permutation(len(arrangement.pieces[piece].orientations)).tolist()
        for kind in [k for k in drawn if k != now][: self.tries]:
            yield kind, arrangement.about(piece, kind, middle)

    def along(
        self, arrangement: Arrangement, piece: int, kind: int, at: IntArray, axis: int, penalties: FloatArray
    ) -> FloatArray:
        """The objective's share of a piece at every place on a line through ``at`` along an axis."""
        costs = np.empty(arrangement.places(piece, kind)[axis])
        # An orientation that is new may make the table longer: it is asked for before the table is.
        own, (others, shapes, places) = arrangement.shape_of(piece, kind), arrangement.others(piece)
        table = arrangement.runs.arrays
        costs_along(*table, own, at, shapes, places, penalties[others], axis, costs)
        return costs
