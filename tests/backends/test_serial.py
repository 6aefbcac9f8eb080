"""Jobs in this process."""

from __future__ import annotations

import signal
import threading
from typing import Any

import pytest

from packenv.backends import Outcome
from packenv.errors import InputError
from tests.backends.samples import TIMEOUT, Job, Worker, run, told


def test_what_raises_or_hangs_costs_its_own_row_alone() -> None:
    acts = ["square", "raise", "square", "hang", "square"]
    outcomes = run("serial", [Job(k, act) for k, act in enumerate(acts)])
    assert [o.status for o in outcomes] == ["ok", "failed", "ok", "timeout", "ok"]
    assert [o.row for o in outcomes] == [{"square": 0}, None, {"square": 4}, None, {"square": 16}]
    assert outcomes[1].error == "ValueError: no such number"
    assert outcomes[3].error == f"it took longer than {TIMEOUT:g} s"
    assert TIMEOUT <= outcomes[3].seconds < 2 * TIMEOUT


def test_a_job_that_catches_every_exception_is_stopped_all_the_same() -> None:
    assert [o.status for o in run("serial", [Job(0, "catch"), Job(1)])] == ["timeout", "ok"]


def test_the_limit_is_each_jobs_own() -> None:
    assert {o.status for o in run("serial", [Job(k, "nap") for k in range(3)])} == {"ok"}


def test_a_limit_that_no_clock_has_is_none() -> None:
    assert {o.status for o in run("serial", [Job(0), Job(1)], timeout=1e300)} == {"ok"}


def test_no_alarm_and_no_handler_is_left() -> None:
    before = signal.getsignal(signal.SIGALRM)
    run("serial", [Job(0), Job(1, "raise"), Job(2, "hang")])
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_outside_the_main_thread_there_is_no_limit() -> None:
    outcomes: list[Outcome[Any]] = []
    thread = threading.Thread(
        target=lambda: outcomes.extend(run("serial", [Job(0, "nap"), Job(1)], timeout=0.1))
    )
    thread.start()
    thread.join()
    assert told(outcomes) == told(run("serial", [Job(0, "nap"), Job(1)]))


def test_it_is_prepared_once_and_says_what_is_wrong_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Worker, "prepared", 0)
    assert [o.row["prepared"] for o in run("serial", [Job(0, "who"), Job(1, "who")]) if o.row] == [1, 1]
    with pytest.raises(InputError, match=r"^there is no such catalogue$"):
        run("serial", [Job(0)], arguments=("refuse",))
