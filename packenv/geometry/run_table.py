"""Voxel sets as runs, all in one table that compiled kernels read."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from packenv.geometry.run_kernels import NOWHERE
from packenv.geometry.voxels import Voxels
from packenv.types import Float32Array, IntArray


@dataclass(eq=False)
class RunTable:
    """Every shape that was asked for.

    Attributes:
        pool: bottoms and tops of all layers, see :mod:`packenv.geometry.run_kernels`.
        layers: (m, 7) where each layer is.
        rows: (n, 2) which layers each shape has.
    """

    pool: Float32Array = field(default_factory=lambda: np.empty(0, dtype=np.float32))
    layers: IntArray = field(default_factory=lambda: np.empty((0, 7), dtype=np.int64))
    rows: IntArray = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    _used: int = 0
    _known: dict[Voxels, tuple[int, int, int, int]] = field(default_factory=dict)

    @property
    def arrays(self) -> tuple[Float32Array, IntArray, IntArray]:
        """What the kernels are given first."""
        return self.pool, self.layers, self.rows

    def of(self, voxels: Voxels) -> tuple[int, int, int, int]:
        """Numbers of four shapes: a voxel set, with all above it, with all below it, and with both."""
        if voxels not in self._known:
            low, high = voxels.runs
            least, most = low.min(axis=0), high.max(axis=0)
            top, bottom = np.where(most > 0, NOWHERE, -NOWHERE), np.where(most > 0, -NOWHERE, NOWHERE)
            self._known[voxels] = (
                self._add(low, high),
                self._add(least[None], top[None]),
                self._add(bottom[None], most[None]),
                self._add(bottom[None], top[None]),
            )
        return self._known[voxels]

    def _add(self, low: Float32Array, high: Float32Array) -> int:
        """Put a shape in; each layer loses the margin in which it has no run."""
        rows = []
        for bottoms, tops in zip(low, high, strict=True):
            there = tops > bottoms
            xs, ys = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
            if not len(xs):
                continue
            part = np.s_[xs[0] : xs[-1] + 1, ys[0] : ys[-1] + 1]
            own = np.stack([bottoms[part], tops[part]]).astype(np.float32)
            if self._used + own.size > len(self.pool):
                larger = np.empty(2 * (self._used + own.size), dtype=np.float32)
                larger[: self._used] = self.pool[: self._used]
                self.pool = larger
            self.pool[self._used : self._used + own.size] = own.ravel()
            extremes = own[0].min(), own[1].max()
            rows.append((self._used, xs[0], ys[0], *own.shape[1:], *map(int, extremes)))
            self._used += own.size
        first = len(self.layers)
        if rows:
            self.layers = np.concatenate([self.layers, np.array(rows, dtype=np.int64)])
        self.rows = np.concatenate([self.rows, np.array([[first, len(self.layers)]])])
        return len(self.rows) - 1
