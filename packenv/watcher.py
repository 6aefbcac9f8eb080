"""What long work tells the person who waits for it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TypeVar

T = TypeVar("T")


class Watcher:
    """Told of remarks and of progress; this one shows nothing, others override what they show."""

    def remark(self, text: str) -> None:
        """Hear a sentence that a person may want to know and a program does not."""

    def progress(self, things: Collection[T], what: str) -> Iterable[T]:
        """Iterate over things, and show how far it is.

        Args:
            things: to iterate over.
            what: what is done with them, in a word or two.
        """
        return things


SILENT = Watcher()
"""Shows nothing."""
