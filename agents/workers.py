"""Run jobs on worker processes; a job that dies or hangs costs its own row alone."""

from __future__ import annotations

import multiprocessing
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, as_completed
from contextlib import contextmanager
from typing import Any

from packenv.errors import InputError


def run_jobs(
    work: Callable[[Any], dict[str, Any]],
    jobs: Iterable[Any],
    *,
    workers: int,
    timeout: float,
    prepare: Callable[..., None],
    arguments: tuple[Any, ...],
    start: str | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield the row of each job as it is finished, in any order.

    Args:
        work: a job to its row; module-level, since it is pickled.
        jobs: each with a ``key``.
        workers: number of processes; 0 runs everything in this one.
        timeout: seconds after which a job is given up.
        prepare: called once in each process before its first job.
        arguments: what ``prepare`` is called with.
        start: how processes start, as :mod:`multiprocessing` names it: ``spawn`` where this one may hold
            threads, which a fork does not survive. None takes the system's way.

    A failed job yields ``{"key": ..., "error": ...}``: a row, not a gap. Who is terminated takes the workers
    along.

    Raises:
        InputError: worker processes were asked for and pebble is not installed.
    """
    if workers == 0:
        prepare(*arguments)
        for job in jobs:
            try:
                yield work(job)
            except Exception as problem:
                yield _failure(job, problem)
        return
    try:
        from pebble import ProcessPool
    except ModuleNotFoundError:
        raise InputError(f"{workers} worker processes need pebble: pip install pebble") from None
    context = multiprocessing.get_context(start)
    begin = (prepare, arguments)
    with _terminable(), ProcessPool(workers, initializer=_begin, initargs=begin, context=context) as pool:
        running: dict[Future[dict[str, Any]], Any] = {
            pool.schedule(work, args=[job], timeout=timeout): job for job in jobs
        }
        try:
            for future in as_completed(running):
                cause = future.exception()
                if cause is None:
                    yield future.result()
                else:
                    yield _failure(running[future], cause)
        finally:
            pool.stop()  # type: ignore[no-untyped-call]


def _begin(prepare: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    """A worker's first call: it dies at once when told to, whatever it has inherited."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    prepare(*arguments)


@contextmanager
def _terminable() -> Iterator[None]:
    """End on SIGTERM as on any error: a process that is simply gone leaves its workers at work."""
    before = signal.getsignal(signal.SIGTERM)
    if before in (None, signal.SIG_IGN) or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _failure(job: Any, problem: BaseException) -> dict[str, Any]:
    return {"key": job.key, "error": f"{type(problem).__name__}: {problem}"}
