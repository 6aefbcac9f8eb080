"""Values that can be loaded anew: those that were used last are kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Recent(Generic[T]):
    """Values that were used last, up to a number of bytes; at least one is kept."""

    def __init__(self, budget: int, size: Callable[[T], int]) -> None:
        """Keep nothing yet.

        Args:
            budget: bytes.
            size: bytes of a value.
        """
        self._budget, self._size = budget, size
        self._kept: OrderedDict[str, tuple[T, int]] = OrderedDict()
        self._bytes = 0

    def get(self, name: str, make: Callable[[], T]) -> T:
        """The value of a name, made where it is not kept."""
        if name in self._kept:
            self._kept.move_to_end(name)
            return self._kept[name][0]
        value = make()
        self._kept[name] = value, self._size(value)
        self._bytes += self._kept[name][1]
        while len(self._kept) > 1 and self._bytes > self._budget:
            self._bytes -= self._kept.popitem(last=False)[1][1]
        return value

    def __contains__(self, name: object) -> bool:
        return name in self._kept

    def drop(self, name: str) -> None:
        """Forget a name."""
        if name in self._kept:
            self._bytes -= self._kept.pop(name)[1]
