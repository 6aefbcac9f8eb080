"""Exact places: besides the translations of the grid, those flush with walls and items, and those near the best.

A grid of 1 cm leaves up to 1 cm beside every item, and what lies against it begins within a cell, where maps of whole
cells cannot tell the two apart. So such places are estimated by the maps, and the best of them are then put to the
meshes (:mod:`.contact_height`), which say how low the item really comes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from packenv.config import CLEARANCE
from packenv.planning.search import place_kernels as kernels
from packenv.planning.search.candidates import Candidates, grid_search, place_code, place_codes, ranked
from packenv.planning.search.container_map import ON_EDGE, ContainerMap, PolyphaseMap
from packenv.planning.search.heuristics import Heuristic
from packenv.planning.search.translation_grid import ROUNDING
from packenv.types import FloatArray, IntArray, OrientedItem

_NEAR = 8
"""Best candidates of the grid around which every cell is tried."""

_BATCH = 6
"""Places that are put to the meshes at a time."""

_MOST = 48
"""Places of one item that are put to the meshes."""

_REACH = 2.0
"""A place is worth a look where the maps say that the item would stand out by less, m: wherever there is one. Maps are
off by the slope of a wall times two cells: by 8 cm in cups of 4 degrees, by all its height for a core in a tight bore.
"""

_DENSE_REACH = 0.05
"""The same where every cell is tried, which costs most, m."""


@dataclass(frozen=True, eq=False)
class PlaceList:
    """One orientation at some places.

    Attributes:
        oriented: the item at the edge of its first cell.
        surface: the container's map.
        places: (n, 2) smallest x and y, m.
        z: (n,) height of the lowest point at each, m.
    """

    oriented: OrientedItem
    surface: PolyphaseMap
    places: FloatArray
    z: FloatArray

    def raised(self) -> FloatArray:
        """(n,) by how much the heights of all cells together grow, m."""
        source, oriented, total = self.surface.source, self.oriented, np.empty(len(self.z))
        kernels.raised(source.heights, oriented.top, oriented.cell_size, self.places, self.z, total)
        return total

    def touched_area(self) -> FloatArray:
        """(n,) area that touches items, walls and floor, m²."""
        source, oriented, area = self.surface.source, self.oriented, np.empty(len(self.z))
        kernels.touched_area(
            source.heights,
            oriented.top,
            oriented.bottom,
            oriented.cell_size,
            source.container.height,
            self.places,
            self.z,
            area,
        )
        return area

    def only(self, chosen: IntArray) -> PlaceList:
        """Some of them."""
        return PlaceList(self.oriented, self.surface, self.places[chosen], self.z[chosen])


def listed(lists: Sequence[PlaceList], item: str, cell_size: float) -> Candidates:
    """Places as candidates, one list after another."""
    places = np.concatenate([found.places for found in lists] or [np.empty((0, 2))])
    cells = np.floor((places + ON_EDGE) / cell_size).astype(np.int64)
    return Candidates(
        item=item,
        grids=tuple(lists),
        grid_index=np.repeat(np.arange(len(lists)), [len(found.z) for found in lists]),
        ix=cells[:, 0],
        iy=cells[:, 1],
        z=np.concatenate([found.z for found in lists] or [np.empty(0)]).astype(np.float32),
        cell_size=cell_size,
        xy=places,
    )


@dataclass(frozen=True, eq=False)
class ExactPlaces:
    """Looks for better places than those of a grid.

    Attributes:
        heuristic: scores candidates; it is asked several times, so a score must not depend on the others.
        rng: for it.
    """

    heuristic: Heuristic
    rng: np.random.Generator

    def add(
        self,
        candidates: Candidates,
        scores: FloatArray,
        surface: ContainerMap,
        orientations: Sequence[OrientedItem],
        step: int,
        most: int,
    ) -> tuple[Candidates, FloatArray]:
        """The candidates of a grid and the best exact places of the same item, with the scores of all.

        Where there is none of either, every cell is tried.

        Args:
            candidates: the legal ones of the grid.
            scores: theirs.
            surface: the container's map.
            orientations: all that were tried.
            step: of the grid, cells.
            most: how many of the best will be asked for; with 1 only what may be better than all others is put to
                the meshes.
        """
        polyphase = PolyphaseMap(surface, 1)
        lists = [*_near(candidates, scores, polyphase, step), *_flush(polyphase, orientations)]
        found, own = self._settle(lists, most, float(scores.min(initial=np.inf)))
        if not len(candidates) and not len(found) and step > 1:
            dense = grid_search(surface, orientations, 1, reach=_DENSE_REACH)
            if len(dense):
                best = ranked(self.heuristic(dense, self.rng), _MOST)
                found, own = self._settle(_as_lists(dense, best, polyphase), _MOST, np.inf)
        apart = _apart(candidates, found) if most > 1 else np.arange(len(candidates))
        return candidates.only(apart).joined(found), np.concatenate([scores[apart], own])

    def _settle(self, lists: Sequence[PlaceList], most: int, to_beat: float) -> tuple[Candidates, FloatArray]:
        """The best of some places at their exact heights, with their scores; those that do not fit are left out."""
        item = lists[0].oriented.item if lists else ""
        cell = lists[0].oriented.cell_size if lists else 1.0
        pool = listed(lists, item, cell)
        if not len(pool):
            return pool, np.empty(0)
        scores = self.heuristic(pool, self.rng)
        order = np.argsort(scores, kind="stable")[: _MOST if most == 1 else min(most, _MOST) // 2]
        starts = np.cumsum([0, *(len(found.z) for found in lists)])
        settled: list[PlaceList] = []
        own: list[FloatArray] = []
        for at in range(0, len(order), _BATCH):
            batch = np.sort(order[at : at + _BATCH])
            if most == 1 and scores[order[at]] >= to_beat:
                break
            of_list = pool.grid_index[batch]
            new = [
                fit
                for k in np.unique(of_list)
                if (fit := lowered(lists[k].only(batch[of_list == k] - starts[k]))) is not None
            ]
            if new:
                own.append(self.heuristic(listed(new, item, cell), self.rng))
                to_beat = min(to_beat, float(own[-1].min()))
                settled += new
        return listed(settled, item, cell), np.concatenate(own or [np.empty(0)])


def lowered(places: PlaceList) -> PlaceList | None:
    """Those places at which the item fits by the meshes, at the heights to which it comes down."""
    surface = places.surface.source
    most = surface.container.height + CLEARANCE - float(places.oriented.extents[2])
    heights = []
    for x, y in places.places.tolist():
        oriented, ix, iy = surface.locate(places.oriented, x, y)
        heights.append(surface.lowest(oriented, ix, iy, surface.bound(oriented, ix, iy)))
    z = np.array(heights)
    fits = np.flatnonzero(z <= most)
    return PlaceList(places.oriented, places.surface, places.places[fits], z[fits]) if len(fits) else None


def _near(
    candidates: Candidates, scores: FloatArray, surface: PolyphaseMap, step: int
) -> Iterator[PlaceList]:
    """Every cell around the best candidates of a grid, these included."""
    if not len(candidates):
        return
    best = ranked(scores, _NEAR)
    around = np.arange(1 - step, step)
    offsets = np.stack(np.meshgrid(around, around, indexing="ij"), axis=-1).reshape(-1, 2)
    for k in np.unique(candidates.grid_index[best]):
        oriented, chosen = candidates.grids[k].oriented, best[candidates.grid_index[best] == k]
        cells = np.stack([candidates.ix[chosen], candidates.iy[chosen]], axis=1)[:, None] + offsets
        cells = np.unique(cells.reshape(-1, 2), axis=0)
        places = cells * candidates.cell_size
        last = np.maximum(surface.source.container.size[:2] - oriented.extents[:2], 0.0) + ROUNDING
        inside = (cells >= 0).all(axis=1) & (places <= last).all(axis=1)
        yield from _estimated(oriented, surface, places[inside], whole=True)


def _flush(surface: PolyphaseMap, orientations: Sequence[OrientedItem]) -> Iterator[PlaceList]:
    """Where sides of an item lie against walls, or against sides of placed items."""
    source = surface.source
    sides = np.empty((0, 4)) if source.exact is None else source.exact.sides
    room = np.empty(((2 * len(sides) + 2) ** 2 + len(sides), 2))
    length, width, _ = source.container.size
    for oriented in orientations:
        ex, ey, ez = oriented.extents.tolist()
        if ex > length + CLEARANCE or ey > width + CLEARANCE or ez > source.container.height + CLEARANCE:
            continue
        count = kernels.flush_places(sides, length, width, ex, ey, CLEARANCE - ROUNDING, room)
        x, y = np.rint(room[:count] * 1e6).astype(np.int64).T
        _, first = np.unique(place_code(np.zeros_like(x), x, y), return_index=True)
        yield from _estimated(oriented, surface, room[:count][first], whole=False)


def _estimated(
    oriented: OrientedItem, surface: PolyphaseMap, places: FloatArray, *, whole: bool
) -> Iterator[PlaceList]:
    """Those places that are worth a look, at the heights that the maps tell."""
    source, z = surface.source, np.empty(len(places))
    most = source.container.height - float(oriented.extents[2]) + _REACH
    ex, ey = oriented.extents[:2].tolist()
    kernels.heights_at(source.heights, oriented.bottom, source.cell_size, ex, ey, places, whole, most, z)
    fits = np.flatnonzero(np.isfinite(z))
    if len(fits):
        yield PlaceList(oriented, surface, places[fits], z[fits])


def _as_lists(candidates: Candidates, chosen: IntArray, surface: PolyphaseMap) -> list[PlaceList]:
    """Some candidates of a grid as places."""
    corners = candidates.corners
    found = []
    for k in np.unique(candidates.grid_index[chosen]):
        own = chosen[candidates.grid_index[chosen] == k]
        found.append(PlaceList(candidates.grids[k].oriented, surface, corners[own, :2], corners[own, 2]))
    return found


def _apart(candidates: Candidates, others: Candidates) -> IntArray:
    """Indices of the candidates that are not among others."""
    numbers: dict[bytes, int] = {}
    return np.flatnonzero(~np.isin(place_codes(candidates, numbers), place_codes(others, numbers)))
