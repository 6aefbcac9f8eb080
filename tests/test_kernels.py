"""Compiled functions on disk: read where nothing that they froze has changed, compiled again where it has."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import packenv
from packenv import kernels

FILES = {
    "constants.py": "STEP = 2.0\nTABLE = (3.0, 4.0)\nOTHER = 5.0\n",
    "deep.py": """
import numpy as np
from constants import TABLE
from packenv.kernels import compiled
ROW = np.array([6.0, 7.0])
@compiled
def deepest(x):
    return x * TABLE[1] + ROW[1]
""",
    "called.py": """
from deep import deepest
from packenv.kernels import compiled_like_numpy
@compiled_like_numpy
def callee(x):
    return deepest(x) + 8.0
""",
    "kernel.py": """
import constants
from called import callee
from constants import STEP
from packenv.kernels import compiled
@compiled
def kernel(x):
    return callee(x) * STEP + constants.OTHER
print(kernel(1.0), sum(kernel.stats.cache_hits.values()))
""",
}
"""A kernel, what it calls and what it names, each in a file of its own."""


def answer(folder: Path) -> tuple[float, bool]:
    """What the kernel gives in a process of its own, and whether its code came from disk."""
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{Path(packenv.__file__).parents[1]}"}
    ran = [sys.executable, str(folder / "kernel.py")]
    done = subprocess.run(ran, env=environment, capture_output=True, text=True, check=True)
    value, hits = done.stdout.split()
    return float(value), hits != "0"


def value_of(texts: dict[str, str]) -> float:
    """The same from the files' texts, without numba."""
    step, table, other = (
        float(m) if "," not in m else float(m.split(",")[1])
        for m in re.findall(r"= \(?([\d., ]+)", texts["constants.py"])
    )
    (row,) = re.findall(r"6\.0, ([\d.]+)", texts["deep.py"])
    (plus,) = re.findall(r"deepest\(x\) \+ ([\d.]+)", texts["called.py"])
    return (table + float(row) + float(plus)) * step + other


EDITS = {
    "a constant": ("constants.py", "STEP = 2.0", "STEP = 3.0"),
    "a module's constant": ("constants.py", "OTHER = 5.0", "OTHER = 6.0"),
    "a tuple that a callee's callee names": ("constants.py", "4.0)", "9.0)"),
    "an array that it names": ("deep.py", "7.0]", "9.0]"),
    "a callee in another file": ("called.py", "8.0", "9.0"),
}


def test_an_edit_of_what_a_kernel_froze_is_followed(tmp_path: Path) -> None:
    """The kernel's own file stays as it is, which is all that numba looks at."""
    texts = dict(FILES)
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    assert answer(tmp_path) == (value_of(texts), False)
    assert answer(tmp_path) == (value_of(texts), True)
    for what, (file, before, after) in EDITS.items():
        old = value_of(texts)
        texts[file] = texts[file].replace(before, after)
        (tmp_path / file).write_text(texts[file])
        assert answer(tmp_path) == (value_of(texts), False) != (old, False), what
    assert answer(tmp_path) == (value_of(texts), True)


def test_all_kernels_are_compiled_in_one_way() -> None:
    """So that each of them follows what it froze."""
    root = Path(packenv.__file__).parent
    files = [f.relative_to(root).as_posix() for f in root.rglob("*.py") if "numba" in f.read_text("utf-8")]
    named = [f for f in files if re.search(r"^\s*(from|import) numba", (root / f).read_text("utf-8"), re.M)]
    assert named == ["kernels.py"]


def test_where_no_folder_can_be_written_each_process_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba raises there: an installed package that is read-only, and a user without a home."""

    def nowhere(function: object) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(kernels, "_FrozenCache", nowhere)
    assert kernels.compiled(lambda x: x + 1.0)(1.0) == 2.0


def test_constants_in_calls_share_one_code() -> None:
    """Numba alone compiles a callee for each of them; what is computed stays the same."""

    @kernels.compiled
    def power(x, n):  # type: ignore[no-untyped-def]
        return x**n + n

    both = kernels.compiled(lambda x: power(x, 2) + power(x, 3))
    assert both(3.0) == 9.0 + 2 + 27.0 + 3
    assert len(power.signatures) == 1
