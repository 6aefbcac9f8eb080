"""Jobs that behave and jobs that do not, and what their outcomes are."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from packenv.backends import BackendName, Outcome, imap_unordered
from packenv.errors import InputError

TIMEOUT = 1.5


@dataclass(frozen=True)
class Job:
    """The square of a number, or something worse."""

    number: int
    act: str = "square"
    told: Path = field(default=Path())


class Worker:
    """What this process knows."""

    prepared = 0


def prepare(act: str = "") -> None:
    Worker.prepared += 1
    if act == "refuse":
        raise InputError("there is no such catalogue")
    if act == "raise":
        raise KeyError("catalogue")
    if act == "die":
        os._exit(5)


def work(job: Job) -> dict[str, Any]:
    match job.act:
        case "die":
            os._exit(9)
        case "crash":
            signal.signal(signal.SIGSEGV, signal.SIG_DFL)  # pytest's and Ray's would print where it was
            os.kill(os.getpid(), signal.SIGSEGV)
        case "hang":
            time.sleep(60)
        case "nap":
            time.sleep(0.6 * TIMEOUT)
        case "raise":
            raise ValueError("no\nsuch  number")
        case "exit":
            sys.exit("enough")
        case "catch":
            for _ in range(2):
                with suppress(Exception):
                    time.sleep(60)
        case "tell":
            job.told.joinpath(str(os.getpid())).touch()
            time.sleep(60)
        case "who":
            return {"pid": os.getpid(), "prepared": Worker.prepared}
        case "node":
            import ray

            time.sleep(0.2)
            return {"node": ray.get_runtime_context().get_node_id()}
        case "threads":
            return {"threads": os.environ.get("OMP_NUM_THREADS")}
    return {"square": job.number**2}


def run(
    backend: BackendName,
    jobs: Iterable[Job],
    workers: int = 2,
    *,
    timeout: float = TIMEOUT,
    arguments: tuple[Any, ...] = (),
) -> list[Outcome[Job]]:
    """All outcomes, by the jobs' numbers."""
    done = imap_unordered(
        work,
        jobs,
        backend=backend,
        workers=workers,
        timeout=timeout,
        prepare=prepare,
        arguments=arguments,
    )
    with closing(done):
        return sorted(done, key=lambda outcome: outcome.job.number)


def run_with_one_killed(
    backend: BackendName, folder: Path, number: int = signal.SIGKILL, *, jobs: int = 4
) -> list[Outcome[Job]]:
    """Some jobs; the process of the second is ended from outside by a signal."""

    def kill() -> None:
        until(lambda: any(folder.iterdir()))
        os.kill(int(next(folder.iterdir()).name), number)

    killer = threading.Thread(target=kill)
    killer.start()
    outcomes = run(backend, [Job(0), Job(1, "tell", folder), *map(Job, range(2, jobs))], timeout=50.0)
    killer.join()
    return outcomes


def told(outcomes: Iterable[Outcome[Job]]) -> list[tuple[Any, ...]]:
    """What does not depend on the clock."""
    return [(o.job, o.row, o.status, o.error) for o in outcomes]


def until(true: Callable[[], bool], longest: float = 30.0) -> None:
    """Wait for something."""
    end = time.monotonic() + longest
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


ENDLESS = """
import signal, sys
from pathlib import Path

from packenv.backends import imap_unordered
from tests.backends.samples import Job, prepare, work

# A shell's background job, as these tests may be one, ignores Ctrl-C, and what it starts does, too.
signal.signal(signal.SIGINT, signal.default_int_handler)
jobs = [Job(k, "tell", Path(sys.argv[2])) for k in range(2)]
options = dict(workers=2, timeout=600.0, prepare=prepare, arguments=())
list(imap_unordered(work, jobs, backend=sys.argv[1], **options))
"""


@contextmanager
def endless_run(backend: BackendName, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process whose two workers never end, once these are at work; whatever is left is killed."""
    script = folder / "endless.py"
    script.write_text(ENDLESS)
    pids = folder / "pids"
    pids.mkdir()
    root = Path(__file__).parents[2]
    environment = {**os.environ, "MARK": str(folder), "PYTHONPATH": str(root)}
    parent = subprocess.Popen(
        [sys.executable, str(script), backend, str(pids)],
        stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        env=environment,
    )
    try:
        until(lambda: len(list(pids.iterdir())) == 2, 90.0)
        yield parent
    finally:
        parent.kill()
        parent.wait()
        for process in processes_of(folder):
            process.kill()


def processes_of(folder: Path) -> list[psutil.Process]:
    """All that an endless run has started, at whatever depth, and that still lives."""
    found = []
    for process in psutil.process_iter():
        try:
            marked = process.environ().get("MARK") == str(folder)
            if marked and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (psutil.Error, OSError):
            continue
    return found
