"""Who is told to end takes its workers along."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def terminable() -> Iterator[None]:
    """End on SIGTERM as on any error: a process that is simply gone leaves its workers at work."""
    before = signal.getsignal(signal.SIGTERM)
    with handler_kept():
        if before not in (None, signal.SIG_IGN) and _may_handle():
            signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
        yield


@contextmanager
def handler_kept() -> Iterator[None]:
    """Put back what handles SIGTERM now, whatever sets another one meanwhile."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        if before is not None and _may_handle():
            signal.signal(signal.SIGTERM, before)


def _may_handle() -> bool:
    return threading.current_thread() is threading.main_thread()
