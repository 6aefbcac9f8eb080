"""Keeps what C code prints out of a program's own output."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_lock = threading.Lock()
_kept: list[tuple[int, int]] = []
_depth = 0


@contextmanager
def engine_muted() -> Iterator[None]:
    """Send what C code prints meanwhile, on standard output and on standard error, to nowhere.

    It is the process that is muted, not the thread; of several threads, the last one to leave turns back.
    """
    global _depth
    with _lock:
        if not _depth:
            _turn_away()
        _depth += 1
    try:
        yield
    finally:
        with _lock:
            _depth -= 1
            if not _depth:
                _turn_back()


def _turn_away() -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for number in (1, 2):
        try:
            _kept.append((number, os.dup(number)))
        except OSError:  # closed: nothing can be printed there
            continue
        os.dup2(nowhere, number)
    os.close(nowhere)


def _turn_back() -> None:
    # C keeps what it prints until its buffer is full; it would come out after we have turned back.
    ctypes.CDLL(None).fflush(None)
    while _kept:
        number, copy = _kept.pop()
        os.dup2(copy, number)
        os.close(copy)
