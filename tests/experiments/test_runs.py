"""Experiments on random orders: their options, and a run that goes on where it stopped."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

import packenv
from experiments.runs import finish, order_options, product_code
from packenv.planning.search.heuristics import HEURISTICS


@pytest.mark.parametrize("name", ["HM", "nothing", ""])
def test_an_unknown_heuristic_is_refused_before_any_job(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = order_options("test", orders=1, out="rows.jsonl")
    with pytest.raises(SystemExit) as end:
        parser.parse_args(["--heuristics", "hm", name])
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert all(known in said for known in HEURISTICS)


OWN = "examples.my_heuristic:flattest"


def test_own_heuristics_go_by_module_and_name() -> None:
    parser = order_options("test", orders=1, out="rows.jsonl")
    assert parser.parse_args(["--heuristics", OWN]).heuristics == [OWN]


def test_every_heuristic_can_be_asked_for() -> None:
    parser = order_options("test", orders=1, out="rows.jsonl")
    assert parser.parse_args(["--heuristics", *HEURISTICS]).heuristics == list(HEURISTICS)


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
