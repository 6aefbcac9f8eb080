"""What a generator of orders is, and what it gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from packenv.limits import ItemLimits
from packenv.types import Container, Item, Placement, normal_name


@dataclass(frozen=True, eq=False)
class GeneratedOrder:
    """One order for one episode.

    Attributes:
        items: name of every piece, in the order's own sequence; a name as often as it is asked for.
        meshes: the items that are of no catalogue, by name.
        container: the box that the order was made for; None leaves the choice to the environment.
        solution: a perfect packing in packing sequence, one placement a piece; empty where none is known.
            No planner chose it, so its scores and numbers of candidates are 0.
        limits: of items by name, beside their own.
    """

    items: tuple[str, ...]
    meshes: Mapping[str, Item] = field(default_factory=dict)
    container: Container | None = None
    solution: tuple[Placement, ...] = ()
    limits: Mapping[str, ItemLimits] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Write the names as catalogues do; what is no name is told where orders are checked."""
        if isinstance(self.items, tuple) and all(isinstance(name, str) for name in self.items):
            object.__setattr__(self, "items", tuple(map(normal_name, self.items)))
        named = {normal_name(name): limits for name, limits in self.limits.items()}
        object.__setattr__(self, "limits", named)


class OrderGenerator(Protocol):
    """Makes orders. All chance comes from the given generator: the same seed, the same orders."""

    def generate(self, rng: np.random.Generator) -> GeneratedOrder:
        """Make the next order.

        Args:
            rng: where all random numbers come from.
        """
        ...
