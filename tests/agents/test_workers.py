"""Jobs on worker processes: what goes wrong in one costs its own row alone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from packenv.agents.workers import run_jobs


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


_ENDLESS = """
import os, signal, sys, time
from dataclasses import dataclass
from pathlib import Path

from packenv.agents.workers import run_jobs

# A shell's background job, as these tests may be one, ignores Ctrl-C, and what it starts does, too.
signal.signal(signal.SIGINT, signal.default_int_handler)

@dataclass(frozen=True)
class Job:
    key: str

def prepare():
    pass

def work(job):
    Path(sys.argv[1]).joinpath(str(os.getpid())).touch()
    while True:
        time.sleep(0.1)

list(run_jobs(work, [Job("0"), Job("1")], workers=2, timeout=600, prepare=prepare, arguments=()))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_who_is_stopped_takes_the_workers_along(tmp_path: Path, number: signal.Signals) -> None:
    script = tmp_path / "endless.py"
    script.write_text(_ENDLESS)
    pids = tmp_path / "pids"
    pids.mkdir()
    parent = subprocess.Popen([sys.executable, str(script), str(pids)], stderr=subprocess.DEVNULL)
    try:
        _until(lambda: len(list(pids.iterdir())) == 2, 60.0)
        parent.send_signal(number)
        assert parent.wait(30.0) != 0
        _until(lambda: not any(_lives(int(path.name)) for path in pids.iterdir()), 10.0)
    finally:
        parent.kill()
        parent.wait()
        for path in pids.iterdir():
            if _lives(int(path.name)):
                os.kill(int(path.name), signal.SIGKILL)


def _lives(pid: int) -> bool:
    """Whether a process runs; one that has ended and that nobody has asked about yet does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def _until(true: Callable[[], bool], longest: float) -> None:
    end = time.monotonic() + longest
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)
