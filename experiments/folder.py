"""The folder of a run: rows, what was asked for, results, report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from packenv.errors import InputError
from packenv.io.files import write_whole
from packenv.io.rows import read_rows
from packenv.json_text import read_json

from .results import Result
from .spec import RunSpec


@dataclass(frozen=True)
class Shard:
    """A part of the orders of a run, for job arrays: those whose index is ``number - 1`` modulo ``count``.

    Attributes:
        number: from 1 to ``count``.
        count: of shards.
    """

    number: int = 1
    count: int = 1

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Read ``2/8``.

        Raises:
            ValueError: it is none.
        """
        number, _, count = text.partition("/")
        shard = cls(int(number), int(count))
        if not 1 <= shard.number <= shard.count:
            raise ValueError(text)
        return shard

    def __contains__(self, index: object) -> bool:
        """Whether an order of this index is of the shard."""
        return isinstance(index, int) and index % self.count == self.number - 1

    @property
    def suffix(self) -> str:
        """What its files have in their names."""
        return f".{self.number}-of-{self.count}" if self.count > 1 else ""


@dataclass(frozen=True)
class RunFolder:
    """Where a run keeps its files.

    Attributes:
        path: the folder.
    """

    path: Path

    def rows(self, kind: str, shard: Shard | None = None) -> Path:
        """The file of rows of experiments of one kind."""
        return self.path / f"{kind}{(shard or Shard()).suffix}.jsonl"

    def row_files(self, kind: str) -> list[Path]:
        """All files of rows of one kind, of shards too."""
        whole = self.rows(kind)
        parts = sorted(self.path.glob(f"{kind}.*-of-*.jsonl"))
        return [*([whole] if whole.exists() else []), *parts]

    def keep_spec(self, experiment: str, spec: RunSpec) -> None:
        """Note what an experiment was asked for, so that a report or a merge needs no more words."""
        self.path.mkdir(parents=True, exist_ok=True)
        self._write(f"{experiment}.spec.json", spec.to_mapping())

    def specs(self) -> dict[str, RunSpec]:
        """What was asked for, by experiment.

        Raises:
            InputError: a file is wrong.
        """
        found = {}
        for path in sorted(self.path.glob("*.spec.json")):
            document = read_json(path, "what robotpack bench wrote")
            if not isinstance(document, dict):
                raise InputError(f"{path}: is no specification, give a folder that robotpack bench wrote")
            found[path.name.removesuffix(".spec.json")] = RunSpec.from_mapping(document, str(path))
        return found

    def keep_result(self, result: Result) -> None:
        """Write what an experiment found."""
        self._write(f"{result.experiment}.json", result.to_json())

    def _write(self, name: str, document: object) -> None:
        text = json.dumps(document, indent=1, allow_nan=False) + "\n"
        write_whole(self.path / name, text.encode())


def merge_rows(sources: Sequence[Path], target: Path) -> int:
    """Write the rows of several files into one, each job once: a row that is sound before one that is not.

    Args:
        sources: files of rows.
        target: the file; replaced when the new one is whole. May be one of the sources.

    Returns:
        How many rows it has.

    Raises:
        InputError: a file holds something else.
    """
    best: dict[tuple[str, str], dict[str, Any]] = {}
    for source in sources:
        for row in read_rows(source):
            key = row["key"], str(row.get("revision"))
            if key not in best or "error" in best[key]:
                best[key] = row
    write_whole(target, "".join(json.dumps(row) + "\n" for row in best.values()).encode())
    return len(best)
