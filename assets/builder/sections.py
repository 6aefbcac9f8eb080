"""The list of all recipes, in the order of the table."""

from __future__ import annotations

from .food import FRUIT, PACKAGES
from .household import HOUSE
from .kitchen import KITCHEN
from .spec import Recipe
from .tools import TOOLS
from .toys import TOYS


def recipes() -> dict[str, Recipe]:
    """Every recipe by name.

    Raises:
        ValueError: two items have one name.
    """
    found: dict[str, Recipe] = {}
    for section in (PACKAGES, FRUIT, KITCHEN, TOOLS, HOUSE, TOYS):
        for recipe in section.recipes:
            if recipe.name in found:
                raise ValueError(f"two items are called {recipe.name}")
            found[recipe.name] = recipe
    return found
