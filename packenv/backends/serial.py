"""Jobs in this process, one after another."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from .outcome import J, Outcome, Prepare, attempt

AGAIN = 1.0
"""Seconds after which an overdue job is interrupted again: what is raised in a finalizer is lost."""


class _OverdueError(BaseException):
    """A job takes too long; no Exception, which a job may well catch."""


def run(
    work: Callable[[J], dict[str, Any]],
    jobs: Iterable[J],
    *,
    timeout: float,
    prepare: Prepare,
    arguments: tuple[Any, ...],
) -> Generator[Outcome[J], None, None]:
    """See :func:`packenv.backends.imap_unordered`."""
    prepare(*arguments)
    for job in jobs:
        begin = time.perf_counter()
        try:
            with _limit(timeout):
                outcome = attempt(work, job, Exception).outcome(job)
        except _OverdueError:
            error = f"it took longer than {timeout:g} s"
            outcome = Outcome(job, None, "timeout", error, time.perf_counter() - begin)
        yield outcome


@contextmanager
def _limit(seconds: float) -> Iterator[None]:
    """Raise :class:`_OverdueError` in here after so many seconds, where that can be done."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return
    inside = True

    def interrupt(*_: object) -> None:
        if inside:  # a signal that came at the last moment is handled when all is over
            raise _OverdueError

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN)
        yield
    finally:
        inside = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
