"""Run jobs on worker processes; a job that dies or hangs costs its own row alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import as_completed
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
) -> Iterator[dict[str, Any]]:
    """Yield the row of each job as it is finished, in any order.

    Args:
        work: a job to its row; module-level, since it is pickled.
        jobs: each with a ``key``.
        workers: number of processes; 0 runs everything in this one.
        timeout: seconds after which a job is given up.
        prepare: called once in each process before its first job.
        arguments: what ``prepare`` is called with.

    A failed job yields ``{"key": ..., "error": ...}``: a row, not a gap.

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
    with ProcessPool(max_workers=workers, initializer=prepare, initargs=arguments) as pool:
        running = {pool.schedule(work, args=[job], timeout=timeout): job for job in jobs}
        try:
            for future in as_completed(running):
                problem = future.exception()
                if problem is None:
                    yield future.result()
                else:
                    yield _failure(running[future], problem)
        finally:
            pool.stop()


def _failure(job: Any, problem: BaseException) -> dict[str, Any]:
    return {"key": job.key, "error": f"{type(problem).__name__}: {problem}"}
