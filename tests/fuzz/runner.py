"""Reading many damaged inputs in a process of their own: what may come of each, its time and its memory."""

from __future__ import annotations

import faulthandler
import multiprocessing
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from random import Random
from typing import NamedTuple, TypeAlias

from packenv.errors import InputError

MOST_SECONDS = 2.0
MOST_BYTES = 400 * 10**6
_HANGS = 60.0

Reads: TypeAlias = Callable[[], object]
MakeOne: TypeAlias = Callable[[Random], tuple[str, Reads]]
"""From a random source: what the input is called, and what reads it and checks what was read."""


class Outcome(NamedTuple):
    """What became of some inputs.

    Attributes:
        read: how many were read and sound.
        refused: how many ended in a one-line error of the user's.
        failures: what came of the others, one text each.
        seconds: CPU-seconds of the slowest.
        peak: most memory of the process while an input was read, bytes; 0 where the system does not say.
    """

    read: int
    refused: int
    failures: tuple[str, ...]
    seconds: float
    peak: int


def fuzz(make: Callable[[Path], MakeOne], seed: int, count: int) -> Outcome:
    """Read ``count`` inputs in a process of their own and say what became of them.

    Args:
        make: a function of a module, given an empty folder: how one input is made.
        seed: of the inputs; input k of a seed is always the same.
        count: number of inputs.
    """
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_fuzz, make, seed, count).result()


def _fuzz(make: Callable[[Path], MakeOne], seed: int, count: int) -> Outcome:
    read, refused, failures, slowest, highest = 0, 0, [], 0.0, 0
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        one = make(Path(folder))
        warnings.simplefilter("error", RuntimeWarning)
        for k in range(count):
            name, reads = one(Random(f"{seed} {k}"))
            faulthandler.dump_traceback_later(_HANGS, exit=True)
            _forget_peak()
            start = time.process_time()
            try:
                reads()
                read += 1
            except InputError as problem:
                refused += 1
                said = str(problem)
                if "\n" in said or len(said) < 20 or "MemoryError" in said:
                    failures.append(f"{seed} {k} {name}: says {said!r}")
            except Exception:
                failures.append(f"{seed} {k} {name}: {traceback.format_exc()}")
            seconds, peak = time.process_time() - start, _peak()
            slowest, highest = max(slowest, seconds), max(highest, peak)
            if seconds > MOST_SECONDS or peak > MOST_BYTES:
                failures.append(f"{seed} {k} {name}: {seconds:.1f} s, {peak / 1e6:.0f} MB")
    faulthandler.cancel_dump_traceback_later()
    return Outcome(read, refused, tuple(failures), slowest, highest)


def _forget_peak() -> None:
    """Begin anew to measure the most memory, where the system can."""
    control = Path("/proc/self/clear_refs")
    if control.exists():
        control.write_text("5")


def _peak() -> int:
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM")), 0)


def check(outcome: Outcome, count: int, least_read: float) -> None:
    """Nothing but sound results and the user's errors; and the damage was neither harmless nor total.

    Args:
        outcome: of ``count`` inputs.
        count: see there.
        least_read: share of the inputs that are read in spite of their damage, at least.
    """
    assert not outcome.failures, f"{len(outcome.failures)} of {count}:\n" + "\n".join(outcome.failures[:10])
    assert outcome.read + outcome.refused == count
    assert outcome.read >= least_read * count
    assert outcome.refused >= 0.2 * count
