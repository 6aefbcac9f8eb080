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
    _known: dict[tuple[Voxels, bool, bool], int] = field(default_factory=dict)

    @property
    def arrays(self) -> tuple[Float32Array, IntArray, IntArray]:
        """What the kernels are given first."""
        return self.pool, self.layers, self.rows

    def of(self, voxels: Voxels, above: bool = False, below: bool = False) -> int:
        """Number of the shape that a voxel set is, with all that is straight above it, or below it."""
        key = voxels, above, below
        if key not in self._known:
            low, high = voxels.runs
            if above or below:
                least, most = low.min(axis=0, keepdims=True), high.max(axis=0, keepdims=True)
                there = most > least
                low = np.where(there, np.float32(-NOWHERE), np.float32(NOWHERE)) if below else least
                high = np.where(there, np.float32(NOWHERE), np.float32(-NOWHERE)) if above else most
            self._known[key] = self._add(low, high)
        return self._known[key]

    def _add(self, low: Float32Array, high: Float32Array) -> int:
        """Put a shape in; each layer loses the margin in which it has no run."""
        rows = []
        for bottoms, tops in zip(low, high, strict=True):
            x, y = np.nonzero(tops > bottoms)
            if not len(x):
                continue
            i, j = x.min(), y.min()
            part = np.s_[i : x.max() + 1, j : y.max() + 1]
            bottoms, tops = bottoms[part], tops[part]
            rows.append((self._used, i, j, *bottoms.shape, int(bottoms.min()), int(tops.max())))
            for values in (bottoms, tops):
                end = self._used + values.size
                if end > len(self.pool):
                    self.pool = np.concatenate([self.pool[: self._used], np.empty(end, dtype=np.float32)])
                self.pool[self._used : end] = values.ravel()
                self._used = end
        first = len(self.layers)
        if rows:
            self.layers = np.concatenate([self.layers, np.array(rows, dtype=np.int64)])
        self.rows = np.concatenate([self.rows, np.array([[first, len(self.layers)]])])
        return len(self.rows) - 1
