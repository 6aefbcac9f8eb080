"""Candidate placements: the paper's 3DGridSearch (Alg. 2) over all orientations and translations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from packenv.planning.constraints import Trial
from packenv.planning.search.container_map import ContainerMap, PolyphaseMap
from packenv.planning.search.translation_grid import TranslationGrid
from packenv.types import Float32Array, FloatArray, IntArray, OrientedItem


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


_Whole = TypeVar("_Whole", int, IntArray)


def place_code(rotation: _Whole, x: _Whole, y: _Whole) -> _Whole:
    """One number for a candidate, or for each of many: that of its rotation, and its smallest x and y in µm."""
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
    return place_code(own[candidates.grid_index], x, y)


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
