"""Rows survive whatever happens to the process that writes them."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from experiments.rows import RowFile
from experiments.workers import run_jobs


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


@dataclass(frozen=True)
class _Job:
    key: str
    act: str


def _work(job: _Job) -> dict[str, object]:
    if job.act == "die":
        os._exit(9)
    if job.act == "hang":
        time.sleep(60)
    if job.act == "raise":
        raise ValueError("no")
    return {"key": job.key, "value": int(job.key) ** 2}


def _prepare() -> None:
    pass


def test_a_job_that_dies_hangs_or_raises_costs_its_own_row_alone() -> None:
    acts = ["fine"] * 6 + ["die", "fine", "raise", "hang", "fine"]
    jobs = [_Job(str(k), act) for k, act in enumerate(acts)]
    rows = {r["key"]: r for r in run_jobs(_work, jobs, workers=2, timeout=3, prepare=_prepare, arguments=())}
    assert set(rows) == {job.key for job in jobs}
    for job in jobs:
        assert ("error" in rows[job.key]) == (job.act != "fine")


def test_the_number_of_workers_changes_nothing() -> None:
    jobs = [_Job(str(k), "raise" if k == 3 else "fine") for k in range(8)]
    results = []
    for workers in (0, 1, 2):
        rows = run_jobs(_work, jobs, workers=workers, timeout=30, prepare=_prepare, arguments=())
        results.append(sorted(rows, key=lambda row: str(row["key"])))
    assert results[0] == results[1] == results[2]
