"""Whether an item can be lowered straight down into its place past an item that is there already.

The *sweep* of an item is the item together with everything straight above it: exactly the space that it
passes through when it comes down from above the rim. The item can be inserted past another one if and only
if its sweep and the other item share no more than touching (the clearance of
:mod:`packenv.geometry.collision`).

The sweep's boundary is made of the down-facing triangles and, over each edge where these end, an upright
quad. A point is in the sweep if and only if a down-facing triangle is straight below it. So: the sweep meets
a solid if and only if these triangles meet the solid's, or a body of it has a down-facing triangle below.

Only triangles that could take part are handed to FCL. They are found by coarse columns: in each, the
lowest down-facing triangle against the highest triangle of the other solid, both by bounding boxes. That
drops nothing that matters (bounds are outward), and it keeps the hierarchies, whose building costs far more
than their use, to the few triangles where items really interlock.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from packenv.geometry.collision import (
    IDENTITY,
    Posed,
    Solid,
    Surface,
    contact_directions,
    surfaces_meet,
)
from packenv.types import BoolArray, FloatArray, IntArray

_COLUMNS = 48
_BEYOND = 1.0 + 1e-6


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Axis-aligned bounding boxes of triangles.

    Attributes:
        low: (n, 3) m.
        high: (n, 3) m.
    """

    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, vertices: FloatArray, parts: IntArray) -> _Boxes:
        """Boxes of faces (n, 3) or edges (n, 2)."""
        low = high = vertices[parts[:, 0]]
        for column in range(1, parts.shape[1]):
            corner = vertices[parts[:, column]]
            low, high = np.minimum(low, corner), np.maximum(high, corner)
        return cls(low, high)


class Sweep:
    """A posed solid and everything straight above it, container frame.

    Attributes:
        vertices: (n, 3) m.
        floor: (f, 3) vertex indices of the down-facing triangles.
        rim: (e, 2) vertex indices of the edges where these end.
        bounds: (2, 3) of the exact solid without what is above it, m.
    """

    def __init__(self, posed: Posed, shrunk: bool) -> None:
        """Find the down-facing triangles and where they end.

        Args:
            posed: the solid that is lowered.
            shrunk: take the surface drawn inwards by half the clearance.
        """
        faces = posed.solid.faces
        self.bounds = posed.bounds
        self.vertices = posed.pose.apply(posed.solid.points(shrunk))
        a, b, c = (self.vertices[faces[:, i], :2] for i in range(3))
        ab, ac = b - a, c - a
        down = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0] < 0.0
        self.floor: IntArray = faces[down]
        self.rim = self._open_edges(posed.solid, down)

    @staticmethod
    def _open_edges(solid: Solid, down: BoolArray) -> IntArray:
        """(e, 2) edges of down-facing triangles whose neighbour across the edge does not face down.

        An edge without exactly one neighbour counts as open. Should it not be, its quad is inside the sweep:
        it can only be met where the sweep is met.
        """
        across = solid.neighbours
        is_open = down[:, None] & ((across < 0) | ~down[across])
        face, corner = np.nonzero(is_open)
        return np.stack([solid.faces[face, corner], solid.faces[face, (corner + 1) % 3]], axis=1)

    @cached_property
    def floor_boxes(self) -> _Boxes:
        """Bounding boxes of the down-facing triangles."""
        return _Boxes.of(self.vertices, self.floor)

    @cached_property
    def rim_boxes(self) -> _Boxes:
        """Bounding boxes of the edges where the down-facing triangles end."""
        return _Boxes.of(self.vertices, self.rim)


class Insertion:
    """The straight way down of one solid, to be tested against each solid that is there already."""

    def __init__(self, posed: Posed) -> None:
        """Keep the solid at the end of its way."""
        self.posed = posed

    @cached_property
    def _shrunk(self) -> Sweep:
        return Sweep(self.posed, shrunk=True)

    @cached_property
    def _exact(self) -> Sweep:
        return Sweep(self.posed, shrunk=False)

    def meets(self, other: Obstacle) -> bool:
        """Whether the way down meets ``other`` by more than touching."""
        clearance = self.posed.solid.clearance
        # A direction that does not point down and has all of the other solid behind all of this one: the
        # whole sweep is then on the far side too, after a move by at most the clearance.
        if float((other.posed.span[1] - self.posed.span[0]).min()) <= clearance:
            return False
        margin = 2.0 * clearance
        local = localise(self._shrunk, other, shrunk=False, margin=margin)
        if local is None or not local.meets():
            return False
        local = localise(self._shrunk, other, shrunk=True, margin=margin)
        if local is None or not local.meets():
            return False
        local = localise(self._exact, other, shrunk=False, margin=margin)
        if local is None:
            return False
        return all(local.meets(clearance * _BEYOND * direction) for direction in local.directions())


class Obstacle:
    """A posed solid as something to come down past, with its triangles' boxes worked out once."""

    def __init__(self, posed: Posed) -> None:
        """Keep the solid."""
        self.posed = posed

    @cached_property
    def _exact(self) -> tuple[FloatArray, _Boxes]:
        return self._placed(shrunk=False)

    @cached_property
    def _shrunk(self) -> tuple[FloatArray, _Boxes]:
        return self._placed(shrunk=True)

    def _placed(self, shrunk: bool) -> tuple[FloatArray, _Boxes]:
        vertices = self.posed.pose.apply(self.posed.solid.points(shrunk))
        return vertices, _Boxes.of(vertices, self.posed.solid.faces)

    def placed(self, shrunk: bool) -> tuple[FloatArray, _Boxes]:
        """Vertices (n, 3) in the container frame, m, and the boxes of all faces."""
        return self._shrunk if shrunk else self._exact


@dataclass(frozen=True, eq=False)
class Local:
    """The parts of a sweep and of a solid that can meet, container frame.

    Attributes:
        floor: (f, 3, 3) corners of the sweep's down-facing triangles that count, m.
        walls: the same and the upright quads, as FCL sees them.
        solid: the solid's triangles that count.
        points: (n, 3) vertices that stand for the solid's bodies, m.
    """

    floor: FloatArray
    walls: Surface
    solid: Surface
    points: FloatArray

    def meets(self, offset: FloatArray | None = None) -> bool:
        """Whether the sweep, moved by ``offset`` (3,), meets the solid."""
        pose = IDENTITY if offset is None else IDENTITY.moved(offset)
        if surfaces_meet(self.walls, pose, self.solid, IDENTITY):
            return True
        points = self.points if offset is None else self.points - offset
        return any(_is_above(self.floor, point) for point in points)

    def directions(self) -> FloatArray:
        """(n, 3) unit directions, none downward, in which a small move of the sweep may end contact."""
        met = contact_directions(self.solid, IDENTITY, self.walls, IDENTITY)
        axes = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=float)
        directions = np.concatenate([met, axes])
        upward: FloatArray = directions[directions[:, 2] >= 0.0]
        return upward


def _is_above(floor: FloatArray, point: FloatArray) -> bool:
    """Whether a triangle of ``floor`` (f, 3, 3), all facing down, is straight below ``point`` or at it."""
    a, b, c = (floor[:, i] - point for i in range(3))
    # Twice the signed areas of the triangles that the point makes with the edges, seen from above: all
    # have the triangle's own sign (negative: it faces down) where the point is over it.
    areas = np.stack([p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b))], axis=1)
    over = np.all(areas <= 0.0, axis=1) & (areas.sum(axis=1) < 0.0)
    if not over.any():
        return False
    weights = areas[over] / areas[over].sum(axis=1, keepdims=True)
    heights = np.stack([a[over, 2], b[over, 2], c[over, 2]], axis=1)
    return bool(np.any(np.einsum("ij,ij->i", weights, heights) <= 0.0))


class _Columns:
    """A coarse grid of upright columns over a rectangle, for outward bounds.

    Attributes:
        low: (2,) corner, m.
        high: (2,) opposite corner, m.
        margin: by which every box is grown sideways, m.
    """

    def __init__(self, low: FloatArray, high: FloatArray, margin: float) -> None:
        """Divide the longer side into 48 cells, the other to match."""
        self.low, self.high, self.margin = low, high, margin
        self._cell = max(float((high - low).max()) / _COLUMNS, 1e-9)
        self.shape = np.maximum(np.ceil((high - low) / self._cell).astype(np.int64), 1)

    def touched(self, boxes: _Boxes) -> tuple[IntArray, IntArray, IntArray]:
        """The boxes over the rectangle, and the columns that each of them touches.

        Returns:
            Their indices (k,); and one row for each pair of box and column: the pair's column (p,), and
            where in the list each box's pairs begin (k,).
        """
        low, high = self.low - self.margin, self.high + self.margin
        near = np.flatnonzero(
            (boxes.high[:, 0] >= low[0])
            & (boxes.low[:, 0] <= high[0])
            & (boxes.high[:, 1] >= low[1])
            & (boxes.low[:, 1] <= high[1])
        )
        last = self.shape - 1
        first_cell = np.clip(self._cells(boxes.low[near, :2] - self.margin), 0, last)
        last_cell = np.clip(self._cells(boxes.high[near, :2] + self.margin), 0, last)
        spans = last_cell - first_cell + 1
        counts = spans[:, 0] * spans[:, 1]
        begins = np.concatenate([[0], np.cumsum(counts)[:-1]]) if len(near) else counts
        within = np.arange(int(counts.sum())) - np.repeat(begins, counts)
        width = np.repeat(spans[:, 1], counts)
        ix = np.repeat(first_cell[:, 0], counts) + within // width
        iy = np.repeat(first_cell[:, 1], counts) + within % width
        return near, ix * self.shape[1] + iy, begins

    def _cells(self, points: FloatArray) -> IntArray:
        return np.floor((points - self.low) / self._cell).astype(np.int64)


def localise(sweep: Sweep, other: Obstacle, shrunk: bool, margin: float) -> Local | None:
    """The parts of both that can meet after a move of at most ``margin``; None where none can."""
    vertices, boxes = other.placed(shrunk)
    (a_low, a_high), (b_low, b_high) = sweep.bounds, other.posed.bounds
    low, high = np.maximum(a_low, b_low)[:2], np.minimum(a_high, b_high)[:2]
    if np.any(low > high + margin):
        return None
    low, high = np.minimum(low, high), np.maximum(low, high)
    columns = _Columns(low, high, margin)

    solid, solid_columns, solid_begins = columns.touched(boxes)
    floor, floor_columns, floor_begins = columns.touched(sweep.floor_boxes)
    top = np.full(int(columns.shape.prod()), -np.inf)
    bottom = np.full_like(top, np.inf)
    solid_high = boxes.high[solid, 2] + margin
    floor_low = sweep.floor_boxes.low[floor, 2] - margin
    np.maximum.at(top, solid_columns, _per_pair(solid_high, solid_begins, len(solid_columns)))
    np.minimum.at(bottom, floor_columns, _per_pair(floor_low, floor_begins, len(floor_columns)))
    if not np.any(top > bottom):
        return None

    solid = solid[_any_pair(bottom[solid_columns], solid_begins, np.minimum) < solid_high]
    floor = floor[_any_pair(top[floor_columns], floor_begins, np.maximum) > floor_low]
    rim, rim_columns, rim_begins = columns.touched(sweep.rim_boxes)
    rim_low = sweep.rim_boxes.low[rim, 2] - margin
    rim = rim[_any_pair(top[rim_columns], rim_begins, np.maximum) > rim_low]
    if len(solid) == 0 or len(floor) + len(rim) == 0:
        return None

    above = float(max(a_high[2], b_high[2])) + 0.01
    faces = other.posed.solid.faces
    return Local(
        floor=sweep.vertices[sweep.floor[floor]],
        walls=_walls(sweep, floor, rim, above),
        solid=_compact(vertices, faces[solid]),
        points=vertices[other.posed.solid.bodies.reshape(-1)],
    )


def _per_pair(values: FloatArray, begins: IntArray, n_pairs: int) -> FloatArray:
    """Each box's value once for each of its columns."""
    repeated: FloatArray = np.repeat(values, np.diff(np.append(begins, n_pairs)))
    return repeated


def _any_pair(values: FloatArray, begins: IntArray, reduce: np.ufunc) -> FloatArray:
    """The reduction of each box's columns; every box touches at least one."""
    if len(begins) == 0:
        return np.zeros(0)
    reduced: FloatArray = reduce.reduceat(values, begins)
    return reduced


def _compact(vertices: FloatArray, faces: IntArray) -> Surface:
    """A surface of some faces that keeps only the vertices they use."""
    used, inverse = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], inverse.reshape(-1, 3))


def _walls(sweep: Sweep, floor: IntArray, rim: IntArray, above: float) -> Surface:
    """The chosen down-facing triangles and the upright quads over the chosen edges, up to z = ``above``."""
    faces, edges = sweep.floor[floor], sweep.rim[rim]
    used, inverse = np.unique(np.concatenate([faces.reshape(-1), edges.reshape(-1)]), return_inverse=True)
    faces = inverse[: faces.size].reshape(-1, 3)
    low = inverse[faces.size :].reshape(-1, 2)
    high = low + len(used)
    raised = sweep.vertices[used].copy()
    raised[:, 2] = above
    quads = np.concatenate(
        [
            np.stack([low[:, 0], low[:, 1], high[:, 1]], axis=1),
            np.stack([low[:, 0], high[:, 1], high[:, 0]], axis=1),
        ]
    )
    return Surface(np.concatenate([sweep.vertices[used], raised]), np.concatenate([faces, quads]))
