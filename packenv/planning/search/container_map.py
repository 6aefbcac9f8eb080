"""The container heightmap, and the polyphase form of it that the search reads."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from packenv.config import CLEARANCE, HEIGHT_QUANTUM
from packenv.geometry.heightmaps import at_phase
from packenv.planning.search import kernels
from packenv.planning.search.contact_height import ExactPile
from packenv.types import Container, Float32Array, FloatArray, OrientedItem

_NOISE = 1e-9
"""A container is this share of a cell over a whole cell by rounding (0.3 / 0.1), not by its size."""

ON_EDGE = 1e-6
"""What begins less than this behind the edge of a cell begins at the edge, m."""


def cells_across(size: tuple[float, ...], cell_size: float) -> tuple[int, int]:
    """Cells of a container's map along x and y: the last ones may reach beyond its walls."""
    x, y = (math.ceil(s / cell_size - _NOISE) for s in size[:2])
    return x, y


def _sub_grid(cells: int, step: int) -> int:
    """Cells of a polyphase sub-grid along one side, one margin cell at either end included."""
    return math.ceil(cells / step) + 2


@dataclass(frozen=True, eq=False)
class ContainerMap:
    """Top-down heightmap of a container and what is in it.

    Attributes:
        container: the box.
        cell_size: m.
        heights: (nx, ny) float32, m; the last cells may reach beyond the walls.
        exact: the meshes that it bounds; None where they are not known or not asked.
    """

    container: Container
    cell_size: float
    heights: Float32Array
    exact: ExactPile | None = None

    @classmethod
    def empty(cls, container: Container, cell_size: float, exact: ExactPile | None = None) -> ContainerMap:
        """The map of an empty container; with ``exact`` it keeps the meshes of what comes in."""
        heights = np.zeros(cells_across(container.size, cell_size), dtype=np.float32)
        return cls(container, cell_size, heights, exact)

    def lowest(self, oriented: OrientedItem, ix: int, iy: int, bound: float) -> float:
        """Height to which an item comes down: by the meshes where they are known.

        Args:
            oriented: the item at its orientation.
            ix: cell of its smallest x.
            iy: cell of its smallest y.
            bound: what the heightmaps say, m.
        """
        if self.exact is None or bound == 0.0:
            return bound
        return min(bound, self.exact.lowest(self.heights, oriented, ix, iy))

    def bound(self, oriented: OrientedItem, ix: int, iy: int) -> float:
        """Height at which an item is above everything by the heightmaps, m; it must be inside the map."""
        return float(kernels.lowest_at(self.heights, oriented.bottom, ix, iy))

    def cut(self, oriented: OrientedItem) -> OrientedItem:
        """An item as large as the container, without the cells beyond a wall that it reaches into by a hair.

        Any other item as it is.
        """
        return self.locate(oriented, 0.0, 0.0)[0]

    def locate(self, oriented: OrientedItem, x: float, y: float) -> tuple[OrientedItem, int, int]:
        """An item at any place as these cells see it.

        Args:
            oriented: the item at the edge of its first cell.
            x: its smallest x, m.
            y: its smallest y, m.

        Returns:
            the item with maps for its place within a cell, without cells beyond the walls, and the cells of its
            smallest x and y.
        """
        at, phase = [0, 0], [0.0, 0.0]
        for axis, value in enumerate((x, y)):
            at[axis] = math.floor((value + ON_EDGE) / self.cell_size)
            inside = value - at[axis] * self.cell_size
            phase[axis] = inside if inside > ON_EDGE else 0.0
        if any(phase):
            oriented = at_phase(oriented, (phase[0], phase[1]))
        rooms = [n - i for n, i in zip(self.heights.shape, at, strict=True)]
        beyond = np.add(at, oriented.top.shape) > self.heights.shape
        # Less than a hair is beyond a wall, or the place is none.
        far = np.add([x, y], oriented.extents[:2]) > np.add(
            self.container.size[:2], CLEARANCE + HEIGHT_QUANTUM
        )
        if beyond.any() and not far.any() and min(rooms) > 0:
            kept = tuple(slice(n) for n in rooms)
            oriented = replace(oriented, top=oriented.top[kept].copy(), bottom=oriented.bottom[kept].copy())
        return oriented, at[0], at[1]

    def with_item(self, oriented: OrientedItem, ix: int, iy: int, z: float) -> ContainerMap:
        """The map after an item is placed (paper Sec. IV-B, update rule, whose y + i is y + j).

        Args:
            oriented: the item at its orientation.
            ix: cell of its smallest x.
            iy: cell of its smallest y.
            z: height of its lowest point, m.
        """
        heights = self.heights.copy()
        w, h = oriented.top.shape
        window = heights[ix : ix + w, iy : iy + h]
        np.maximum(window, oriented.top + np.float32(z), out=window, where=oriented.footprint)
        exact = None if self.exact is None else self.exact.with_item(oriented, ix, iy, z)
        return ContainerMap(self.container, self.cell_size, heights, exact)

    def spread(self, cells: int) -> ContainerMap:
        """The map with every height spread over the square of ``cells`` cells around it, walls included.

        What lies over this map lies over the true one wherever it is moved by up to so many cells.
        """
        if cells == 0:
            return self
        wall = np.float32(self.container.height)
        padded = np.pad(self.heights, cells, constant_values=wall)
        n = 2 * cells + 1
        for axis in (0, 1):
            size = padded.shape[axis] - 2 * cells
            slices = [np.take(padded, range(k, k + size), axis=axis) for k in range(n)]
            padded = np.maximum.reduce(slices)
        return ContainerMap(self.container, self.cell_size, np.ascontiguousarray(padded))

    @cached_property
    def total(self) -> float:
        """Sum of all heights, m; exact."""
        return float(self.heights.sum(dtype=np.float64))


@dataclass(frozen=True, eq=False)
class PolyphaseMap:
    """A container heightmap stored by residue class of the grid step (see :mod:`.kernels`).

    Attributes:
        source: the map.
        step: cells between tried translations.
    """

    source: ContainerMap
    step: int

    @cached_property
    def rows(self) -> int:
        """Cells of a sub-grid along x, margin included."""
        return _sub_grid(self.source.heights.shape[0], self.step)

    @cached_property
    def stride(self) -> int:
        """Cells of a sub-grid along y, margin included."""
        return _sub_grid(self.source.heights.shape[1], self.step)

    @cached_property
    def heights(self) -> Float32Array:
        """(step² · rows · stride,) the heightmap in a margin of walls, m."""
        flat = np.empty(self.step**2 * self.rows * self.stride, dtype=np.float32)
        wall = np.float32(self.source.container.height)
        kernels.polyphase(self.source.heights, self.step, wall, flat, self.rows, self.stride)
        return flat

    @cached_property
    def prefix_sums(self) -> FloatArray:
        """(step² · rows · stride,) running sums of the rows along y, m."""
        flat = np.empty(self.step**2 * self.rows * self.stride)
        kernels.row_prefix_sums(self.source.heights, self.step, flat, self.rows, self.stride)
        return flat
