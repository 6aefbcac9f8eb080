"""Jobs on processes of this machine."""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, TimeoutError as TooLateError  # on Python 3.10 not the built-in one
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import chain, islice
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeAlias

from packenv.errors import InputError, RobotPackError

from .outcome import Attempt, J, Outcome, Prepare, Unprepared, attempt, one_line, try_prepare
from .termination import terminable

if TYPE_CHECKING:
    from pebble import ProcessPool

AHEAD = 2
"""Jobs a worker that are handed over: one that is done and one that waits, so that the worker does not."""
LOOK = 1.0
"""Seconds after which we look whether the pool still works."""

_Answer: TypeAlias = "Future[Attempt | Unprepared]"


def load() -> None:
    """Import what this needs.

    Raises:
        InputError: it is not installed.
    """
    try:
        import pebble  # noqa: F401
    except ModuleNotFoundError:
        raise InputError("worker processes need pebble: pip install 'robotpack[bench]'") from None


def run(
    work: Callable[[J], dict[str, Any]],
    jobs: Iterable[J],
    *,
    workers: int,
    timeout: float,
    prepare: Prepare,
    arguments: tuple[Any, ...],
    start: str | None,
) -> Generator[Outcome[J], None, None]:
    """See :func:`packenv.backends.imap_unordered`."""
    waiting: Iterator[J] = iter(jobs)
    with terminable():
        while (first := list(islice(waiting, AHEAD * workers))) != []:
            waiting = chain(first, waiting)
            # As many processes as jobs: all of them start at once, and each opens the catalogue.
            with _pool(min(workers, len(first)), prepare, arguments, start) as pool:
                done, lost = 0, list[J]()
                for outcome in _until_broken(pool, work, waiting, AHEAD * workers, timeout, lost):
                    done += 1
                    yield outcome
            if not done:
                raise RobotPackError("worker processes end before their first job is done")
            waiting = chain(lost, waiting)


def _until_broken(
    pool: ProcessPool,
    work: Callable[[J], dict[str, Any]],
    waiting: Iterator[J],
    most: int,
    timeout: float,
    lost: list[J],
) -> Iterator[Outcome[J]]:
    """The outcomes of one pool; a pool breaks where a worker without a job dies, and its jobs are lost."""
    answers: SimpleQueue[_Answer] = SimpleQueue()
    handed: dict[_Answer, tuple[J, float]] = {}

    def hand_over(job: J) -> None:
        future = pool.schedule(_attempt, args=(work, job), timeout=timeout)
        handed[future] = job, time.perf_counter()
        future.add_done_callback(answers.put)

    for job in islice(waiting, most):
        hand_over(job)
    while handed:
        try:
            future = answers.get(timeout=LOOK)
        except Empty:
            if pool.active:
                continue
            break
        if isinstance(future.exception(), BrokenProcessPool):
            break
        job, since = handed.pop(future)
        for following in islice(waiting, 1):
            try:
                hand_over(following)
            except RuntimeError:  # it broke since
                lost.append(following)
        yield _outcome(future, job, time.perf_counter() - since, timeout)
    lost.extend(job for job, _ in handed.values())


def _outcome(future: _Answer, job: J, seconds: float, timeout: float) -> Outcome[J]:
    from pebble import ProcessExpired

    try:
        answer = future.result()
    except TooLateError:  # pebble's own: the work's is in its attempt
        return Outcome(job, None, "timeout", f"it took longer than {timeout:g} s", min(seconds, timeout))
    except ProcessExpired as problem:
        return Outcome(job, None, "died", f"its process died ({_ending(problem.exitcode)})", seconds)
    except Exception as problem:  # a job or row that cannot be pickled
        return Outcome(job, None, "failed", one_line(problem), seconds)
    if isinstance(answer, Unprepared):
        answer.raise_it()
    return answer.outcome(job)


def _ending(code: int) -> str:
    """An exit code of :mod:`multiprocessing` in words; some signals have no name."""
    if code >= 0:
        return f"exit code {code}"
    return signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"


@contextmanager
def _pool(
    workers: int, prepare: Prepare, arguments: tuple[Any, ...], start: str | None
) -> Iterator[ProcessPool]:
    """Processes that end at the end, whatever they are at."""
    from pebble import ProcessPool

    context = multiprocessing.get_context(start)
    with ProcessPool(workers, initializer=_begin, initargs=(prepare, arguments), context=context) as pool:
        try:
            yield pool
        finally:
            pool.stop()  # type: ignore[no-untyped-call]


_unprepared: Unprepared | None = None
"""Of this worker: why it is not prepared."""


def _begin(prepare: Prepare, arguments: tuple[Any, ...]) -> None:
    """A worker's first call: it dies at once when told to, whatever it has inherited."""
    global _unprepared
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    _unprepared = try_prepare(prepare, arguments)


def _attempt(work: Callable[[J], dict[str, Any]], job: J) -> Attempt | Unprepared:
    return _unprepared or attempt(work, job)
