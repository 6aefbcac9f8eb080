"""Do many jobs, each of which leaves a row; a run that was stopped goes on where it was."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from tqdm import tqdm

from packenv.backends import BackendName, Outcome, imap_unordered
from packenv.errors import InputError
from packenv.io.rows import RowFile, read_rows

from .experiment import Row

_LINE_S = 60.0
"""Where no person watches a bar, a line tells of progress so often."""


class Keyed(Protocol):
    """A job."""

    @property
    def key(self) -> str:
        """Hash of all that its row depends on but the product's revision."""
        ...


@dataclass(frozen=True)
class Pool:
    """On what jobs are done.

    Attributes:
        backend: see :mod:`packenv.backends`.
        workers: processes; None: one for each CPU of a Ray cluster.
        ray_address: of a cluster.
        timeout: seconds after which a job is given up; None takes the experiment's.
    """

    backend: BackendName = "pebble"
    workers: int | None = 1
    ray_address: str | None = None
    timeout: float | None = None


@dataclass(frozen=True)
class Finished:
    """The rows of jobs.

    Attributes:
        rows: one of each job that has one, in the sequence of the jobs.
        broken: those of them that tell of a failure.
        missing: jobs without a row; none unless only rows that are there were asked for.
        new: rows that were made now.
        others: how many rows of these jobs other revisions left, by revision; where they were asked for, those that
            count before anything is done.
    """

    rows: tuple[Row, ...]
    broken: tuple[Row, ...] = ()
    missing: int = 0
    new: int = 0
    others: Counter[str] = field(default_factory=Counter)


def finish(
    work: Callable[[Any], dict[str, Any]],
    jobs: Sequence[Keyed],
    *,
    out: Path,
    pool: Pool,
    timeout: float,
    prepare: Callable[..., None],
    arguments: tuple[Any, ...],
    revision: str,
    head: Callable[[Any], dict[str, Any]] | None = None,
    any_revision: bool = False,
    only_read: bool = False,
    begin: Callable[[], None] = lambda: None,
    what: str = "jobs",
) -> Finished:
    """Do the jobs that have no row of this revision yet, or one that tells of a failure.

    Args:
        work: a job to its row; module-level, since it is pickled.
        jobs: each with a ``key``.
        out: the file of rows.
        pool: on what they are done.
        timeout: seconds after which a job is given up, unless the pool says so.
        prepare: called once in each worker before its first job.
        arguments: what ``prepare`` is called with.
        revision: of the product.
        head: what a row tells of its job.
        any_revision: rows of other revisions count, too.
        only_read: do nothing, read the rows that are there.
        begin: called once no other run can write the file; not where it is only read.
        what: is done, for the bar.

    Raises:
        InputError: the file holds something else than rows, another run writes it, or it cannot be written.
    """
    wanted = {job.key: job for job in jobs}
    with nullcontext() if only_read else alone(out):
        if not only_read:
            begin()
        found, others = _read(out, wanted, revision, any_revision=any_revision)
        missing = [job for key, job in wanted.items() if key not in found or "error" in found[key]]
        new = 0
        if missing and not only_read:
            file = RowFile(out)
            outcomes = imap_unordered(
                work,
                missing,
                backend=pool.backend,
                workers=pool.workers,
                timeout=pool.timeout or timeout,
                prepare=prepare,
                arguments=arguments,
                ray_address=pool.ray_address,
            )
            for outcome in _told(outcomes, what, len(wanted), len(wanted) - len(missing)):
                key = outcome.job.key
                row = {"key": key, "status": outcome.status, "revision": revision}
                row |= head(outcome.job) if head else {}
                row |= {"error": outcome.error} if outcome.row is None else outcome.row
                row["seconds"] = outcome.seconds
                try:
                    file.append(row)
                except OSError as problem:
                    raise InputError(
                        f"{out}: cannot be written ({problem.strerror}), make room; the same command goes on from there"
                    ) from None
                found[key] = row
                new += 1
    rows = tuple(found[key] for key in wanted if key in found)
    broken = tuple(row for row in rows if "error" in row)
    return Finished(rows, broken, len(wanted) - len(rows), new, others)


def _read(
    out: Path, wanted: Collection[str], revision: str, *, any_revision: bool
) -> tuple[dict[str, Row], Counter[str]]:
    """The last row of each job that is wanted, and how many rows there are of other revisions.

    Where these count, a job has its last row of this revision, else its last sound one, else its last one; only those
    that it has are told of.
    """
    found: dict[str, Row] = {}
    others: Counter[str] = Counter()
    for row in read_rows(out) if out.exists() else ():
        key, own = row["key"], row.get("revision") == revision
        if key not in wanted:
            continue
        if own:
            found[key] = row
        elif not any_revision:
            others[str(row.get("revision"))] += 1
        elif key not in found or (
            found[key].get("revision") != revision and ("error" not in row or "error" in found[key])
        ):
            found[key] = row
    if any_revision:
        others.update(str(row.get("revision")) for row in found.values() if row.get("revision") != revision)
    return found, others


def _told(rows: Iterable[Outcome[Any]], what: str, total: int, before: int) -> Iterator[Outcome[Any]]:
    """Outcomes as they come, with a bar of rate and time left on a terminal, else a line now and then."""
    if sys.stderr.isatty():
        yield from tqdm(rows, desc=what, total=total, initial=before, unit="row", file=sys.stderr)
        return
    began = last = time.monotonic()
    for done, row in enumerate(rows, 1):
        yield row
        now = time.monotonic()
        if now - last >= _LINE_S:
            last, rate = now, done / (now - began)
            left = (total - before - done) / rate
            told = f"{what}: {before + done} of {total} rows, {rate:.2g} a second, {left / 60:.0f} min left"
            print(told, file=sys.stderr, flush=True)  # noqa: T201


@contextmanager
def alone(out: Path) -> Iterator[None]:
    """Be the only process that writes a file of rows, where system and file system know locks.

    A record lock: workers do not inherit it, so those that a killed run leaves behind keep nobody out.

    Raises:
        InputError: another one writes it.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    try:
        import fcntl
    except ModuleNotFoundError:
        yield
        return
    with out.with_suffix(".lock").open("w") as lock:
        try:
            fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            raise InputError(f"{out}: another run writes it, wait for it or give another folder") from None
        except OSError:  # a file system without locks, as some that are shared
            pass
        yield
