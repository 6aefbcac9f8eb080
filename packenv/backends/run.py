"""The one entry to all backends."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from typing import Any

from packenv.errors import InputError

from . import pebble_pool, ray_pool, serial
from .outcome import BackendName, J, Outcome, Prepare

LONGEST = 1e9
"""Seconds that a time limit has at most: clocks of the system take no number that they have not."""


def imap_unordered(
    work: Callable[[J], dict[str, Any]],
    jobs: Iterable[J],
    *,
    backend: BackendName,
    workers: int | None,
    timeout: float,
    prepare: Prepare,
    arguments: tuple[Any, ...],
    start: str | None = None,
    ray_address: str | None = None,
) -> Generator[Outcome[J], None, None]:
    """Do jobs; yield the outcome of each as it ends, in any order.

    A job that raises, hangs or takes its process down costs its own row alone (``serial``: if its process goes, so
    does the run). Workers end with the generator, on Ctrl-C and on SIGTERM: close it where it is left early.

    Args:
        work: a job to its row; module-level, since it is pickled, as jobs and rows are.
        jobs: taken as they are needed.
        backend: ``serial``: in this process; ``pebble``: on processes of this machine; ``ray``: on Ray.
        workers: number of processes; ``serial`` has no use for it. None: one for each CPU of the Ray cluster.
        timeout: seconds after which a job is given up, from its own start. ``serial`` keeps it in the main thread
            on Unix, as soon as Python code runs; elsewhere a job may take as long as it likes.
        prepare: called once in each process before its first job; it may take any time.
        arguments: what ``prepare`` is called with.
        start: how processes of ``pebble`` start, as :mod:`multiprocessing` names it: ``spawn`` where this one may
            hold threads, which a fork does not survive. None takes the system's way.
        ray_address: the cluster that is joined, as ``ray.init`` takes it. None: what this process is connected to
            already, or else a Ray of our own on this machine.

    Raises:
        InputError: the backend is not installed, the cluster does not answer, or ``prepare`` raises it.
        RobotPackError: a worker could not be prepared.
    """
    timeout = min(timeout, LONGEST)
    if backend == "serial":
        return serial.run(work, jobs, timeout=timeout, prepare=prepare, arguments=arguments)
    if workers is not None and workers < 1:
        raise InputError(f"workers is {workers}, give 1 or more")
    if backend == "ray":
        ray_pool.load()
        return ray_pool.run(
            work,
            jobs,
            workers=workers,
            timeout=timeout,
            prepare=prepare,
            arguments=arguments,
            address=ray_address,
        )
    if workers is None:
        raise InputError("worker processes on this machine need a number of workers, give 1 or more")
    pebble_pool.load()
    return pebble_pool.run(
        work, jobs, workers=workers, timeout=timeout, prepare=prepare, arguments=arguments, start=start
    )
