"""Jobs on worker processes: what goes wrong in one costs its own row alone."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

from agents.workers import run_jobs


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
