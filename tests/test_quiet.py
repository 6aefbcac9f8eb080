"""What libraries print from C does not get into our standard output."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import highspy

from packenv.planning.stability import solvers
from packenv.quiet import engine_muted
from tests.conftest import REPO


class Talkative:
    """Sets up its callbacks in the constructor and tells its version then, as HiGHS 1.16 does."""

    def __init__(self) -> None:
        self.options: dict[str, object] = {"output_flag": True}
        self.enableCallbacks()

    def setOptionValue(self, name: str, value: object) -> None:  # noqa: N802
        self.options[name] = value

    def enableCallbacks(self) -> None:  # noqa: N802
        if self.options["output_flag"]:
            os.write(1, b"Running HiGHS\n")


def test_a_talkative_solver_is_made_in_silence(monkeypatch, capfd):
    monkeypatch.setattr(highspy, "Highs", Talkative)
    monkeypatch.setattr(solvers, "_local", threading.local())
    assert solvers.highs_solver() is solvers.highs_solver()
    assert capfd.readouterr() == ("", "")
    Talkative()
    assert capfd.readouterr().out == "Running HiGHS\n"


def test_the_solvers_print_nothing_in_a_fresh_process():
    code = """
from packenv.planning.stability.equilibrium import build_equilibrium
from packenv.planning.stability.solvers import highs_solver, solve_cvxpy
from tests.planning.stability import piles
box = build_equilibrium(*piles.box_on_floor().args)
assert solve_cvxpy(box).solver == "cvxpy/HIGHS"
highs_solver()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, cwd=REPO)
    assert (done.stdout, done.stderr) == (b"", b"")


def test_muted_means_the_file_descriptors(capfd):
    with engine_muted():
        os.write(1, b"out")
        os.write(2, b"err")
        with engine_muted():
            os.write(1, b"out")
        os.write(1, b"still")
    os.write(1, b"heard")
    assert capfd.readouterr() == ("heard", "")


def test_threads_that_mute_at_once_leave_the_output_as_it_was(capfd):
    gate = threading.Barrier(8)

    def work() -> None:
        gate.wait()
        for _ in range(50):
            with engine_muted():
                os.write(1, b"x")

    before = len(list(Path("/dev/fd").iterdir()))
    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    os.write(1, b"heard")
    assert capfd.readouterr() == ("heard", "")
    assert len(list(Path("/dev/fd").iterdir())) == before
