"""How commands print: results on standard output, progress and remarks on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Iterator
from typing import TypeVar

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


def with_progress(things: Collection[T], what: str) -> Iterator[T]:
    """Iterate with a progress bar on a terminal; silent in a pipe or a log."""
    from tqdm import tqdm

    yield from tqdm(things, desc=what, unit="item", leave=False, disable=None, file=sys.stderr)
