"""What a command prints when it refuses its input."""

from __future__ import annotations

import pytest


def refused(capsys: pytest.CaptureFixture[str], code: int, *words: str) -> None:
    """Exit code 2, one line on standard error that names what is wrong, nothing on standard output."""
    printed = capsys.readouterr()
    assert code == 2
    assert printed.out == ""
    (line,) = printed.err.strip().splitlines()
    assert line.startswith("robotpack: ")
    for word in words:
        assert word in line
