"""What the catalogue says of an item besides its shape, and the register of recipes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .solids import Parts

#: Full citation in assets/LICENSES.md.
YCB = "Calli et al. 2015 (YCB object table)"


@dataclass(frozen=True)
class Mass:
    """How an item's mass is known; exactly one of the three ways.

    Attributes:
        kg: a published or typical mass.
        density: kg/m3 of a solid item; mass = density x volume.
        areal: kg/m2 of a hollow item modelled as a solid; mass = areal x surface area.
    """

    kg: float | None = None
    density: float | None = None
    areal: float | None = None

    def of(self, volume: float, area: float) -> float:
        """Mass in kg for a volume in m3 and a surface area in m2, to a tenth of a gram."""
        if self.kg is not None:
            return self.kg
        if self.density is not None:
            return round(self.density * volume, 4)
        if self.areal is not None:
            return round(self.areal * area, 4)
        raise ValueError("a mass needs kg, density or areal")


@dataclass(frozen=True)
class Recipe:
    """One item: its name, its group, its mass, where the figures come from, and how to build it."""

    name: str
    category: str
    mass: Mass
    source: str
    parts: Callable[[], Parts]


class Section:
    """The recipes of one module, in the order in which they are written down."""

    def __init__(self, category: str) -> None:
        """Start an empty section for one category."""
        self.category = category
        self.recipes: list[Recipe] = []

    def item(
        self,
        name: str,
        source: str,
        *,
        kg: float | None = None,
        density: float | None = None,
        areal: float | None = None,
    ) -> Callable[[Callable[[], Parts]], Callable[[], Parts]]:
        """Decorator that registers a function without arguments as the recipe of ``name``."""

        def register(parts: Callable[[], Parts]) -> Callable[[], Parts]:
            self.recipes.append(Recipe(name, self.category, Mass(kg, density, areal), source, parts))
            return parts

        return register

    def add(self, name: str, source: str, parts: Callable[[], Parts], *, kg: float) -> None:
        """Register a recipe that needs no function of its own."""
        self.recipes.append(Recipe(name, self.category, Mass(kg=kg), source, parts))
