"""How much of an item would be in what, at every place in a box at once: a correlation, by FFT."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from packenv.types import BoolArray, Float32Array


@dataclass(frozen=True, eq=False)
class OverlapMap:
    """A weighted sum of voxel sets, ready to be correlated with items.

    Attributes:
        field: (nx, ny, nz) float32, the weight of each voxel of the box.
    """

    field: Float32Array

    @cached_property
    def _spectrum(self) -> np.ndarray:
        from scipy import fft

        return np.asarray(fft.rfftn(self.field, self._shape))

    @cached_property
    def _shape(self) -> tuple[int, int, int]:
        """What the transforms are padded to: places where an item is whole in the box do not wrap round."""
        from scipy import fft

        x, y, z = self.field.shape
        return fft.next_fast_len(x), fft.next_fast_len(y), fft.next_fast_len(z, real=True)

    def at(self, grid: BoolArray | Float32Array, places: tuple[int, int, int]) -> Float32Array:
        """The weight of an item's voxels at each place, to single precision.

        Axis by axis, so that lines without a voxel of the item, and places outside the box, cost nothing.

        Args:
            grid: (w, d, h) the item.
            places: (3,) numbers of places along x, y and z, each at least 1, see :meth:`Voxels.places`.

        Returns:
            (places) float32.
        """
        from scipy import fft

        x, y, z = self._shape
        own = fft.rfft(grid.astype(np.float32), z, axis=2)
        own = fft.fft(own, y, axis=1, overwrite_x=True)
        own = fft.fft(own, x, axis=0, overwrite_x=True)
        np.conjugate(own, out=own)
        own *= self._spectrum
        found = fft.ifft(own, axis=0, overwrite_x=True)[: places[0]]
        found = fft.ifft(found, axis=1, overwrite_x=True)[:, : places[1]]
        weights: Float32Array = fft.irfft(found, z, axis=2, overwrite_x=True)[:, :, : places[2]]
        return weights
