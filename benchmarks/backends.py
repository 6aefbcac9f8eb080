"""What each backend costs a job: ``python -m benchmarks.backends`` prints JSON.

Jobs that do nothing tell the time from one outcome to the next; jobs that wait tell what share of the time goes
into anything but the jobs. They wait and do not compute, so what else the machine does counts little.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from typing import Any, get_args

from packenv.backends import BackendName, imap_unordered

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
        "job_ms_median": 1e3 * statistics.median(b - a for a, b in zip(trivial, trivial[1:], strict=False)),
    }
    for workers in (1, 2):
        if workers == 1 or backend != "serial":
            last = arrivals(backend, workers, WAITING, seconds)[0][-1]
            # The first outcomes of all workers come at about the same time: the clock begins there.
            figures[f"overhead_share_{workers}_workers"] = (
                last * workers / (seconds * (WAITING - workers)) - 1
            )
    return figures


def main() -> None:
    """Measure all backends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=0.03, help="how long a waiting job waits")
    seconds = parser.parse_args().seconds
    rows = {backend: measure(backend, seconds) for backend in get_args(BackendName)}
    print(json.dumps({"job_s": seconds, "backends": rows}, indent=2))


if __name__ == "__main__":
    main()
