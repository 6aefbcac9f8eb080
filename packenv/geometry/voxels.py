"""Items as voxels: every voxel that the solid touches, so what shares no voxel does not overlap."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from packenv.config import CLEARANCE
from packenv.geometry.raster_kernels import TOUCH_TOLERANCE, settle
from packenv.geometry.run_kernels import find_runs, most_runs
from packenv.geometry.voxel_kernels import touch
from packenv.types import BoolArray, Float32Array, FloatArray, Item


@dataclass(frozen=True, eq=False)
class Voxels:
    """An item at one orientation as voxels.

    Attributes:
        grid: (w, d, h) bool, the voxels that the item touches; the item begins at the corner of the first one.
        extents: (3,) size of the item's bounding box, m.
        pitch: side of a voxel, m.
    """

    grid: BoolArray
    extents: FloatArray
    pitch: float

    @cached_property
    def runs(self) -> tuple[Float32Array, Float32Array]:
        """(layers, w, d) bottoms and tops of the runs of each column, see :mod:`packenv.geometry.run_kernels`."""
        shape = (max(most_runs(self.grid), 1), *self.grid.shape[:2])
        low, high = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.float32)
        find_runs(self.grid, low, high)
        return low, high

    @property
    def count(self) -> int:
        """Number of voxels that are set."""
        return int(np.count_nonzero(self.grid))

    def places(self, size: tuple[float, float, float]) -> tuple[int, int, int]:
        """Number of voxels along x, y and z at which the item may begin in a box; 0 where it does not fit.

        What reaches beyond a wall by less than the clearance of the audit fits, at one place.

        Args:
            size: of the box, m.
        """
        room = np.add(size, TOUCH_TOLERANCE) - self.extents
        free = np.maximum(np.floor(room / self.pitch + 1e-9), np.where(room >= -CLEARANCE, 0.0, -1.0))
        x, y, z = (int(n) + 1 for n in free)
        return x, y, z

    def within(self, shape: tuple[int, int, int]) -> Voxels:
        """The item without the voxels by which it is larger than a box of this shape."""
        if all(n <= most for n, most in zip(self.grid.shape, shape, strict=True)):
            return self
        x, y, z = shape
        return replace(self, grid=np.ascontiguousarray(self.grid[:x, :y, :z]))


def voxels_across(size: tuple[float, float, float], pitch: float) -> tuple[int, int, int]:
    """Voxels of a box along x, y and z; the last ones may reach beyond its walls."""
    x, y, z = (max(1, math.ceil((s - TOUCH_TOLERANCE) / pitch)) for s in size)
    return x, y, z


def voxelize(item: Item, rotation: FloatArray, pitch: float) -> Voxels:
    """The voxels that a rotated item touches, its inside included.

    What the surface touches is exact, up to the tolerance of the heightmaps. Of the rest, what no way through free
    voxels leads to from outside is inside, closed cavities too; an open cavity stays open where its mouth is more
    than a voxel wide.

    Args:
        item: the item.
        rotation: (3, 3) mesh frame to container axes.
        pitch: side of a voxel, m.
    """
    from scipy import ndimage

    vertices = item.vertices @ np.asarray(rotation, dtype=np.float64).T
    low, extents = np.empty(3), np.empty(3)
    settle(vertices, low, extents)
    w, d, h = (max(1, math.ceil((e - TOUCH_TOLERANCE) / pitch)) for e in extents)
    padded = np.zeros((w + 2, d + 2, h + 2), dtype=np.bool_)
    surface = np.zeros((w, d, h), dtype=np.bool_)
    touch(vertices, item.faces, pitch, surface)
    padded[1:-1, 1:-1, 1:-1] = surface
    regions, _ = ndimage.label(~padded)
    solid = np.ascontiguousarray((regions != regions[0, 0, 0])[1:-1, 1:-1, 1:-1])
    return Voxels(solid, extents, pitch)
