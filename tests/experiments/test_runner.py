"""Measurements of many jobs: a run that goes on where it stopped."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

import packenv
from packenv.experiments.finish import finish, product_code


@dataclass(frozen=True)
class _Job:
    key: str
    log: Path


def _work(job: _Job) -> dict[str, object]:
    with job.log.open("a") as stream:
        stream.write(job.key)
    if job.key == "c":
        raise ValueError("no")
    return {"key": job.key}


def _prepare() -> None:
    pass


def test_a_second_run_does_what_is_missing_and_tells_of_all(tmp_path: Path) -> None:
    log, out = tmp_path / "log", tmp_path / "rows.jsonl"
    jobs = [_Job(key, log) for key in "abcd"]

    def run(some: list[_Job]) -> tuple[str, list[str], list[str]]:
        log.write_text("")
        done, failed = finish(_work, some, out=out, workers=0, timeout=9, prepare=_prepare, arguments=())
        return log.read_text(), sorted(row["key"] for row in done), [row["key"] for row in failed]

    assert run(jobs[:2]) == ("ab", ["a", "b"], [])
    assert run(jobs) == ("cd", ["a", "b", "c", "d"], ["c"])
    assert run(jobs[1:3]) == ("c", ["b", "c"], ["c"])  # what failed is done again


def test_rows_of_other_code_are_other_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "packenv"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "planner.py").write_text("STEP = 1\n")
    monkeypatch.setattr(packenv, "__file__", str(package / "__init__.py"))
    first, again = product_code.__wrapped__(), product_code.__wrapped__()
    (package / "planner.py").write_text("STEP = 2\n")
    assert first == again != product_code.__wrapped__()
