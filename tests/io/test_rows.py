"""Rows survive whatever happens to the process that writes them, and other files survive us."""

from __future__ import annotations

from pathlib import Path

import pytest

from packenv.errors import InputError
from packenv.io.rows import RowFile


def test_rows_come_back_in_order(tmp_path: Path) -> None:
    file = RowFile(tmp_path / "deep" / "rows.jsonl")
    for k in range(5):
        file.append({"key": str(k), "value": k**2})
    again = RowFile(file.path)
    assert [row["value"] for row in again] == [0, 1, 4, 9, 16]
    assert "3" in again
    assert "5" not in again


@pytest.mark.parametrize("torn", [b"{", b'{"key": "b", "value', b'{"key": "b"}'])
def test_a_torn_last_line_is_cut_and_the_next_row_is_whole(tmp_path: Path, torn: bytes) -> None:
    path = tmp_path / "rows.jsonl"
    RowFile(path).append({"key": "a"})
    with path.open("ab") as stream:
        stream.write(torn)
    file = RowFile(path)
    assert "b" not in file
    file.append({"key": "c"})
    assert [row["key"] for row in RowFile(path)] == ["a", "c"]


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"# Notes", 1),
        (b"# Notes\n", 1),
        (b'{"key": "a"}\n[1]\n', 2),
        (b'{"key": "a"}\n{"name": "b"}\n', 2),
        (b'{"key": "a"}\n\xff\xfe\n', 2),
        (b'{"key": "a"}\nmore', 2),
    ],
)
def test_a_file_of_something_else_is_refused_and_left_as_it_is(
    tmp_path: Path, content: bytes, line: int
) -> None:
    path = tmp_path / "notes"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"notes, line {line}: is no row"):
        RowFile(path)
    assert path.read_bytes() == content


def test_a_job_that_failed_is_done_again_and_its_last_row_counts(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    file = RowFile(path)
    file.append({"key": "a", "error": "no memory"})
    file.append({"key": "b", "value": 2})
    for known in (file, RowFile(path)):
        assert "a" not in known
        assert "b" in known
    file.append({"key": "a", "value": 1})
    for known in (file, RowFile(path)):
        assert "a" in known
        assert list(known) == [{"key": "a", "value": 1}, {"key": "b", "value": 2}]
