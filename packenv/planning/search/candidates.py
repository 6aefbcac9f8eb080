"""Candidate placements: the paper's 3DGridSearch (Alg. 2) over all orientations and translations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from packenv.config import CLEARANCE
from packenv.planning.constraints import Trial
from packenv.planning.search import kernels
from packenv.planning.search.container_map import ContainerMap, PolyphaseMap
from packenv.types import Float32Array, FloatArray, IntArray, OrientedItem

_ROUNDING = 1e-9
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
        room = np.floor((slack[:2] + _ROUNDING) / (step * surface.source.cell_size)).astype(int)
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


class CandidateGroup(Protocol):
    """Candidates of one orientation, as heuristics see them: a grid of translations, or a list of places."""

    @property
    def oriented(self) -> OrientedItem:
        """The item at this orientation, at the edge of its first cell."""
        ...

    @property
    def surface(self) -> PolyphaseMap:
        """The container's map."""
        ...

    def raised(self) -> FloatArray:
        """(n,) by how much the heights of all cells together grow with each candidate, m."""
        ...

    def touched_area(self) -> FloatArray:
        """(n,) area that touches items, walls and floor with each candidate, m²."""
        ...


@dataclass(frozen=True, eq=False)
class Candidates:
    """All legal candidates of one item: inside the container, top included, and free of overlap.

    Attributes:
        item: name of the item.
        grids: one group for each orientation whose footprint fits, in order of orientation.
        grid_index: (n,) index into ``grids``.
        ix: (n,) cell of the smallest x.
        iy: (n,) cell of the smallest y.
        z: (n,) float32 height of the lowest point by the heightmaps, m.
        cell_size: m.
        xy: (n, 2) smallest x and y, m; None where they are all at the edges of these cells.
        lowered: whether :meth:`trial` lowers a candidate to where the meshes meet, where these are known.
    """

    item: str
    grids: tuple[CandidateGroup, ...]
    grid_index: IntArray
    ix: IntArray
    iy: IntArray
    z: Float32Array
    cell_size: float
    xy: FloatArray | None = None
    lowered: bool = True

    def __len__(self) -> int:
        """Number of candidates."""
        return len(self.z)

    def trial(self, index: int) -> Trial:
        """A candidate as the constraints want it."""
        group = self.grids[self.grid_index[index]]
        surface, oriented, z = group.surface.source, group.oriented, float(self.z[index])
        ix, iy = int(self.ix[index]), int(self.iy[index])
        if self.xy is not None:
            oriented, ix, iy = surface.locate(oriented, *self.xy[index].tolist())
            z = surface.bound(oriented, ix, iy)
        if self.lowered:
            z = surface.lowest(oriented, ix, iy, z)
        return Trial(oriented, ix, iy, z)

    @property
    def places(self) -> FloatArray:
        """(n, 2) smallest x and y of each candidate, m."""
        if self.xy is not None:
            return self.xy
        return np.column_stack([self.ix, self.iy]).astype(np.float64) * self.cell_size

    @property
    def xy_sum(self) -> FloatArray:
        """(n,) X + Y of the corner, m: the tie-break of the scores."""
        if self.xy is not None:
            return np.asarray(self.xy.sum(axis=1), dtype=np.float64)
        return np.asarray(self.ix + self.iy, dtype=np.float64) * self.cell_size

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
        corners: FloatArray = np.column_stack([self.places, self.z])
        return corners

    def only(self, chosen: IntArray) -> Candidates:
        """Some of them; what their groups are asked still tells of all."""
        return replace(
            self,
            grid_index=self.grid_index[chosen],
            ix=self.ix[chosen],
            iy=self.iy[chosen],
            z=self.z[chosen],
            xy=None if self.xy is None else self.xy[chosen],
        )

    def joined(self, other: Candidates) -> Candidates:
        """Both, these first."""
        if not len(other):
            return self
        return replace(
            self,
            item=other.item,
            grids=(*self.grids, *other.grids),
            grid_index=np.concatenate([self.grid_index, other.grid_index + len(self.grids)]),
            ix=np.concatenate([self.ix, other.ix]),
            iy=np.concatenate([self.iy, other.iy]),
            z=np.concatenate([self.z, other.z]),
            xy=np.concatenate([self.places, other.places]),
        )


def place_code(rotation: int, x: int, y: int) -> int:
    """One number for a candidate: that of its rotation, and its smallest x and y in µm."""
    return (rotation << 44) + (x << 22) + y


def place_codes(candidates: Candidates, numbers: dict[bytes, int]) -> IntArray:
    """(n,) :func:`place_code` of each candidate.

    Args:
        candidates: of one item.
        numbers: what number each rotation has; new ones are added.
    """
    rotations = [group.oriented.rotation.tobytes() for group in candidates.grids]
    own = np.array([numbers.setdefault(r, len(numbers)) for r in rotations], dtype=np.int64)
    x, y = np.rint(candidates.places * 1e6).astype(np.int64).T
    codes: IntArray = (own[candidates.grid_index] << 44) + (x << 22) + y
    return codes


def ranked(scores: FloatArray, most: int) -> IntArray:
    """Indices of the ``most`` best candidates, best first; equal scores keep the candidates' order."""
    if most == 1:
        return np.array([np.argmin(scores)])
    n = min(most, len(scores))
    bound = np.partition(scores, n - 1)[n - 1]
    best = np.flatnonzero(scores <= bound)
    order: IntArray = best[np.argsort(scores[best], kind="stable")][:n]
    return order


def grid_search(
    surface: ContainerMap,
    orientations: Sequence[OrientedItem],
    step: int,
    clearance: int = 0,
    lift: float = 0.0,
    reach: float = 0.0,
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
        reach: how far candidates may stand out of the container, m.
    """
    polyphase = PolyphaseMap(surface, step)
    spread = PolyphaseMap(surface.spread(clearance), step) if clearance else None
    found = (TranslationGrid.search(polyphase, oriented, spread, lift, reach) for oriented in orientations)
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
