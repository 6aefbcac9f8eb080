"""How far outside an item a point is, with its closed cavities counted as inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from packenv.geometry.distance_grids import BAND, REACH, SPACING, SurfaceField
from packenv.geometry.distance_kernels import trilinear
from packenv.types import Float32Array, FloatArray


@dataclass(frozen=True, eq=False)
class OutsideDepth:
    """Distance of points from an item's solid, without the limit that a surface field's band has.

    A cavity that no passage wider than a grid cell connects to the outside is taken as solid: nothing can
    be put into it, so a convex part may fill it.

    Attributes:
        field: the item's surface field.
        grid: (a, b, c) float32 at the field's nodes, m: distance from the solid, negative inside it.
    """

    field: SurfaceField
    grid: Float32Array

    @classmethod
    def of_field(cls, field: SurfaceField) -> OutsideDepth:
        """Extend a surface field beyond its band, and fill its cavities."""
        from scipy import ndimage

        signed = field.distance
        grid = signed.astype(np.float64)
        # Of two neighbouring nodes on both sides of a wall one is within half a spacing of it.
        free, _ = ndimage.label(signed > SPACING / 2)
        open_air = np.unique(np.concatenate([side.ravel() for side in _sides(free)]))
        cavity = (free > 0) & ~np.isin(free, open_air)
        far = signed >= BAND * (1.0 - 1e-6)
        beyond = ndimage.distance_transform_edt(far) * SPACING
        grid[far] = BAND + beyond[far] - SPACING
        grid[cavity] = -SPACING / 2
        return cls(field, np.ascontiguousarray(grid, np.float32))

    def quick(self, points: FloatArray) -> FloatArray:
        """(k,) m, interpolated: good to 0.1 mm or so near the surface, to a millimetre far from it.

        Args:
            points: (k, 3) mesh frame, m.
        """
        values = np.empty(len(points))
        points = np.ascontiguousarray(points, np.float64)
        trilinear(points, self.field.origin, SPACING, self.grid, 1.0, values)
        return values

    def exact(self, points: FloatArray) -> FloatArray:
        """(k,) m, exact where the distance is at most 2.5 mm, else as :meth:`quick`.

        Args:
            points: (k, 3) mesh frame, m.
        """
        values = self.quick(points)
        near = np.flatnonzero((values > -SPACING) & (values < REACH + SPACING))
        signed, _, _ = self.field.closest(np.ascontiguousarray(points[near], np.float64))
        # A quick value well below zero where the exact one is above it: a cavity.
        known = np.isfinite(signed) & ~((values[near] < -SPACING / 4) & (signed > SPACING / 2))
        values[near[known]] = signed[known]
        return values


def _sides(labels: np.ndarray) -> list[np.ndarray]:
    return [labels[i] for i in (0, -1)] + [labels[:, i] for i in (0, -1)] + [labels[:, :, i] for i in (0, -1)]
