"""One orientation at every translation of the grid (paper Alg. 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from packenv.config import CLEARANCE
from packenv.planning.search import kernels
from packenv.planning.search.container_map import PolyphaseMap
from packenv.types import Float32Array, FloatArray, IntArray, OrientedItem

ROUNDING = 1e-9
"""Of sums of lengths, m."""


@dataclass(frozen=True, eq=False)
class TranslationGrid:
    """One orientation at every translation of the grid.

    Attributes:
        oriented: the item at this orientation.
        surface: the container's polyphase map.
        n_cells: number of footprint cells.
        offsets: (n_cells,) where each footprint cell lies in the polyphase map at translation 0.
        bottoms: (n_cells,) float32 bottom heightmap of the same cells, m.
        z: (translations,) float32 lowest height at every translation, m. Translation (a, b) has index
            a · stride + b; indices between two rows hold no translation.
        legal: indices of the legal translations, ascending.
    """

    oriented: OrientedItem
    surface: PolyphaseMap
    n_cells: int
    offsets: IntArray
    bottoms: Float32Array
    z: Float32Array
    legal: IntArray

    @classmethod
    def search(
        cls,
        surface: PolyphaseMap,
        oriented: OrientedItem,
        spread: PolyphaseMap | None = None,
        lift: float = 0.0,
        reach: float = 0.0,
    ) -> TranslationGrid | None:
        """Lowest z everywhere and which translations are legal; None where the footprint never fits.

        Args:
            surface: the container's map.
            oriented: the item at its orientation.
            spread: the map with its heights spread sideways (:meth:`ContainerMap.spread`): a translation is
                then legal only where the item clears this one too when it is lifted by ``lift``.
            lift: m.
            reach: how far the item may stand out of the container, m.
        """
        nx, ny = surface.source.heights.shape
        slack = np.add(surface.source.container.size, CLEARANCE) - oriented.extents
        if slack.min() < 0:
            return None
        oriented = surface.source.cut(oriented)
        w, h = oriented.top.shape
        step, rows, stride = surface.step, surface.rows, surface.stride
        # The last cell may reach beyond the wall, so the cells alone do not tell what is inside.
        # Only what is as large as the container may reach over a wall by a hair: at its only place.
        room = np.floor(
            np.maximum(slack[:2] - CLEARANCE + ROUNDING, 0.0) / (step * surface.source.cell_size)
        ).astype(int)
        across, along = min((nx - w) // step, int(room[0])) + 1, min((ny - h) // step, int(room[1])) + 1
        if across < 1 or along < 1:
            return None
        offsets = np.empty(w * h, dtype=np.int64)
        bottoms = np.empty(w * h, dtype=np.float32)
        n = kernels.footprint_cells(oriented.bottom, step, rows, stride, offsets, bottoms)
        z = np.empty((across - 1) * stride + along, dtype=np.float32)
        kernels.lowest_z(surface.heights, offsets, bottoms, n, z)
        fits = z.astype(np.float64) <= slack[2] + reach
        if spread is not None:
            higher = np.empty_like(z)
            kernels.lowest_z(spread.heights, offsets, bottoms, n, higher)
            fits &= higher <= z + np.float32(lift)
        legal = np.flatnonzero(fits)
        inside = legal[legal % stride < along]
        return cls(oriented, surface, n, offsets, bottoms, z, inside)

    def raised(self) -> FloatArray:
        """(legal,) by how much the heights of all cells together grow, m.

        At the *lowest* Z no cell of the footprint can stay below the container's surface, since
        Z + H_t ≥ Z + H_b ≥ H_c. So H'_c = Z + H_t on the whole footprint, and the sum grows by n Z + Σ H_t less
        the sum of H_c over the footprint, which row prefix sums give run by run instead of cell by cell. The
        result is exact, not an approximation.
        """
        surface, oriented = self.surface, self.oriented
        starts, ends = np.empty((2, oriented.bottom.size), dtype=np.int64)
        n = kernels.footprint_runs(oriented.bottom, surface.step, surface.rows, surface.stride, starts, ends)
        covered = np.empty(self.z.size)
        kernels.footprint_sums(surface.prefix_sums, starts, ends, n, covered)
        own = oriented.top.sum(dtype=np.float64)
        grown: FloatArray = self.n_cells * self.z.astype(np.float64) + own - covered
        return grown[self.legal]

    def touched_area(self) -> FloatArray:
        """(legal,) area that touches items, walls and floor, m²; see :func:`.heuristics.maximum_touching_area`."""
        surface, oriented, cell = self.surface, self.oriented, self.oriented.cell_size
        below, beside = np.empty((2, self.z.size))
        heights = surface.heights
        kernels.touched_cells(heights, self.offsets, self.bottoms, self.n_cells, self.z, cell / 2, below)
        own, neighbour = np.empty((2, 4 * oriented.bottom.size), dtype=np.int64)
        n = kernels.side_cells(oriented.bottom, surface.step, surface.rows, surface.stride, own, neighbour)
        flush = int(16.0 / surface.source.container.height)
        tops, bottoms = oriented.top.ravel(), oriented.bottom.ravel()
        kernels.touched_sides(heights, tops, bottoms, own, neighbour, n, self.z, flush, beside)
        area: FloatArray = below * cell**2 + beside * cell
        return area[self.legal]
