"""Orders over the items of a catalogue: drawn, fixed, or replayed from files."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np

from packenv.env.orders.records import GeneratedOrder
from packenv.errors import InputError


def is_test_item(name: str, share: float) -> bool:
    """Whether an item belongs to the test split.

    It depends on the name alone, by a hash that is the same everywhere: an item that is added or taken away
    moves no other, and a larger share only moves items from train to test.

    Args:
        name: of the item.
        share: of all names, 0 to 1, that the test split gets in the long run.
    """
    digest = hashlib.sha256(name.encode()).digest()
    return int.from_bytes(digest[:8], "big") < share * 2.0**64


@dataclass(frozen=True)
class RandomOrders:
    """Items drawn evenly.

    Attributes:
        names: the items to draw from.
        items: least and most pieces; how many is drawn evenly.
        repeats: an item may come more than once.
    """

    names: tuple[str, ...]
    items: tuple[int, int] = (10, 10)
    repeats: bool = True

    def __post_init__(self) -> None:
        """Check that there is enough to draw from.

        Raises:
            InputError: no items, or fewer than an order without repeats needs.
        """
        if not self.names:
            raise InputError("random orders: no items to draw from; widen the split or the ranges")
        if not self.repeats and self.items[1] > len(self.names):
            raise InputError(
                f"random orders: {self.items[1]} items without repeats, but there are only {len(self.names)} "
                "to draw from; give fewer items, or allow repeats"
            )

    def generate(self, rng: np.random.Generator) -> GeneratedOrder:
        """Draw the number of pieces, then the pieces."""
        count = int(rng.integers(self.items[0], self.items[1] + 1))
        drawn = rng.choice(len(self.names), count, replace=self.repeats)
        return GeneratedOrder(tuple(self.names[k] for k in drawn.tolist()))


@dataclass(frozen=True)
class ListedOrder:
    """The same order every time.

    Attributes:
        items: name of every piece.
    """

    items: tuple[str, ...]

    def generate(self, rng: np.random.Generator) -> GeneratedOrder:
        """The order; nothing is drawn."""
        return GeneratedOrder(self.items)


@dataclass(eq=False)
class ReplayedOrders:
    """Orders one after another, and from the first again after the last.

    The sequence begins anew with every new random generator: an environment that is reset with a seed makes
    one, so the seed fixes what follows, as with any other generator.

    Attributes:
        orders: one after another.
        shuffle: draw which order comes instead: for environments that run side by side.
    """

    orders: tuple[GeneratedOrder, ...]
    shuffle: bool = False
    _next: int = field(default=0, init=False, repr=False)
    _last: np.random.Generator | None = field(default=None, init=False, repr=False)

    def generate(self, rng: np.random.Generator) -> GeneratedOrder:
        """The next order, or a drawn one."""
        if self.shuffle:
            return self.orders[int(rng.integers(len(self.orders)))]
        if rng is not self._last:
            self._next, self._last = 0, rng
        order = self.orders[self._next]
        self._next = (self._next + 1) % len(self.orders)
        return order
