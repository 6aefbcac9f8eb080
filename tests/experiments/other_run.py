"""Another process that writes a file of rows."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.conftest import REPO


@contextmanager
def other_run_at(out: Path) -> Iterator[None]:
    """Have a process that holds the lock of a file; it is killed at the end."""
    code = (
        "import time\nfrom pathlib import Path\nfrom packenv.experiments.runner import alone\n"
        f"with alone(Path({str(out)!r})):\n    print('in', flush=True)\n    time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=REPO) as other:
        try:
            assert other.stdout is not None
            assert other.stdout.readline() == b"in\n"
            yield
        finally:
            other.kill()
