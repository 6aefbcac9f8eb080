"""Whether a box takes one more item, wherever in it that would lie: what it weighs, and with what it may be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from packenv.types import Container, Item

OVERWEIGHT = "box-overweight"
"""The word for an item with which the box would weigh too much."""

KEPT_APART = "kept-apart"
"""The word for an item of a group that is in no box with another one that is there."""


@dataclass(frozen=True)
class Held:
    """What a box holds, as far as it matters for what else it takes.

    Attributes:
        mass: kg.
        group: the group of those items that have one; None where none has.
    """

    mass: float = 0.0
    group: str | None = None

    @classmethod
    def of(cls, items: Iterable[Item]) -> Held:
        """What a box with these items holds."""
        held = cls()
        for item in items:
            held = held.and_one(item)
        return held

    def and_one(self, item: Item) -> Held:
        """The same with one more item."""
        return Held(self.mass + item.mass, self.group or item.limits.keep_apart)


@dataclass(frozen=True)
class Admission:
    """The rules by which boxes take items.

    Attributes:
        items: by name, as the geometry that is planned with; one that is not there is always taken.
    """

    items: Mapping[str, Item] = field(default_factory=dict)

    def refusal(self, name: str, held: Held, container: Container) -> tuple[str, str] | None:
        """Why a box does not take an item: a word for programs and a sentence for people; None where it does.

        Args:
            name: of the item.
            held: what is in the box.
            container: the box.
        """
        item = self.items.get(name)
        if item is None:
            return None
        then, most, group = held.mass + item.mass, container.max_kg, item.limits.keep_apart
        if most is not None and then > most + 1e-9:  # rounding of sums
            why = f"with {name} ({item.mass:.3g} kg) the box would hold {then:.4g} of {most:g} kg"
            return OVERWEIGHT, why
        if group is not None and held.group not in (None, group):
            why = f"{name} is kept apart ({group}), and the box holds items of {held.group}"
            return KEPT_APART, why
        return None

    def with_item(self, held: Held, name: str) -> Held:
        """What a box holds once it has taken an item."""
        item = self.items.get(name)
        return held if item is None else held.and_one(item)
