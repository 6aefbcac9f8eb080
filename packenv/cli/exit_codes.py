"""How a program ends: exit codes, and one line for what went wrong."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from pathlib import Path

from packenv.errors import RobotPackError


def reported(program: str, work: Callable[[], int], *, stopped: str = "stopped") -> int:
    """Do a program's work; tell what it raises in one line.

    Args:
        program: its name, before that line.
        work: returns the exit code.
        stopped: the line where the user interrupts it.

    Returns:
        What ``work`` returns; 2 for bad input and files that cannot be used, 130 where the user stopped it,
        141 where nobody reads the output any more.
    """
    try:
        _print_what_the_terminal_can()
        code = work()
        sys.stdout.flush()
    except RobotPackError as problem:
        print(f"{program}: {problem}", file=sys.stderr)  # noqa: T201
        return 2
    except KeyboardInterrupt:
        print(f"{program}: {stopped}", file=sys.stderr)  # noqa: T201
        return 130
    except BrokenPipeError:
        # The reader of our output has gone (`... | head`); say nothing more, not even at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as problem:
        # Files name themselves in errors of their own; what is left is the output, or a path that the
        # system refuses before it is opened: too long, or in a folder that may not be entered.
        where = problem.filename if problem.filename is not None else "standard output"
        print(f"{program}: {where}: {problem.strerror}", file=sys.stderr)  # noqa: T201
        return 2
    return code


def _print_what_the_terminal_can() -> None:
    """Replace what standard output cannot encode (°, ±) instead of failing; refuse a closed one."""
    if sys.stdout is None:
        sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115
    elif isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
