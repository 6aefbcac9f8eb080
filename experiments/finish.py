"""Measurements of many jobs: a run that goes on where it stopped."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from tqdm import tqdm

import packenv
from packenv.backends import imap_unordered
from packenv.io.rows import RowFile


@cache
def product_code() -> str:
    """Digest of the product's source: a row that an older one left is none of this one's."""
    digest = hashlib.sha256()
    folder = Path(packenv.__file__).parent
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def finish(
    work: Callable[[Any], dict[str, Any]],
    jobs: Sequence[Any],
    *,
    out: Path,
    workers: int,
    timeout: float,
    prepare: Callable[..., None],
    arguments: tuple[Any, ...],
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Do the jobs that have no row yet, or one that tells of a failure.

    Args:
        work: a job to its row.
        jobs: each with a ``key``.
        out: the file of rows.
        workers: number of processes; 0 runs everything in this one.
        timeout: as in :func:`packenv.backends.imap_unordered`, s.
        prepare: likewise.
        arguments: likewise.

    Returns:
        The rows of all these jobs, and those of them that tell of a failure.
    """
    file = RowFile(out)
    missing = [job for job in jobs if job.key not in file]
    outcomes = imap_unordered(
        work,
        missing,
        backend="pebble" if workers else "serial",
        workers=workers or None,
        timeout=timeout,
        prepare=prepare,
        arguments=arguments,
    )
    for outcome in tqdm(outcomes, total=len(jobs), initial=len(jobs) - len(missing), disable=None):
        file.append(outcome.row or {"key": outcome.job.key, "error": outcome.error})
    wanted = {job.key for job in jobs}
    done = [row for row in file if row["key"] in wanted]
    return done, [row for row in done if "error" in row]
