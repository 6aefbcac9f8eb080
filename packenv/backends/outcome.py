"""What became of a job, and one attempt at it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, Literal, NoReturn, TypeAlias, TypeVar

from packenv.errors import InputError, RobotPackError

BackendName = Literal["serial", "pebble", "ray"]
Status = Literal["ok", "failed", "timeout", "died"]
Prepare: TypeAlias = Callable[..., None]
J = TypeVar("J")


@dataclass(frozen=True)
class Outcome(Generic[J]):
    """What became of one job.

    Attributes:
        job: the job.
        row: what its work returned; None where it is not ok.
        status: ``failed``: it raised; ``timeout``: it took too long; ``died``: its process did.
        error: what happened, one line; empty where it is ok.
        seconds: wall time of the work alone; where the process is gone, since the job was handed over, at most.
    """

    job: J
    row: dict[str, Any] | None
    status: Status
    error: str
    seconds: float


@dataclass(frozen=True)
class Attempt:
    """One call of the work, as a worker reports it; no exception, which might not survive pickling.

    Attributes:
        row: what it returned; None where it raised.
        error: what it raised, one line.
        seconds: wall time.
    """

    row: dict[str, Any] | None
    error: str
    seconds: float

    def outcome(self, job: J) -> Outcome[J]:
        """The outcome of the job that was attempted."""
        return Outcome(job, self.row, "failed" if self.row is None else "ok", self.error, self.seconds)


def attempt(
    work: Callable[[J], dict[str, Any]], job: J, caught: type[BaseException] = BaseException
) -> Attempt:
    """Do a job.

    Args:
        work: the job to its row.
        job: the job.
        caught: what is reported; in a worker all, ``SystemExit`` as well, which would end it.
    """
    start = time.perf_counter()
    try:
        row = work(job)
    except caught as problem:
        return Attempt(None, one_line(problem), time.perf_counter() - start)
    return Attempt(row, "", time.perf_counter() - start)


def one_line(problem: BaseException) -> str:
    """The kind of an exception and its message."""
    return " ".join(f"{type(problem).__name__}: {problem}".split())


@dataclass(frozen=True)
class Unprepared:
    """Why a worker could not be prepared.

    Attributes:
        error: one line.
        of_input: whether the user's input is wrong.
    """

    error: str
    of_input: bool

    def raise_it(self) -> NoReturn:
        """Say so in the process that asked for the work.

        Raises:
            InputError: the user's input is wrong.
            RobotPackError: anything else.
        """
        if self.of_input:
            raise InputError(self.error)
        raise RobotPackError(f"a worker could not be prepared: {self.error}")


def try_prepare(prepare: Prepare, arguments: tuple[Any, ...]) -> Unprepared | None:
    """Prepare a worker.

    Args:
        prepare: what is called.
        arguments: with these.

    Returns:
        Why it is not prepared; None where it is.
    """
    try:
        prepare(*arguments)
    except InputError as problem:
        return Unprepared(str(problem), of_input=True)
    except BaseException as problem:
        return Unprepared(one_line(problem), of_input=False)
    return None
