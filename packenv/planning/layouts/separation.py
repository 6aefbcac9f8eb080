"""Separation: all pieces are in the box from the start, and overlaps are moved out.

A piece that overlaps goes to where it overlaps least, each overlap weighted by how long its pair has resisted. This is
the idea of sparrow (Gardeyn, Vanden Berghe and Wauters 2025) for irregular strip packing in the plane, here on voxels
that are kept as runs: sums along them tell about every place in the box at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from packenv.geometry.run_kernels import descend, fill_sampled, sampled_minima
from packenv.planning.layouts.effort import Effort
from packenv.planning.layouts.layout import Arrangement, Layout, WillDo, without_overlap
from packenv.types import FloatArray

_HEAVIEST = 1e4
"""Largest weight: sums of it along a column of voxels fit 32 bits."""

_LOOKED_AT = 15_000
"""About so many places in a box are looked at before voxels are."""
_UNIT = 16
"""Weights are whole multiples of one over this where places are looked for, so that sums of them are exact."""


@dataclass(frozen=True, eq=False)
class Separation:
    """Moves overlaps out of an arrangement.

    Attributes:
        tries: places, at any of the orientations, from which a move goes on voxel by voxel.
        growth: least and most by which the weight of a pair that overlaps is multiplied after a round.
        decay: by which the weight of one that does not is, down to 1.
        patience: rounds without a better layout before the best one is gone back to.
    """

    tries: int = 3
    growth: tuple[float, float] = (1.2, 2.0)
    decay: float = 0.95
    patience: int = 30

    def start(self, arrangement: Arrangement, rng: np.random.Generator, effort: Effort) -> None:
        """Put in, one after another, the pieces that are nowhere, each where it overlaps least."""
        ones = np.ones(len(arrangement.pieces) + 1)
        for piece in np.flatnonzero(arrangement.kinds < 0).tolist():
            self.move(arrangement, piece, ones, rng)
            effort.spent += 1

    def run(
        self,
        arrangement: Arrangement,
        rng: np.random.Generator,
        effort: Effort,
        will_do: WillDo = without_overlap,
    ) -> Layout:
        """Move until a layout will do or the effort is spent.

        Args:
            arrangement: is moved; pieces that are nowhere are put in first.
            rng: the same one makes the same moves.
            effort: how long to go on.
            will_do: is asked of each layout that has less overlap than all before it.

        Returns:
            The layout with least overlap, where the arrangement then is.
        """
        self.start(arrangement, rng, effort)
        n = len(arrangement.pieces)
        weights, best, stale = np.ones((n + 1, n + 1)), arrangement.layout, 0
        done = will_do(arrangement)
        while not done and effort.left():
            for piece in rng.permutation(arrangement.colliding).tolist():
                if not effort.left():
                    break
                if arrangement.overlaps[piece].any():
                    self.move(arrangement, piece, weights[piece], rng)
                    effort.spent += 1
            self.reweigh(weights, arrangement)
            stale += 1
            if arrangement.overlap < best.overlap:
                best, stale, done = arrangement.layout, 0, will_do(arrangement)
            elif stale >= self.patience:
                arrangement.restore(best)
                self.disturb(arrangement, rng)
                weights[:], stale = 1.0, 0
        arrangement.restore(best)
        return best

    def move(
        self, arrangement: Arrangement, piece: int, weights: FloatArray, rng: np.random.Generator
    ) -> None:
        """Put a piece where it overlaps least, at any of its orientations."""
        _, kind, at = self.best_place(arrangement, piece, weights, rng)
        arrangement.move(piece, kind, at)

    def best_place(
        self, arrangement: Arrangement, piece: int, weights: FloatArray, rng: np.random.Generator
    ) -> tuple[float, int, tuple[int, int, int]]:
        """What the place where a piece overlaps least costs, its orientation there, and the place.

        A sample of the columns tells where about; from the most promising places it goes on voxel by voxel. Of places
        without overlap a low one in a corner that is drawn is taken. Where the piece is has no advantage: that it has
        to go elsewhere, if only by a little, is what keeps the search from standing still.
        """
        others, shapes, places = arrangement.others(piece)
        # What is in the way now comes first: most places turn out to be worse by that alone.
        first = np.argsort(-arrangement.overlaps[piece, others], kind="stable")
        others, shapes, places = others[first], shapes[first], places[first]
        own, along = weights[others], rng.choice([-1.0, 1.0], 2)
        step = _step(arrangement.shape)
        field = np.empty([n // step + 4 for n in arrangement.shape], dtype=np.int32)
        fill_sampled(
            *arrangement.runs.arrays, shapes, places, np.rint(own * _UNIT).astype(np.int32), step, field
        )
        starts: list[tuple[float, int, int, tuple[int, int, int]]] = []
        rough = np.empty((self.tries, 4))
        for kind in rng.permutation(len(arrangement.pieces[piece].orientations)).tolist():
            shape, last = arrangement.shape_of(piece, kind), np.subtract(arrangement.places(piece, kind), 1)
            sampled_minima(*arrangement.runs.arrays, shape, last, step, field, *along, rough)
            starts += [
                (c, kind, shape, (int(x), int(y), int(z))) for c, x, y, z in rough.tolist() if c < np.inf
            ]
        starts.sort(key=lambda one: one[0])
        best, found = np.inf, (starts[0][1], starts[0][3])
        for _, kind, shape, begin in starts[: self.tries]:
            last = np.subtract(arrangement.places(piece, kind), 1)
            weight, *at = descend(
                *arrangement.runs.arrays, shape, begin, last, shapes, places, own, max(step // 2, 1), *along
            )
            if weight < best:
                best, found = weight, (kind, (at[0], at[1], at[2]))
            if best == 0.0:
                break
        return best, *found

    def reweigh(self, weights: FloatArray, arrangement: Arrangement) -> None:
        """Grow the weights of pairs that overlap, in place, most where most; let the others decay."""
        overlaps = arrangement.overlaps
        low, high = self.growth
        share = overlaps / max(int(overlaps.max()), 1)
        np.multiply(weights, np.where(overlaps > 0, low + (high - low) * share, self.decay), out=weights)
        np.maximum(weights, 1.0, out=weights)
        weights /= max(1.0, float(weights.max()) / _HEAVIEST)
        np.maximum(weights, 1.0, out=weights)

    def disturb(self, arrangement: Arrangement, rng: np.random.Generator) -> None:
        """Exchange two pieces."""
        n = len(arrangement.pieces)
        if n > 1:
            a, b = rng.choice(n, 2, replace=False).tolist()
            arrangement.exchange(a, b)


def _step(shape: tuple[int, int, int]) -> int:
    """Of how many places along each axis one is looked at first."""
    return max(round(math.cbrt(math.prod(shape) / _LOOKED_AT)), 1)
