"""Keeps what PyBullet prints from C out of a program's own output."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def engine_muted() -> Iterator[None]:
    """Send what C code prints meanwhile, on standard output and on standard error, to nowhere."""
    kept = []
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for number in (1, 2):
            try:
                kept.append((number, os.dup(number)))
            except OSError:  # closed: nothing can be printed there
                continue
            os.dup2(nowhere, number)
        yield
    finally:
        # C keeps what it prints until its buffer is full; it would come out after we have turned back.
        ctypes.CDLL(None).fflush(None)
        for number, copy in kept:
            os.dup2(copy, number)
            os.close(copy)
        os.close(nowhere)
