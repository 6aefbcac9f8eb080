"""Result rows on disk: one JSON object a line, never lost once it is written, never written twice."""

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
        self._keys = {_key(line, k, path) for k, line in enumerate(whole.split(b"\n")[:-1], start=1)}
        if torn:
            # Rows are objects: what begins otherwise is no torn row but a file of somebody else's.
            if not torn.startswith(b"{"):
                raise _foreign(path, whole.count(b"\n") + 1)
            with path.open("r+b") as stream:
                stream.truncate(len(whole))

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Every finished row, in the order of writing."""
        if self.path.exists():
            with self.path.open(encoding="utf-8") as stream:
                for line in stream:
                    yield json.loads(line)

    def __contains__(self, key: object) -> bool:
        """Whether the job with this key has its row."""
        return key in self._keys

    def append(self, row: dict[str, Any]) -> None:
        """Write a row and wait until the disk has it."""
        with self.path.open("ab") as stream:
            stream.write(json.dumps(row).encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())
        self._keys.add(row["key"])


def _key(line: bytes, number: int, path: Path) -> str:
    try:
        return str(json.loads(line)["key"])
    except (ValueError, TypeError, KeyError):
        raise _foreign(path, number) from None


def _foreign(path: Path, number: int) -> InputError:
    return InputError(f"{path}, line {number}: is no row of results, give a file of rows or a new name")
