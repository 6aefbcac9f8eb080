"""Jobs on Ray: a pool of actors with one job each, on this machine or on a cluster."""

from __future__ import annotations

import logging
import os
import socket
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Generic

from packenv.errors import InputError, RobotPackError

from .outcome import Attempt, J, Outcome, Prepare, Unprepared, attempt, one_line, try_prepare
from .termination import handler_kept, terminable

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
"""Environment of a worker: each has a core of its own."""
STORE = 100 * 2**20
"""Bytes of shared memory of a Ray of our own: jobs and rows are small."""
CONNECT = 10.0
"""Seconds in which a cluster's head has to answer."""
DEATHS = 3
"""Workers that may die one after another before they are prepared; at least as many as there are, of a node lost."""


def load() -> None:
    """Import what this needs, and have it tell nobody of its use.

    Raises:
        InputError: it is not installed.
    """
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    try:
        import ray  # noqa: F401
    except ModuleNotFoundError:
        raise InputError("Ray is not installed: pip install 'robotpack[ray]'") from None


def run(
    work: Callable[[J], dict[str, Any]],
    jobs: Iterable[J],
    *,
    workers: int | None,
    timeout: float,
    prepare: Prepare,
    arguments: tuple[Any, ...],
    address: str | None,
) -> Generator[Outcome[J], None, None]:
    """See :func:`packenv.backends.imap_unordered`."""
    source = _Source(iter(jobs))
    if not source.holds(1):
        return
    with terminable(), _silent(), connected(workers, address) as wanted:
        yield from _Crew(work, source, wanted, timeout, prepare, arguments).outcomes()


@contextmanager
def connected(workers: int | None, address: str | None) -> Iterator[int]:
    """Be connected to Ray, and leave it if we were not so before.

    Args:
        workers: CPUs of a Ray of our own; None: all that there are.
        address: of the cluster to join; None: a Ray of our own.

    Returns:
        How many workers there are to be.

    Raises:
        InputError: the cluster does not answer.
    """
    import ray

    ours = not ray.is_initialized()
    if ours:
        with handler_kept():
            _connect(workers, address)
    try:
        yield workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
    finally:
        if ours:
            ray.shutdown()


def _connect(workers: int | None, address: str | None) -> None:
    import ray

    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    if address is None:
        size = {} if workers is None else {"num_cpus": workers}
        ray.init("local", **size, include_dashboard=False, object_store_memory=STORE, **quiet)
        return
    try:
        host, colon, port = address.removeprefix("ray://").rpartition(":")
        if colon:  # Ray itself tries for minutes
            socket.create_connection((host, int(port)), timeout=CONNECT).close()
        ray.init(address, **quiet)
    except (OSError, RuntimeError, ValueError) as problem:
        raise InputError(
            f"no Ray cluster can be joined at {address!r} ({one_line(problem):.200}), give its head's address"
        ) from None


@contextmanager
def _silent() -> Iterator[None]:
    """Keep off standard output what Ray prints of each worker that dies: the job's outcome tells of it."""
    from ray._private import worker

    before = getattr(worker, "print_to_stdstream", None)  # not public: a later Ray may have none
    worker.print_to_stdstream = lambda *_, **__: None
    try:
        yield
    finally:
        worker.print_to_stdstream = before


class _Source(Generic[J]):
    """Jobs that wait; whether there are so many is known before one is taken."""

    def __init__(self, jobs: Iterator[J]) -> None:
        self._jobs = jobs
        self._seen: deque[J] = deque()

    def holds(self, count: int) -> bool:
        self._seen.extend(islice(self._jobs, max(0, count - len(self._seen))))
        return len(self._seen) >= count

    def take(self) -> J:
        return self._seen.popleft()


class _Worker:
    """What an actor is."""

    def prepare(self, prepare: Prepare, arguments: tuple[Any, ...]) -> Unprepared | None:
        return try_prepare(prepare, arguments)

    def attempt(self, work: Callable[[J], dict[str, Any]], job: J) -> Attempt:
        return attempt(work, job)


@dataclass(frozen=True)
class _Busy(Generic[J]):
    """An actor at its job, since when."""

    actor: Any
    job: J
    since: float


@dataclass
class _Crew(Generic[J]):
    """The actors of a run, by the answer that each owes."""

    work: Callable[[J], dict[str, Any]]
    source: _Source[J]
    wanted: int
    timeout: float
    prepare: Prepare
    arguments: tuple[Any, ...]
    starting: dict[Any, Any] = field(default_factory=dict)
    busy: dict[Any, _Busy[J]] = field(default_factory=dict)
    deaths: int = 0
    actors: Any = field(default_factory=lambda: _actor_class())

    def outcomes(self) -> Iterator[Outcome[J]]:
        """Do all jobs."""
        try:
            while self.source.holds(1) or self.busy:
                self._fill()
                for answer in self._answers():
                    if answer in self.starting:
                        self._started(answer)
                    else:
                        yield self._ended(answer)
                yield from self._overdue()
        finally:
            for actor in [*self.starting.values(), *(busy.actor for busy in self.busy.values())]:
                _kill(actor)

    def _fill(self) -> None:
        """Start actors until there are as many as are wanted, or as there are jobs for."""
        while len(self.starting) + len(self.busy) < self.wanted and self.source.holds(len(self.starting) + 1):
            actor = self.actors.remote()
            self.starting[actor.prepare.remote(self.prepare, self.arguments)] = actor

    def _answers(self) -> list[Any]:
        """What is there, as soon as anything is or a job is overdue."""
        import ray

        owed = [*self.starting, *self.busy]
        if not ray.wait(owed, timeout=self._time_left())[0]:
            return []
        return list(ray.wait(owed, num_returns=len(owed), timeout=0)[0])

    def _time_left(self) -> float | None:
        """Of the job that began first, s."""
        for busy in self.busy.values():
            return max(0.0, busy.since + self.timeout - time.perf_counter())
        return None

    def _started(self, answer: Any) -> None:
        import ray

        actor = self.starting.pop(answer)
        try:
            unprepared = ray.get(answer)
        except ray.exceptions.RayError as problem:
            _kill(actor)
            self.deaths += 1
            if self.deaths < max(DEATHS, self.wanted) and not isinstance(
                problem, ray.exceptions.RayTaskError
            ):
                return
            raise RobotPackError(f"Ray's workers die before their first job: {one_line(problem)}") from None
        if unprepared is not None:
            unprepared.raise_it()
        self.deaths = 0
        self._give(actor)

    def _give(self, actor: Any) -> None:
        """The next job to an actor that is free."""
        if self.source.holds(1):
            job = self.source.take()
            self.busy[actor.attempt.remote(self.work, job)] = _Busy(actor, job, time.perf_counter())
        else:
            _kill(actor)

    def _ended(self, answer: Any) -> Outcome[J]:
        import ray

        busy = self.busy.pop(answer)
        seconds = time.perf_counter() - busy.since
        try:
            attempted: Attempt = ray.get(answer)
            outcome = attempted.outcome(busy.job)
        except ray.exceptions.RayTaskError as problem:  # a job or row that cannot be pickled
            outcome = Outcome(busy.job, None, "failed", one_line(problem.cause), seconds)
        except ray.exceptions.RayError:
            _kill(busy.actor)
            return Outcome(busy.job, None, "died", "its process died", seconds)
        self._give(busy.actor)
        return outcome

    def _overdue(self) -> Iterator[Outcome[J]]:
        """The outcomes of jobs that take too long, whose actors are ended."""
        import ray

        while self._time_left() == 0.0:
            answer, busy = next(iter(self.busy.items()))
            if ray.wait([answer], timeout=0)[0]:  # it came meanwhile
                return
            del self.busy[answer]
            _kill(busy.actor)
            seconds = time.perf_counter() - busy.since
            yield Outcome(busy.job, None, "timeout", f"it took longer than {self.timeout:g} s", seconds)


def _actor_class() -> Any:
    import ray

    return ray.remote(num_cpus=1, runtime_env={"env_vars": ONE_THREAD})(_Worker)


def _kill(actor: Any) -> None:
    import ray

    ray.kill(actor)
