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


class RowFile:
    """A JSONL file of rows with a ``key`` each. One process writes it; a killed one loses no finished row."""

    def __init__(self, path: Path) -> None:
        """Open for appending; a last line without its end, left by a killed process, is cut off.

        Raises:
            InputError: the file holds something else than rows; it is left as it is.
        """
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        content = path.read_bytes() if path.exists() else b""
        whole = content[: content.rfind(b"\n") + 1]
        torn = content[len(whole) :]
        lines = enumerate(whole.split(b"\n")[:-1], start=1)
        self._done = dict(_key(line, k, path) for k, line in lines)
        if torn:
            # Rows are objects: what begins otherwise is no torn row but a file of somebody else's.
            if not torn.startswith(b"{"):
                raise _foreign(path, whole.count(b"\n") + 1)
            with path.open("r+b") as stream:
                stream.truncate(len(whole))

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """The last row of each job, in the order in which the jobs were first done."""
        if self.path.exists():
            with self.path.open(encoding="utf-8") as stream:
                rows = map(json.loads, stream)
                yield from {row["key"]: row for row in rows}.values()

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


def _key(line: bytes, number: int, path: Path) -> tuple[object, bool]:
    """A row's key, and whether it tells of no error."""
    try:
        row = json.loads(line)
        return str(row["key"]), "error" not in row
    except (ValueError, TypeError, KeyError):
        raise _foreign(path, number) from None


def _foreign(path: Path, number: int) -> InputError:
    return InputError(f"{path}, line {number}: is no row of results, give a file of rows or a new name")
