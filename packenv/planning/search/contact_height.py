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
        entries: indices of faces.
    """

    corners: FloatArray
    planes: FloatArray
    boxes: FloatArray
    first: tuple[int, int]
    shape: tuple[int, int]
    starts: IntArray
    entries: IntArray


@dataclass(frozen=True, eq=False)
class ExactPile:
    """The meshes of what a container holds, and of what may come.

    Attributes:
        shapes: every item of the order by name, of the geometry that is planned with.
        faces: upper faces of the placed ones.
    """

    shapes: Mapping[str, Item]
    faces: tuple[FacesByCell, ...] = ()
    _lower: WeakKeyDictionary[OrientedItem, FacesByCell] = field(
        default_factory=WeakKeyDictionary, repr=False
    )
    _known: dict[tuple[bytes, int, int], float] = field(default_factory=dict, repr=False)

    def lowest(self, heights: Float32Array, oriented: OrientedItem, ix: int, iy: int) -> float:
        """As :func:`contact_height`, each place once."""
        place = (oriented.rotation.tobytes(), ix, iy)
        found = self._known.get(place)
        if found is None:
            faces = self._lower.get(oriented)
            if faces is None:
                faces = self._lower[oriented] = lower_faces(self.shapes[oriented.item], oriented)
            found = self._known[place] = contact_height(heights, oriented, faces, ix, iy, self.faces)
        return found

    def with_item(self, oriented: OrientedItem, ix: int, iy: int, z: float) -> ExactPile:
        """The pile with one more item, its bounding box's corner at whole cells and this height, m."""
        cell = oriented.cell_size
        position = oriented.offset + np.array([ix * cell, iy * cell, z])
        placed = upper_faces(self.shapes[oriented.item], oriented.rotation, position, cell)
        return replace(self, faces=(*self.faces, placed), _known={})


def lower_faces(item: Item, oriented: OrientedItem) -> FacesByCell:
    """The faces of an item that look down, in its oriented frame.

    Args:
        item: the item.
        oriented: its orientation, whose cells are meant.
    """
    points = item.vertices @ oriented.rotation.T + oriented.offset
    corners = _facing(points, item.faces, down=True)
    return _by_cell(corners, oriented.cell_size, (0, 0), oriented.bottom.shape)


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
    return _by_cell(_facing(points, item.faces, down=False), cell_size, (ix, iy), shape)


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
        faces: its lower faces.
        ix: cell of its smallest x.
        iy: cell of its smallest y.
        pile: upper faces of what lies in the container.

    Returns:
        m, a multiple of the height quantum and no more than what the heightmaps say.
    """
    cell = oriented.cell_size
    corner = np.array([ix * cell, iy * cell])
    window = np.concatenate([corner + SIDE, corner + oriented.extents[:2] - SIDE])
    best = 0.0
    for placed in pile:
        best = kernels.contact_height(
            heights,
            oriented.bottom,
            ix,
            iy,
            cell,
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
            *placed.first,
            *placed.shape,
            best,
        )
    return math.ceil((best + _ABOVE) / HEIGHT_QUANTUM) * HEIGHT_QUANTUM if best > 0.0 else 0.0


def _facing(points: FloatArray, faces: IntArray, *, down: bool) -> FloatArray:
    """(m, 3, 3) corners of the faces that look down, or up; upright ones are neither."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    sides = [np.hypot(*(q - p)[:, :2].T) for p, q in ((a, b), (b, c), (c, a))]
    wide = np.abs(area) > kernels.THINNEST * np.maximum.reduce(sides)
    chosen = wide & ((area < 0.0) if down else (area > 0.0))
    return np.ascontiguousarray(np.stack([a, b, c], axis=1)[chosen])


def _by_cell(corners: FloatArray, cell: float, first: tuple[int, int], shape: tuple[int, int]) -> FacesByCell:
    origin = np.array([first[0] * cell, first[1] * cell, 0.0])
    starts = np.empty(shape[0] * shape[1] + 1, dtype=np.int64)
    local = corners - origin
    count = kernels.cells_of_faces(local, cell, *shape, starts, np.empty(0, dtype=np.int32))
    entries = np.empty(count, dtype=np.int32)
    if count:
        kernels.cells_of_faces(local, cell, *shape, starts, entries)
    planes, boxes = np.empty((len(corners), 3)), np.empty((len(corners), 6))
    kernels.planes_and_boxes(corners, planes, boxes)
    return FacesByCell(corners, planes, boxes, first, shape, starts, entries)
