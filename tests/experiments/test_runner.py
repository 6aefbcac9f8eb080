"""Measurements of many jobs: a run that goes on where it stopped, and loses no row."""

from __future__ import annotations

import errno
import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import packenv
from packenv.errors import InputError
from packenv.experiments.revision import revision
from packenv.experiments.runner import Finished, Pool, finish
from packenv.io.rows import read_rows
from tests.conftest import REPO
from tests.experiments.other_run import other_run_at


@dataclass(frozen=True)
class _Job:
    key: str
    log: Path


def _work(job: _Job) -> dict[str, Any]:
    with job.log.open("a") as stream:
        stream.write(job.key)
    if job.key == "c":
        raise ValueError("no")
    return {"twice": 2 * job.key}


def _prepare() -> None:
    pass


def _run(jobs: list[_Job], out: Path, **words: Any) -> Finished:
    words = {"pool": Pool("serial"), "revision": "r1", **words}
    return finish(_work, jobs, out=out, timeout=9, prepare=_prepare, arguments=(), **words)


def _keys(rows: Any) -> list[str]:
    return [row["key"] for row in rows]


def test_a_second_run_does_what_is_missing_and_tells_of_all(tmp_path: Path) -> None:
    log, out = tmp_path / "log", tmp_path / "rows.jsonl"
    jobs = [_Job(key, log) for key in "abcd"]

    def run(some: list[_Job]) -> tuple[str, list[str], list[str], int]:
        log.write_text("")
        found = _run(some, out)
        return log.read_text(), _keys(found.rows), _keys(found.broken), found.new

    assert run(jobs[:2]) == ("ab", ["a", "b"], [], 2)
    assert run(jobs) == ("cd", ["a", "b", "c", "d"], ["c"], 2)
    assert run(jobs[1:3]) == ("c", ["b", "c"], ["c"], 1)  # what failed is done again
    assert run(jobs[:2]) == ("", ["a", "b"], [], 0)


def test_a_row_tells_what_became_of_its_job_and_with_which_product(tmp_path: Path) -> None:
    jobs = [_Job(key, tmp_path / "log") for key in "bc"]
    good, bad = _run(jobs, tmp_path / "rows.jsonl", head=lambda job: {"name": job.key}).rows
    assert (good["status"], good["revision"], good["name"], good["twice"]) == ("ok", "r1", "b", "bb")
    assert good["seconds"] > 0
    assert (bad["status"], bad["revision"], bad["name"]) == ("failed", "r1", "c")
    assert "ValueError: no" in bad["error"]


def test_rows_of_another_revision_count_only_where_that_is_asked(tmp_path: Path) -> None:
    out = tmp_path / "rows.jsonl"
    jobs = [_Job(key, tmp_path / "log") for key in "abd"]
    _run(jobs[:2], out)
    mixed = _run(jobs[:2], out, revision="r2", any_revision=True)
    assert (mixed.new, dict(mixed.others)) == (0, {"r1": 2})
    own = _run(jobs, out, revision="r2")
    assert (own.new, dict(own.others)) == (3, {"r1": 2})
    assert {row["revision"] for row in own.rows} == {"r2"}
    back = _run(jobs[:2], out)  # both are still there
    assert (back.new, dict(back.others)) == (0, {"r2": 2})


def test_a_job_that_was_done_again_counts_as_done_with_any_revision(tmp_path: Path) -> None:
    out = tmp_path / "rows.jsonl"
    rows: list[dict[str, object]] = [
        {"key": "a", "revision": "r1", "error": "no"},
        {"key": "a", "revision": "r1", "twice": "aa"},
        {"key": "b", "revision": "r0", "twice": "old"},
        {"key": "b", "revision": "r1", "twice": "bb"},
        {"key": "b", "revision": "r1", "error": "no"},
        {"key": "d", "revision": "r1", "twice": "old"},
        {"key": "d", "revision": "r2", "twice": "dd"},
        {"key": "d", "revision": "r1", "twice": "old"},
    ]
    out.write_text("".join(json.dumps(row) + "\n" for row in rows))
    jobs = [_Job(key, tmp_path / "log") for key in "abd"]
    found = _run(jobs, out, revision="r2", any_revision=True)
    assert [row["twice"] for row in found.rows] == ["aa", "bb", "dd"]
    assert (found.new, found.broken, dict(found.others)) == (0, (), {"r1": 2})


def test_reading_does_nothing_and_tells_what_is_missing(tmp_path: Path) -> None:
    out = tmp_path / "rows.jsonl"
    jobs = [_Job(key, tmp_path / "log") for key in "abd"]
    _run(jobs[:1], out)
    found = _run(jobs, out, only_read=True)
    assert (_keys(found.rows), found.missing, found.new) == (["a"], 2, 0)


def test_what_rows_depend_on_is_the_product_but_not_its_reports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "packenv"
    (package / "view").mkdir(parents=True)
    for name in ("__init__.py", "planner.py", "view/page.py"):
        (package / name).write_text("STEP = 1\n")
    monkeypatch.setattr(packenv, "__file__", str(package / "__init__.py"))
    first, again, with_work = revision.__wrapped__(), revision.__wrapped__(), revision.__wrapped__(_work)
    (package / "view/page.py").write_text("STEP = 2\n")
    assert revision.__wrapped__() == first == again != with_work
    (package / "planner.py").write_text("STEP = 2\n")
    assert revision.__wrapped__() != first


def test_two_runs_at_once_do_not_write_one_file(tmp_path: Path) -> None:
    out = tmp_path / "rows.jsonl"
    with other_run_at(out), pytest.raises(InputError, match="another run writes it"):
        _run([_Job("a", tmp_path / "log")], out)
    assert _run([_Job("a", tmp_path / "log")], out).new == 1  # a lock does not outlive its run


def test_a_run_goes_on_without_a_lock_where_the_file_system_knows_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl")

    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "lockf", no_locks)
    assert _run([_Job("a", tmp_path / "log")], tmp_path / "rows.jsonl").new == 1


def test_a_full_disk_is_told_by_the_name_of_the_file(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    out = tmp_path / "rows.jsonl"
    jobs = [_Job(f"{k:04}", tmp_path / "log") for k in range(40)]
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, before[1]))
    try:
        with pytest.raises(InputError, match=r"rows\.jsonl: cannot be written \(File too large\)"):
            _run(jobs, out)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    rows = len(list(read_rows(out)))
    assert rows > 0
    assert _run(jobs, out).new == len(jobs) - rows


_KILLED = """
import sys, time
from dataclasses import dataclass
from pathlib import Path
from packenv.experiments.runner import Pool, finish

@dataclass(frozen=True)
class Job:
    key: str

def work(job):
    time.sleep(0.02)
    return {"value": int(job.key) ** 2}

def prepare():
    pass

if __name__ == "__main__":
    jobs = [Job(str(k)) for k in range(120)]
    pool = Pool("pebble", 2)
    finish(work, jobs, out=Path(sys.argv[1]), pool=pool, timeout=60, prepare=prepare, arguments=(), revision="r")
"""


def test_a_run_that_is_killed_again_and_again_ends_with_the_rows_of_one_that_is_not(tmp_path: Path) -> None:
    script = tmp_path / "killed.py"
    script.write_text(_KILLED)
    out = tmp_path / "rows.jsonl"
    command = [sys.executable, str(script), str(out)]
    environment = {**os.environ, "PYTHONPATH": str(REPO)}
    rng = random.Random(0)
    kills = 0
    for _ in range(20):
        run = subprocess.Popen(command, env=environment)
        # Some kills come before the first row; most while rows are written.
        time.sleep(rng.uniform(0.2, 1.2))
        if run.poll() is None:
            run.send_signal(signal.SIGKILL)
            kills += 1
        run.wait()
        with out.open("ab") as stream:  # what a kill in the middle of a write leaves
            stream.write(b'{"key": "7", "val')
    assert subprocess.run(command, env=environment).returncode == 0
    assert kills > 0
    rows = list(read_rows(out))
    assert len({row["key"] for row in rows}) == 120
    assert all(row["value"] == int(row["key"]) ** 2 for row in rows)
    assert len(rows) < 2 * 120  # nothing that was finished is done again, but for jobs at the kill
