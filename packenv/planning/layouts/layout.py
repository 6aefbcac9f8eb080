"""All pieces of an order in a box at once, overlaps allowed: what separation and guided local search work on."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from packenv.geometry.run_kernels import shared_with_each
from packenv.geometry.run_table import RunTable
from packenv.geometry.voxels import Voxels, voxelize, voxels_across
from packenv.types import BoolArray, Container, IntArray, Item, OrientedItem

VOXELS = 480_000
"""About so many voxels a box is divided into: of 4 mm in the paper's box."""

_STEP = 5e-4
"""The pitch is a multiple of this, m: items of whole millimetres then fill their voxels."""

_KNOWN: WeakKeyDictionary[OrientedItem, dict[float, Voxels]] = WeakKeyDictionary()
"""Voxels of orientations, which plan after plan asks for: as long as the orientation lives."""


def pitch_for(container: Container) -> float:
    """Side of a voxel for a container, m."""
    return max(math.ceil(math.cbrt(container.volume / VOXELS) / _STEP - 1e-6), 1) * _STEP


class Arranged(Protocol):
    """One piece of an arrangement, which has one orientation or more."""

    @property
    def orientations(self) -> Sequence[object]:
        """What is known of each orientation; their number counts."""
        ...

    def voxels(self, kind: int, pitch: float) -> Voxels:
        """The piece at one of its orientations."""
        ...


@dataclass(frozen=True, eq=False)
class Movable:
    """One piece and the orientations that it may have; they are voxelized when they are first asked for.

    Attributes:
        item: the item.
        orientations: those at which it fits the box, at least one.
    """

    item: Item
    orientations: Sequence[OrientedItem]

    def voxels(self, kind: int, pitch: float) -> Voxels:
        """The piece at one of its orientations."""
        oriented = self.orientations[kind]
        known = _KNOWN.setdefault(oriented, {})
        if pitch not in known:
            known[pitch] = voxelize(self.item, oriented.rotation, pitch)
        return known[pitch]


@dataclass(frozen=True, eq=False)
class Layout:
    """Where every piece is.

    Attributes:
        kinds: (n,) the orientation of each.
        at: (n, 3) the voxel at which each begins.
        overlap: voxels that pairs share, summed over all pairs.
    """

    kinds: IntArray
    at: IntArray
    overlap: int


WillDo: TypeAlias = "Callable[[Arrangement], bool]"
"""Whether the layout that an arrangement has is what is looked for."""


@dataclass(eq=False)
class Arrangement:
    """Pieces at places that change, and how much each pair overlaps.

    What cannot be moved is one piece more, the last of the matrix.

    Attributes:
        pieces: what is arranged.
        size: of the box, m.
        pitch: side of a voxel, m.
        fixed: (nx, ny, nz) bool, voxels that are taken already; None where there are none.
        runs: the voxels of the pieces as runs; another arrangement's may be given.
        shape: voxels of the box along x, y and z.
        kinds: (n,) the orientation of each piece; -1 while it is nowhere.
        at: (n, 3) the voxel at which each begins.
        overlaps: (n + 1, n + 1) voxels that each pair shares; the diagonal is 0.
        below: (n + 1, n + 1) whether one piece, by row, must have nothing straight above another one, by column;
            what it has there counts as overlap.
    """

    pieces: Sequence[Arranged]
    size: tuple[float, float, float]
    pitch: float
    fixed: BoolArray | None = None
    runs: RunTable = field(default_factory=RunTable)
    shape: tuple[int, int, int] = field(init=False)
    kinds: IntArray = field(init=False)
    at: IntArray = field(init=False)
    overlaps: IntArray = field(init=False)
    below: BoolArray = field(init=False)
    _numbers: IntArray = field(init=False)
    _fixed: Voxels | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        n = len(self.pieces)
        self.shape = voxels_across(self.size, self.pitch)
        self.kinds, self.at = np.full(n, -1, dtype=np.int64), np.zeros((n, 3), dtype=np.int64)
        self.overlaps = np.zeros((n + 1, n + 1), dtype=np.int64)
        self.below = np.zeros((n + 1, n + 1), dtype=np.bool_)
        most = max((len(piece.orientations) for piece in self.pieces), default=0)
        self._numbers = np.full((n, most, 4), -1, dtype=np.int64)

    @property
    def layout(self) -> Layout:
        """Where every piece is now."""
        return Layout(self.kinds.copy(), self.at.copy(), self.overlap)

    @property
    def overlap(self) -> int:
        """Voxels that pairs share, summed over all pairs."""
        return int(self.overlaps.sum()) // 2

    @property
    def colliding(self) -> IntArray:
        """Numbers of the pieces that overlap something, ascending."""
        return np.flatnonzero(self.overlaps[:-1].any(axis=1))

    def voxels(self, piece: int, kind: int | None = None) -> Voxels:
        """A piece at an orientation; None takes the one that it has."""
        kind = int(self.kinds[piece]) if kind is None else kind
        return self.pieces[piece].voxels(kind, self.pitch).within(self.shape)

    def places(self, piece: int, kind: int) -> tuple[int, int, int]:
        """Number of places of a piece at an orientation along x, y and z."""
        return self.pieces[piece].voxels(kind, self.pitch).places(self.size)

    def shape_of(self, piece: int, kind: int, sides: int = 0) -> int:
        """Number of the shape that a piece has at an orientation; sides: 1 with what is above, 2 with what is below."""
        found = int(self._numbers[piece, kind, sides])
        if found < 0:
            found = self.runs.of(self.voxels(piece, kind), bool(sides & 1), bool(sides & 2))
            self._numbers[piece, kind, sides] = found
        return found

    def others(self, piece: int) -> tuple[IntArray, IntArray, IntArray]:
        """Numbers (m,), shapes (m,) and places (m, 3) of all other pieces that are somewhere, and of what is fixed.

        A piece that must be below another one, or above it, finds taken what is straight above that one, or below.
        """
        there = self.kinds >= 0
        there[piece] = False
        others = np.flatnonzero(there)
        kinds = self.kinds[others]
        sides = self.below[piece, others] + 2 * self.below[others, piece]
        shapes, at = self._numbers[others, kinds, sides], self.at[others]
        for k in np.flatnonzero(shapes < 0).tolist():
            shapes[k] = self.shape_of(int(others[k]), int(kinds[k]), int(sides[k]))
        if self.fixed is None:
            return others, shapes, at
        if self._fixed is None:
            self._fixed = Voxels(self.fixed, np.multiply(self.shape, self.pitch), self.pitch)
        number = self.runs.of(self._fixed)
        return (
            np.append(others, len(self.pieces)),
            np.append(shapes, number),
            np.vstack([at, np.zeros((1, 3), int)]),
        )

    def keep_below(self, pairs: BoolArray) -> None:
        """Have pieces, by row, below others, by column, from now on: see :attr:`below`."""
        self.below |= pairs
        for piece in np.flatnonzero(pairs[:-1].any(axis=1)).tolist():
            self.move(piece, int(self.kinds[piece]), self.at[piece])

    def move(self, piece: int, kind: int, at: Sequence[int] | IntArray) -> None:
        """Put a piece somewhere."""
        self.kinds[piece], self.at[piece] = kind, at
        row = np.zeros(len(self.pieces) + 1, dtype=np.int64)
        own, (others, shapes, places) = self.shape_of(piece, kind), self.others(piece)
        counts = np.empty(len(others), dtype=np.int64)
        shared_with_each(*self.runs.arrays, own, self.at[piece], shapes, places, counts)
        row[others] = counts
        self.overlaps[piece] = self.overlaps[:, piece] = row

    def restore(self, layout: Layout) -> None:
        """Put every piece where it was."""
        changed = (self.kinds != layout.kinds) | (self.at != layout.at).any(axis=1)
        self.kinds, self.at = layout.kinds.copy(), layout.at.copy()
        for piece in np.flatnonzero(changed).tolist():
            self.move(piece, int(self.kinds[piece]), self.at[piece])

    def exchange(self, a: int, b: int) -> None:
        """Put two pieces about where the other one is, inside the box."""
        middles = [self.at[p] + np.array(self.voxels(p).grid.shape) // 2 for p in (b, a)]
        for piece, middle in zip((a, b), middles, strict=True):
            kind = int(self.kinds[piece])
            self.move(piece, kind, self.about(piece, kind, middle))

    def about(self, piece: int, kind: int, middle: IntArray) -> IntArray:
        """(3,) where a piece at an orientation begins if a voxel (3,) is its middle, pushed into the box."""
        begin = middle - np.array(self.voxels(piece, kind).grid.shape) // 2
        inside: IntArray = np.clip(begin, 0, np.array(self.places(piece, kind)) - 1)
        return inside


def without_overlap(arrangement: Arrangement) -> bool:
    """Whether nothing overlaps."""
    return arrangement.overlap == 0
