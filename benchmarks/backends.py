"""What each backend costs a job: ``python -m benchmarks.backends [--catalogue DIR]`` prints JSON.

Jobs that do nothing tell the time from one outcome to the next; jobs that wait tell what share of the time goes
into anything but the jobs. They wait and do not compute, so what else the machine does counts little. Then, in
CPU-seconds of fresh processes, what a run does before its first job and what a worker does, and the wall time of
writing a row: the costs of :class:`packenv.experiments.scaling.Costs`.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import pickle
import statistics
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args

from packenv.backends import BackendName, imap_unordered
from packenv.experiments.experiment import Job
from packenv.experiments.planning import HEURISTICS
from packenv.experiments.spec import RunSpec
from packenv.io.rows import RowFile

TRIVIAL = 200
"""Jobs that do nothing."""
WAITING = 200
"""Jobs that wait."""


def wait(seconds: float) -> dict[str, Any]:
    """A job."""
    if seconds:
        time.sleep(seconds)
    return {}


def nothing() -> None:
    """Before the first job."""


def arrivals(backend: BackendName, workers: int, jobs: int, seconds: float) -> tuple[list[float], float]:
    """When the outcomes of jobs arrive, s from the first on, and how long the first one takes, s."""
    start = time.perf_counter()
    times = [
        time.perf_counter()
        for _ in imap_unordered(
            wait,
            [seconds] * jobs,
            backend=backend,
            workers=workers,
            timeout=60,
            prepare=nothing,
            arguments=(),
        )
    ]
    return [at - times[0] for at in times], times[0] - start


def measure(backend: BackendName, seconds: float) -> dict[str, float]:
    """One backend's figures."""
    trivial, first = arrivals(backend, 1, TRIVIAL, 0.0)
    figures = {
        "first_outcome_s": first,
        "job_ms_median": 1e3 * statistics.median(b - a for a, b in pairwise(trivial)),
    }
    for workers in (1, 2):
        if workers == 1 or backend != "serial":
            last = arrivals(backend, workers, WAITING, seconds)[0][-1]
            # The first outcomes of all workers come at about the same time: the clock begins there.
            figures[f"overhead_share_{workers}_workers"] = (
                last * workers / (seconds * (WAITING - workers)) - 1
            )
    return figures


BEGIN = """
import pickle, sys, time
from packenv.experiments.planning import HEURISTICS
spec = pickle.load(sys.stdin.buffer)
HEURISTICS.prepare(spec, "")
HEURISTICS.jobs(spec)
print(time.process_time())
"""
START = """
import pickle, sys, time
spec, job = pickle.load(sys.stdin.buffer)
from packenv.experiments.planning import HEURISTICS
HEURISTICS.prepare(spec, "")
HEURISTICS.work(job)
first = time.process_time()
HEURISTICS.work(job)
print(2 * first - time.process_time())
"""


def costs(catalogue: str) -> dict[str, float]:
    """What a run costs beside its jobs; each start is measured three times, as every cache is warm but the first."""
    spec = RunSpec(catalogue=catalogue, orders=1000, methods=("hm",), constraints=("overlap",))
    HEURISTICS.prepare(spec, "")
    job = HEURISTICS.jobs(spec)[0]
    return {
        "begin_cpu_s": min(_printed(BEGIN, spec) for _ in range(3)),
        "start_cpu_s": min(_printed(START, (spec, job)) for _ in range(3)),
        "row_ms_median": 1e3 * _row_seconds(job),
    }


def _printed(program: str, given: object) -> float:
    words = [sys.executable, "-c", program]
    return float(subprocess.run(words, input=pickle.dumps(given), check=True, capture_output=True).stdout)


def _row_seconds(job: Job) -> float:
    """Median time of a row on its way to the disk."""
    with tempfile.TemporaryDirectory(dir=".") as folder:
        file, seconds = RowFile(Path(folder) / "rows.jsonl"), []
        for k in range(200):
            start = time.perf_counter()
            file.append({"key": str(k), **job.head()})
            seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def main() -> None:
    """Measure all backends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=0.03, help="how long a waiting job waits")
    parser.add_argument("--catalogue", default="builtin", help="of the run whose start is measured")
    given = parser.parse_args()
    rows = {backend: measure(backend, given.seconds) for backend in get_args(BackendName)}
    print(json.dumps({"job_s": given.seconds, "backends": rows, "run": costs(given.catalogue)}, indent=2))


if __name__ == "__main__":
    main()
