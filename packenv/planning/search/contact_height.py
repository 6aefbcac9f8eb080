"""How low an item comes, straight down, before its surface meets the pile's: the mesh's answer, not the map's.

Heightmaps hold the extremes of whole cells. On slopes those are off by up to the slope times two cells: three nested
bowls stand 17 mm apart instead of 11. So the maps bound where surfaces may meet, and the faces decide.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np

from packenv.config import HEIGHT_QUANTUM
from packenv.planning.search import contact_height_kernels as kernels
from packenv.types import Float32Array, FloatArray, IntArray, Item, OrientedItem

SIDE = 5e-6
"""Faces that reach less than this over an item's side, seen from above, do not hold it, m: flush items may be off by
rounding, and the audit takes four times as much for touching."""

_ABOVE = 1e-7
"""Kept between the surfaces, m: a hundred times the rounding of the search."""


@dataclass(frozen=True, eq=False)
class FacesByCell:
    """Those faces of an item that look up, or down, listed by the cells that they touch.

    Attributes:
        corners: (m, 3, 3) m.
        planes: (m, 3) z = p0 + p1 x + p2 y on each.
        boxes: (m, 6) smallest x, y, z and largest x, y, z of each, m.
        first: (ix, iy) of the first cell that has a list.
        shape: number of cells along x and y that have one.
        starts: (cells + 1,) where each cell's faces begin in ``entries``.
        entries: indices of faces: in each cell the lowest first of those that look down, else the highest.
        first_keys: (cells,) height of the first one, minus that where they look up, m; infinite without any.
        highest: largest height of all, m.
    """

    corners: FloatArray
    planes: FloatArray
    boxes: FloatArray
    first: tuple[int, int]
    shape: tuple[int, int]
    starts: IntArray
    entries: IntArray
    first_keys: FloatArray
    highest: float

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        arrays = (self.corners, self.planes, self.boxes, self.starts, self.entries, self.first_keys)
        return sum(array.nbytes for array in arrays)


class _LowerFaces:
    """Lower faces of the orientations that were asked for last; plan after plan asks for the same ones."""

    def __init__(self, budget: int) -> None:
        self._budget = budget
        self._bytes = 0
        self._kept: WeakKeyDictionary[OrientedItem, tuple[Item, FacesByCell]] = WeakKeyDictionary()

    def of(self, item: Item, oriented: OrientedItem) -> FacesByCell:
        """Those of an item at an orientation, made where they are not kept."""
        known = self._kept.get(oriented)
        if known is not None and known[0].vertices is item.vertices:
            return known[1]
        faces = lower_faces(item, oriented)
        self._bytes += faces.nbytes
        if self._bytes > self._budget:
            self._kept.clear()
            self._bytes = faces.nbytes
        self._kept[oriented] = item, faces
        return faces


_RECENT = _LowerFaces(2**29)
"""Those of this process: half a gigabyte, some 400 orientations of scanned items."""


@dataclass(frozen=True, eq=False)
class ExactPile:
    """The meshes of what a container holds, and of what may come.

    Attributes:
        shapes: every item of the order by name, of the geometry that is planned with.
        faces: upper faces of the placed ones.
        sides: (n, 4) their smallest x, y and largest x, y, m.
    """

    shapes: Mapping[str, Item]
    faces: tuple[FacesByCell, ...] = ()
    sides: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    _known: dict[tuple[str, bytes, int, int, tuple[float, float]], float] = field(
        default_factory=dict, repr=False
    )

    def lowest(self, heights: Float32Array, oriented: OrientedItem, ix: int, iy: int) -> float:
        """As :func:`contact_height`, each place once."""
        place = (oriented.item, oriented.rotation.tobytes(), ix, iy, oriented.phase)
        found = self._known.get(place)
        if found is None:
            whole = oriented.whole or oriented
            faces = _RECENT.of(self.shapes[oriented.item], whole)
            low = np.array([ix, iy]) * oriented.cell_size + oriented.phase
            apart = (self.sides[:, :2] > low + oriented.extents[:2]) | (self.sides[:, 2:] < low)
            beneath = [self.faces[k] for k in np.flatnonzero(~apart.any(axis=1))]
            found = self._known[place] = contact_height(heights, oriented, faces, ix, iy, beneath)
        return found

    def with_item(self, oriented: OrientedItem, ix: int, iy: int, z: float) -> ExactPile:
        """The pile with one more item that begins in these cells and at this height, m."""
        cell, (dx, dy) = oriented.cell_size, oriented.phase
        corner = np.array([ix * cell + dx, iy * cell + dy, z])
        sides = np.concatenate([corner[:2], corner[:2] + oriented.extents[:2]])
        return self.with_mesh(
            self.shapes[oriented.item], oriented.rotation, oriented.offset + corner, cell, sides
        )

    def with_mesh(
        self, item: Item, rotation: FloatArray, position: FloatArray, cell_size: float, sides: FloatArray
    ) -> ExactPile:
        """The pile with one more item at any pose.

        Args:
            item: the item.
            rotation: (3, 3) mesh frame to container frame.
            position: (3,) m.
            cell_size: of the container's map, m.
            sides: (4,) its smallest x, y and largest x, y, m.
        """
        placed = upper_faces(item, rotation, position, cell_size)
        return replace(self, faces=(*self.faces, placed), sides=np.vstack([self.sides, sides]), _known={})


def lower_faces(item: Item, oriented: OrientedItem) -> FacesByCell:
    """The faces of an item that look down, in its oriented frame.

    Args:
        item: the item.
        oriented: its orientation, whose cells are meant.
    """
    points = item.vertices @ oriented.rotation.T + oriented.offset
    shape = (oriented.bottom.shape[0], oriented.bottom.shape[1])
    return _by_cell(points, item.faces, oriented.cell_size, (0, 0), shape, down=True, both=inside_out(item))


def upper_faces(item: Item, rotation: FloatArray, position: FloatArray, cell_size: float) -> FacesByCell:
    """The faces of a placed item that look up, in the container frame.

    Args:
        item: the item.
        rotation: (3, 3) mesh frame to container frame.
        position: (3,) m.
        cell_size: of the container's map, m.
    """
    points = item.vertices @ rotation.T + position
    low, high = points.min(axis=0), points.max(axis=0)
    ix, iy = math.floor(low[0] / cell_size), math.floor(low[1] / cell_size)
    shape = (math.floor(high[0] / cell_size) - ix + 1, math.floor(high[1] / cell_size) - iy + 1)
    return _by_cell(points, item.faces, cell_size, (ix, iy), shape, down=False, both=inside_out(item))


def contact_height(
    heights: Float32Array,
    oriented: OrientedItem,
    faces: FacesByCell,
    ix: int,
    iy: int,
    pile: Iterable[FacesByCell],
) -> float:
    """Least height of an item at which, coming straight down, it touches nothing and nothing below the floor.

    Args:
        heights: (nx, ny) conservative container heightmap of the pile, m.
        oriented: the item at its orientation.
        faces: its lower faces, by the cells of the item at the edge of its first cell.
        ix: cell of its smallest x.
        iy: cell of its smallest y.
        pile: upper faces of what lies in the container.

    Returns:
        m, a multiple of the height quantum and no more than what the heightmaps say.
    """
    cell = oriented.cell_size
    corner = np.array([ix * cell, iy * cell]) + oriented.phase
    window = np.concatenate([corner + SIDE, corner + oriented.extents[:2] - SIDE])
    best = 0.0
    # The highest first: what lies below is then mostly out at once.
    for placed in sorted(pile, key=lambda faces: -faces.highest):
        best = kernels.contact_height(
            heights,
            oriented.bottom,
            ix,
            iy,
            cell,
            *oriented.phase,
            *faces.shape,
            window,
            faces.corners,
            faces.planes,
            faces.boxes,
            faces.starts,
            faces.entries,
            placed.corners,
            placed.planes,
            placed.boxes,
            placed.starts,
            placed.entries,
            placed.first_keys,
            *placed.first,
            *placed.shape,
            best,
        )
    return math.ceil((best + _ABOVE) / HEIGHT_QUANTUM) * HEIGHT_QUANTUM if best > 0.0 else 0.0


def _by_cell(
    points: FloatArray,
    faces: IntArray,
    cell: float,
    first: tuple[int, int],
    shape: tuple[int, int],
    *,
    down: bool,
    both: bool,
) -> FacesByCell:
    corners, planes, boxes = _bounded(points, faces, _chosen(points, faces, down, both), down=down)
    starts = np.empty(shape[0] * shape[1] + 1, dtype=np.int64)
    origin = first[0] * cell, first[1] * cell
    entries = kernels.cells_of_faces(corners, boxes, *origin, cell, *shape, starts)
    keys = boxes[:, 2].copy() if down else -boxes[:, 5]
    first_keys = np.empty(shape[0] * shape[1])
    kernels.sort_cells(starts, entries, keys, first_keys)
    highest = float(boxes[:, 5].max(initial=-np.inf))
    return FacesByCell(corners, planes, boxes, first, shape, starts, entries, first_keys, highest)


def _chosen(points: FloatArray, faces: IntArray, down: bool, both: bool) -> IntArray:
    """Indices of the faces that look down, or up, or of both; upright ones are neither."""
    found = []
    for way in (down, not down) if both else (down,):
        chosen = np.empty(len(faces), np.int64)
        found.append(chosen[: kernels.facing(points, faces, way, chosen)])
    return np.concatenate(found)


def _bounded(
    points: FloatArray, faces: IntArray, chosen: IntArray, *, down: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    corners, planes, boxes = (np.empty((len(chosen), *own)) for own in ((3, 3), (3,), (6,)))
    kernels.bounds_of_faces(points, faces, chosen, down, corners, planes, boxes)
    return corners, planes, boxes


def inside_out(item: Item) -> bool:
    """Whether a part of an item's closed surface is inside out, as folds of scanned surfaces are.

    What is above all else there may look down. So no face is left out that looks the wrong way.
    """
    known = _INSIDE_OUT.get(item)
    if known is None:
        points, faces = item.vertices, item.faces
        up, down = (_chosen(points, faces, way, both=False) for way in (False, True))
        corners, planes, boxes = _bounded(points, faces, np.concatenate([up, down]), down=False)
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        cell = max(float(np.sqrt((high - low).prod() / max(len(faces), 1))), 1e-6)
        shape = (np.floor((high - low) / cell).astype(np.int64) + 1).tolist()
        starts = np.empty(shape[0] * shape[1] + 1, dtype=np.int64)
        entries = kernels.cells_of_faces(corners, boxes, *low.tolist(), cell, *shape, starts)
        looks_up = np.arange(len(corners)) < len(up)
        known = _INSIDE_OUT[item] = bool(
            kernels.has_inside_out(
                corners, planes, boxes, looks_up, starts, entries, cell, *low.tolist(), shape[1]
            )
        )
    return known


_INSIDE_OUT: WeakKeyDictionary[Item, bool] = WeakKeyDictionary()
"""What :func:`inside_out` said of the items that live."""
