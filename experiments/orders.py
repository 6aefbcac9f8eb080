"""Random orders for measurements: items that fit the container alone, drawn with a seed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from packenv.config import GridConfig
from packenv.geometry.prepare import PreparedItem
from packenv.planning.search.candidates import grid_search
from packenv.planning.search.container_map import ContainerMap
from packenv.types import Container


def fitting(items: Mapping[str, PreparedItem], container: Container, grid: GridConfig) -> list[str]:
    """Names of the items that have a legal candidate in the empty container."""
    empty = ContainerMap.empty(container, grid.cell_size)
    return [
        name for name, item in items.items() if len(grid_search(empty, item.orientations, grid.step_cells))
    ]


def random_orders(names: list[str], size: int, count: int, seed: int) -> list[list[str]]:
    """``count`` orders of ``size`` different items each; the same seed gives the same orders."""
    rng = np.random.default_rng([seed, size])
    return [[str(n) for n in rng.choice(names, size, replace=size > len(names))] for _ in range(count)]


def small_orders(names: list[str], count: int, seed: int) -> list[list[str]]:
    """``count`` orders of three to five different items each, as the paper's small ones (Sec. V)."""
    rng = np.random.default_rng([seed, 5])
    sizes = rng.integers(3, 6, count)
    return [[str(n) for n in rng.choice(names, size, replace=False)] for size in sizes]
