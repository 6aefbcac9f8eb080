"""How commands print: results on standard output, progress and remarks on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Iterator
from typing import TypeVar

from packenv.watcher import Watcher

T = TypeVar("T")


def say(text: str = "") -> None:
    """Print a line of the result."""
    print(text)  # noqa: T201


def say_json(document: object) -> None:
    """Print the result as JSON."""
    print(json.dumps(document, indent=1, allow_nan=False))  # noqa: T201


def remark(text: str) -> None:
    """Print a line that is not part of the result."""
    print(f"robotpack: {text}", file=sys.stderr)  # noqa: T201


class Terminal(Watcher):
    """Remarks on standard error, and a progress bar on a terminal; no bar in a pipe or a log."""

    def remark(self, text: str) -> None:
        """Print it."""
        remark(text)

    def progress(self, things: Collection[T], what: str) -> Iterator[T]:
        """Iterate with a bar."""
        return with_progress(things, what)


def with_progress(things: Collection[T], what: str) -> Iterator[T]:
    """Iterate with a progress bar on a terminal; silent in a pipe or a log."""
    from tqdm import tqdm

    yield from tqdm(things, desc=what, unit="item", leave=False, disable=None, file=sys.stderr)
