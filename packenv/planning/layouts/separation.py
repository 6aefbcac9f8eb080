"""Separation: all pieces are in the box from the start, and overlaps are moved out.

A piece that overlaps goes to where it overlaps least, each overlap weighted by how long its pair has resisted. This is
the idea of sparrow (Gardeyn, Vanden Berghe and Wauters 2025) for irregular strip packing in the plane, here on voxels,
where one correlation tells every place in the box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from packenv.geometry.voxel_kernels import descend, halved, least
from packenv.planning.layouts.effort import Effort
from packenv.planning.layouts.layout import Arrangement, Layout, WillDo, without_overlap
from packenv.planning.layouts.overlap_map import OverlapMap
from packenv.types import FloatArray

_HEAVIEST = 1e4
"""Largest weight: a map in single precision still tells one voxel of weight 1 from none."""


@dataclass(frozen=True, eq=False)
class Separation:
    """Moves overlaps out of an arrangement.

    Attributes:
        tries: orientations that are looked at in a move, the present one among them.
        growth: least and most by which the weight of a pair that overlaps is multiplied after a round.
        decay: by which the weight of one that does not is, down to 1.
        patience: rounds without a better layout before the best one is gone back to.
    """

    tries: int = 5
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
        """Put a piece where it overlaps least, at any of its orientations.

        Blocks of voxels tell where about; from the most promising places it goes on voxel by voxel. Of places without
        overlap a low one in a corner that is drawn is taken. Where the piece is has no advantage: that it has to go
        elsewhere, if only by a little, is what keeps the search from standing still.
        """
        costs = arrangement.costs_without(piece, weights)
        blocks = np.zeros([n + 1 >> 1 for n in costs.shape], dtype=np.float32)
        halved(costs, blocks)
        rough, corner = OverlapMap(blocks), rng.choice([-1.0, 1.0], 2)
        starts: list[tuple[float, int, tuple[int, int, int]]] = []
        for kind in rng.permutation(len(arrangement.pieces[piece].orientations)).tolist():
            x, y, z = (n + 1 >> 1 for n in arrangement.places(piece, kind))
            weight, *at = least(rough.at(arrangement.voxels(piece, kind).coarse, (x, y, z)), *corner)
            starts.append((weight, kind, (2 * at[0], 2 * at[1], 2 * at[2])))
        starts.sort(key=lambda one: one[0])
        found: list[tuple[float, int, tuple[int, int, int]]] = []
        for _, kind, begin in starts[: self.tries]:
            grid, places = arrangement.voxels(piece, kind).grid, arrangement.places(piece, kind)
            weight, *at = descend(costs, grid, begin, places, *corner)
            found.append((weight, kind, (at[0], at[1], at[2])))
            if weight == 0.0:
                break
        _, kind, best = min(found, key=lambda one: one[0])
        arrangement.move(piece, kind, best)

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
