"""Candidate placements: the paper's 3DGridSearch (Alg. 2) over all orientations and translations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from packenv.config import CLEARANCE
from packenv.planning.constraints import Trial
from packenv.planning.search import kernels
from packenv.planning.search.container_map import ContainerMap, PolyphaseMap
from packenv.types import Float32Array, FloatArray, IntArray, OrientedItem


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
    ) -> TranslationGrid | None:
        """Lowest z everywhere and which translations are legal; None where the footprint never fits.

        Args:
            surface: the container's map.
            oriented: the item at its orientation.
            spread: the map with its heights spread sideways (:meth:`ContainerMap.spread`): a translation is
                then legal only where the item clears this one too when it is lifted by ``lift``.
            lift: m.
        """
        nx, ny = surface.source.heights.shape
        slack = np.add(surface.source.container.size, CLEARANCE) - oriented.extents
        if slack.min() < 0:
            return None
        oriented = surface.source.cut(oriented)
        w, h = oriented.top.shape
        step, rows, stride = surface.step, surface.rows, surface.stride
        across, along = (nx - w) // step + 1, (ny - h) // step + 1
        if across < 1 or along < 1:
            return None
        offsets = np.empty(w * h, dtype=np.int64)
        bottoms = np.empty(w * h, dtype=np.float32)
        n = kernels.footprint_cells(oriented.bottom, step, rows, stride, offsets, bottoms)
        z = np.empty((across - 1) * stride + along, dtype=np.float32)
        kernels.lowest_z(surface.heights, offsets, bottoms, n, z)
        fits = z.astype(np.float64) <= slack[2]
        if spread is not None:
            higher = np.empty_like(z)
            kernels.lowest_z(spread.heights, offsets, bottoms, n, higher)
            fits &= higher <= z + np.float32(lift)
        legal = np.flatnonzero(fits)
        inside = legal[legal % stride < along]
        return cls(oriented, surface, n, offsets, bottoms, z, inside)


@dataclass(frozen=True, eq=False)
class Candidates:
    """All legal candidates of one item: inside the container, top included, and free of overlap.

    Attributes:
        item: name of the item.
        grids: one for each orientation whose footprint fits, in order of orientation.
        grid_index: (n,) index into ``grids``.
        ix: (n,) cell of the smallest x.
        iy: (n,) cell of the smallest y.
        z: (n,) float32 height of the lowest point by the heightmaps, m.
        cell_size: m.
        lowered: whether :meth:`trial` lowers a candidate to where the meshes meet, where these are known.
    """

    item: str
    grids: tuple[TranslationGrid, ...]
    grid_index: IntArray
    ix: IntArray
    iy: IntArray
    z: Float32Array
    cell_size: float
    lowered: bool = True

    def __len__(self) -> int:
        """Number of candidates."""
        return len(self.z)

    def trial(self, index: int) -> Trial:
        """A candidate as the constraints want it."""
        grid = self.grids[self.grid_index[index]]
        ix, iy, z = int(self.ix[index]), int(self.iy[index]), float(self.z[index])
        if self.lowered:
            z = grid.surface.source.lowest(grid.oriented, ix, iy, z)
        return Trial(grid.oriented, ix, iy, z)

    @property
    def xy_sum(self) -> FloatArray:
        """(n,) X + Y of the corner, m: the tie-break of the scores."""
        cells: FloatArray = (self.ix + self.iy).astype(np.float64)
        return cells * self.cell_size

    @property
    def extents(self) -> FloatArray:
        """(n, 3) size of each candidate's bounding box, m."""
        if not self.grids:
            return np.empty((0, 3))
        sizes: FloatArray = np.array([grid.oriented.extents for grid in self.grids])[self.grid_index]
        return sizes

    @property
    def corners(self) -> FloatArray:
        """(n, 3) smallest x, y, z of each candidate, container frame, m."""
        corners: FloatArray = np.column_stack([self.ix * self.cell_size, self.iy * self.cell_size, self.z])
        return corners


def grid_search(
    surface: ContainerMap,
    orientations: Sequence[OrientedItem],
    step: int,
    clearance: int = 0,
    lift: float = 0.0,
) -> Candidates:
    """Find every legal candidate of an item (paper Alg. 2).

    The order of the candidates is that of the loops of Alg. 2: orientation, then x, then y.

    Args:
        surface: the container heightmap.
        orientations: the item at every orientation to try; at least one.
        step: cells between tried translations.
        clearance: cells by which the item may be off sideways, lifted by ``lift``, and still meet nothing;
            0 asks for non-overlap alone (the paper).
        lift: m.
    """
    polyphase = PolyphaseMap(surface, step)
    spread = PolyphaseMap(surface.spread(clearance), step) if clearance else None
    found = (TranslationGrid.search(polyphase, oriented, spread, lift) for oriented in orientations)
    grids = tuple(grid for grid in found if grid is not None)
    counts = [len(grid.legal) for grid in grids]
    legal = np.concatenate([grid.legal for grid in grids] or [np.empty(0, dtype=np.int64)])
    z = np.concatenate([grid.z[grid.legal] for grid in grids] or [np.empty(0, dtype=np.float32)])
    across, along = np.divmod(legal, polyphase.stride)
    return Candidates(
        item=orientations[0].item,
        grids=grids,
        grid_index=np.repeat(np.arange(len(grids)), counts),
        ix=across * step,
        iy=along * step,
        z=z,
        cell_size=surface.cell_size,
        lowered=not clearance,  # an item that may be off sideways must not be in another one
    )
