"""Jobs on processes of this machine."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path

import psutil
import pytest

from packenv.backends import imap_unordered
from packenv.errors import InputError, RobotPackError
from tests.backends.samples import (
    TIMEOUT,
    Job,
    Worker,
    endless_run,
    prepare,
    processes_of,
    run,
    run_with_one_killed,
    told,
    until,
    work,
)


def _workers() -> list[psutil.Process]:
    """The worker processes of this one; multiprocessing has another child, which tracks what is shared."""
    children = psutil.Process().children()
    return [child for child in children if "resource_tracker" not in " ".join(child.cmdline())]


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_the_outcomes_are_those_of_one_process(workers: int) -> None:
    acts = ["square", "raise", "square", "hang", "square", "square", "raise"]
    jobs = [Job(k, act) for k, act in enumerate(acts)]
    assert told(run("pebble", jobs, workers)) == told(run("serial", jobs))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_job_that_takes_its_process_down_costs_its_own_row_alone(workers: int) -> None:
    acts = ["square", "die", "square", "crash", "square", "exit", "square", "hang", "square"]
    outcomes = run("pebble", [Job(k, act) for k, act in enumerate(acts)], workers)
    bad = {1: "died", 3: "died", 5: "failed", 7: "timeout"}
    assert [o.status for o in outcomes] == [bad.get(k, "ok") for k in range(len(acts))]
    assert outcomes[1].error == "its process died (exit code 9)"
    assert outcomes[3].error == "its process died (SIGSEGV)"
    assert outcomes[5].error == "SystemExit: enough"
    assert all(o.row == {"square": o.job.number**2} for o in outcomes if o.job.number not in bad)


@pytest.mark.skipif(not hasattr(signal, "SIGRTMIN"), reason="this system has no signals without a name")
def test_a_signal_without_a_name_costs_one_row_as_well(tmp_path: Path) -> None:
    number = signal.SIGRTMIN + 1
    outcomes = run_with_one_killed("pebble", tmp_path, number, jobs=3)
    assert [o.status for o in outcomes] == ["ok", "died", "ok"]
    assert outcomes[1].error == f"its process died (signal {number})"


def test_no_more_processes_start_than_there_are_jobs() -> None:
    outcomes = imap_unordered(
        work,
        [Job(0), Job(1)],
        backend="pebble",
        workers=8,
        timeout=50.0,
        prepare=prepare,
        arguments=(),
    )
    with closing(outcomes):
        assert next(outcomes).status == "ok"
        assert 1 <= len(_workers()) <= 2


def test_time_counts_from_the_start_of_a_job() -> None:
    outcomes = run("pebble", [Job(k, "nap") for k in range(4)], 1)
    assert {o.status for o in outcomes} == {"ok"}
    assert all(0.6 * TIMEOUT <= o.seconds < TIMEOUT for o in outcomes)


def test_a_worker_that_is_killed_from_outside_costs_one_row(tmp_path: Path) -> None:
    outcomes = run_with_one_killed("pebble", tmp_path)
    assert [o.status for o in outcomes] == ["ok", "died", "ok", "ok"]
    assert outcomes[1].error == "its process died (SIGKILL)"


def test_a_worker_that_is_killed_between_two_jobs_costs_none() -> None:
    def jobs() -> Iterator[Job]:
        yield from (Job(k) for k in range(2))
        time.sleep(0.5)  # both are done
        for child in _workers():
            child.kill()
        time.sleep(0.5)  # this is seen
        yield from (Job(k) for k in range(2, 5))

    assert told(run("pebble", jobs(), 1)) == told(run("serial", [Job(k) for k in range(5)]))


def test_every_process_is_prepared_once_before_its_first_job() -> None:
    outcomes = run("pebble", [Job(k, "who") for k in range(20)], 3)
    rows = [o.row for o in outcomes if o.row]
    assert {row["prepared"] for row in rows} == {Worker.prepared + 1}  # a fork has what this one had
    assert os.getpid() not in {row["pid"] for row in rows}


@pytest.mark.parametrize(
    ("act", "error", "message"),
    [
        ("refuse", InputError, "^there is no such catalogue$"),
        ("raise", RobotPackError, "a worker could not be prepared: KeyError: 'catalogue'"),
        ("die", RobotPackError, "end before their first job"),
    ],
)
def test_a_worker_that_cannot_be_prepared_is_told_of(
    act: str, error: type[RobotPackError], message: str
) -> None:
    with pytest.raises(error, match=message):
        run("pebble", [Job(k) for k in range(5)], arguments=(act,))
    assert _workers() == []


def test_jobs_are_taken_as_they_are_needed_and_processes_end_with_the_generator() -> None:
    taken = 0

    def jobs() -> Iterator[Job]:
        nonlocal taken
        for k in range(10**9):
            taken += 1
            yield Job(k)

    done = imap_unordered(
        work, jobs(), backend="pebble", workers=2, timeout=60, prepare=prepare, arguments=()
    )
    with closing(done):
        assert len(list(islice(done, 5))) == 5
        assert taken <= 5 + 4
        assert len(_workers()) == 2
    assert _workers() == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_who_is_stopped_takes_the_workers_along(tmp_path: Path, number: signal.Signals) -> None:
    with endless_run("pebble", tmp_path) as parent:
        parent.send_signal(number)
        assert parent.wait(30.0) != 0
        until(lambda: processes_of(tmp_path) == [], 10.0)


def test_handlers_are_put_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    run("pebble", [Job(0)])
    assert signal.getsignal(signal.SIGTERM) is before


def test_processes_may_be_started_anew() -> None:
    done = imap_unordered(
        work,
        [Job(0, "who"), Job(1)],
        backend="pebble",
        workers=1,
        timeout=60,
        prepare=prepare,
        arguments=(),
        start="spawn",
    )
    assert sorted(outcome.status for outcome in done) == ["ok", "ok"]


@pytest.mark.parametrize(("backend", "extra"), [("pebble", "bench"), ("ray", "ray")])
def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch, backend: str, extra: str) -> None:
    monkeypatch.setitem(sys.modules, backend, None)
    with pytest.raises(InputError, match=rf"pip install 'robotpack\[{extra}\]'"):
        run(backend, [Job(0)])  # type: ignore[arg-type]


@pytest.mark.parametrize("backend", ["pebble", "ray"])
def test_workers_are_one_or_more(backend: str) -> None:
    with pytest.raises(InputError, match="workers is 0, give 1 or more"):
        run(backend, [Job(0)], 0)  # type: ignore[arg-type]
