"""Reading JSON that a user gives: text that is none, or a number that no float holds, is one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from packenv.errors import InputError, is_number


def read_json(path: Path, right: str = "JSON", error: type[InputError] = InputError) -> Any:
    """What a JSON file holds.

    Args:
        path: the file.
        right: what would be right, for messages.
        error: class of the errors.

    Raises:
        InputError: it cannot be read, is not JSON, or holds a number that is not finite.
    """
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror}), give {right}") from None
    return parse_json(content, str(path), right, error)


def parse_json(
    content: str | bytes, where: str, right: str = "JSON", error: type[InputError] = InputError
) -> Any:
    """What some JSON says.

    ``NaN``, ``Infinity``, ``1e999`` and whole numbers beyond the largest float, all of which Python reads, are
    refused by their place: compared, converted or written again they would fail far from here.

    Args:
        content: the text, with or without a byte order mark.
        where: the file or the option, for messages.
        right: what would be right, for messages.
        error: class of the errors.

    Raises:
        InputError: it is not JSON, or holds a number that is not finite.
    """
    try:
        document = json.loads(content)
    except UnicodeDecodeError:
        raise error(f"{where}: is not text, give {right}") from None
    except (ValueError, RecursionError) as problem:
        raise error(f"{where}: is not JSON ({problem}), give {right}") from None
    # Without recursion: what was parsed may be nested more deeply than Python's functions can be.
    waiting: list[tuple[str, object]] = [("", document)]
    while waiting:
        place, value = waiting.pop()
        if isinstance(value, dict):
            waiting.extend((f"{place}.{key}", inner) for key, inner in value.items())
        elif isinstance(value, list):
            waiting.extend((f"{place}[{k}]", inner) for k, inner in enumerate(value))
        elif isinstance(value, (int, float)) and not isinstance(value, bool) and not is_number(value):
            name = place.lstrip(".") or "the number"
            raise error(f"{where}: {name:.80} is {json.dumps(value):.40}, give a finite number")
    return document
