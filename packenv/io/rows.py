"""Result rows on disk: one JSON object a line, never lost once it is written."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from packenv.errors import InputError


def row_key(*parts: object) -> str:
    """Hash of all that a row depends on, by their representations."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:24]


def read_rows(path: Path) -> Iterator[dict[str, Any]]:
    """The rows of a file in the sequence in which they were written; a last line without its end is no row.

    Raises:
        InputError: the file cannot be read, or holds something else than rows.
    """
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror}), give a file of rows") from None
    for number, line in enumerate(lines[:-1], start=1):
        yield _row(line, number, path)
    # Rows are objects: what begins otherwise is no torn row but a file of somebody else's.
    if lines[-1] and not lines[-1].startswith(b"{"):
        raise _foreign(path, len(lines))


class RowFile:
    """A JSONL file of rows with a ``key`` each. One process writes it; a killed one loses no finished row."""

    def __init__(self, path: Path) -> None:
        """Open for appending; a last line without its end, left by a killed process, is cut off.

        Raises:
            InputError: the file holds something else than rows; it is left as it is.
        """
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._done: dict[object, bool] = {}
        if path.exists():
            self._done = {str(row["key"]): "error" not in row for row in read_rows(path)}
            content = path.read_bytes()
            whole = content.rfind(b"\n") + 1
            if whole < len(content):
                with path.open("r+b") as stream:
                    stream.truncate(whole)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """The last row of each job, in the order in which the jobs were first done."""
        if self.path.exists():
            yield from {row["key"]: row for row in read_rows(self.path)}.values()

    def __contains__(self, key: object) -> bool:
        """Whether the job with this key has its row; one that tells of an ``error`` is done again."""
        return self._done.get(key, False)

    def append(self, row: dict[str, Any]) -> None:
        """Write a row and wait until the disk has it."""
        with self.path.open("ab") as stream:
            stream.write(json.dumps(row).encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())
        self._done[row["key"]] = "error" not in row


def _row(line: bytes, number: int, path: Path) -> dict[str, Any]:
    """One row of a file."""
    try:
        row: dict[str, Any] = json.loads(line)
        row["key"]
    except (ValueError, TypeError, KeyError):
        raise _foreign(path, number) from None
    return row


def _foreign(path: Path, number: int) -> InputError:
    return InputError(f"{path}, line {number}: is no row of results, give a file of rows or a new name")
