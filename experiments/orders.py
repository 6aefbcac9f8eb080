"""Random orders for measurements: items that fit the container alone, drawn with a seed.

The first orders of a longer draw are those of a shorter one, so a run can be made longer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from packenv.config import GridConfig
from packenv.errors import InputError, closest_match
from packenv.geometry.prepare import PreparedItem
from packenv.planning.search.candidates import grid_search
from packenv.planning.search.container_map import ContainerMap
from packenv.types import Container

SECOND_HALF = "second-half"
"""Stands for every second item by name."""


def fitting(items: Mapping[str, PreparedItem], container: Container, grid: GridConfig) -> list[str]:
    """Names of the items that have a legal candidate in the empty container."""
    empty = ContainerMap.empty(container, grid.cell_size)
    return [
        name for name, item in items.items() if len(grid_search(empty, item.orientations, grid.step_cells))
    ]


def random_orders(names: Sequence[str], size: int, count: int, seed: int) -> list[list[str]]:
    """``count`` orders of ``size`` different items each; the same seed gives the same orders."""
    rng = np.random.default_rng([seed, size])
    return [[str(n) for n in rng.choice(names, size, replace=size > len(names))] for _ in range(count)]


def small_orders(names: Sequence[str], count: int, seed: int) -> list[list[str]]:
    """``count`` orders of three to five different items each, as the paper's small ones (Sec. V)."""
    rng = np.random.default_rng([seed, 5])
    sizes = (int(rng.integers(3, 6)) for _ in range(count))
    return [[str(n) for n in rng.choice(names, size, replace=size > len(names))] for size in sizes]


def unseen_items(names: Sequence[str], unseen: str) -> list[str]:
    """Items that nothing was tuned on, by name.

    Args:
        names: of all items.
        unseen: ``second-half``: every second one, on which no rule of ``auto`` was chosen (docs/decisions.md); or a
            file of names, one a line.

    Raises:
        InputError: there is no such file, or it has a name that is none of these.
    """
    if unseen == SECOND_HALF:
        return sorted(names)[1::2]
    try:
        text = Path(unseen).read_text(encoding="utf-8")
    except (OSError, UnicodeError):
        raise InputError(
            f"--unseen {unseen}: cannot be read, give {SECOND_HALF} or a file of names"
        ) from None
    chosen = [entry.strip() for entry in text.splitlines() if entry.strip()]
    for name in chosen:
        if name not in names:
            hint = closest_match(name, names, "; give names of the catalogue, one a line")
            raise InputError(f"--unseen {unseen}: there is no item {name!r:.60}{hint}")
    if not chosen:
        raise InputError(f"--unseen {unseen}: is empty, give names of the catalogue, one a line")
    return sorted(set(chosen))
