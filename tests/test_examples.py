"""Every example runs to its own check, as a user would run it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[1]
NAMES = sorted(path.stem for path in (REPO / "examples").glob("*.py") if path.stem != "__init__")
NEEDS = {"train_with_sb3": "stable_baselines3", "play_trajectory": "pybullet"}
WRITES = {"pack_an_order": "plan.html", "own_meshes": "parts.glb", "play_trajectory": "trajectories.json"}


@pytest.mark.parametrize("name", NAMES)
def test_example(name: str, tmp_path: Path) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name], reason=f"{name} needs {NEEDS[name]}")
    env = {**os.environ, "PYTHONPATH": str(REPO)}
    done = subprocess.run(
        [sys.executable, "-m", f"examples.{name}"], cwd=tmp_path, env=env, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    if name in WRITES:
        assert (tmp_path / WRITES[name]).stat().st_size > 1000


def test_each_is_short_and_checks_something() -> None:
    assert len(NAMES) >= 6
    for name in NAMES:
        text = (REPO / "examples" / f"{name}.py").read_text()
        assert "assert " in text
        assert text.count("\n") <= 50


def test_the_own_heuristic_has_at_most_fifteen_lines() -> None:
    text = (REPO / "examples" / "my_heuristic.py").read_text()
    rule = text[text.index("def flattest") :].split("\n\n\n")[0]
    assert rule.count("\n") <= 15


def test_readme_and_api_show_the_lines_that_the_example_runs() -> None:
    lines = (REPO / "examples" / "pack_an_order.py").read_text().splitlines()
    shown = [line for line in lines[2 : lines.index('rp.show(plan, "plan.html")') + 1] if line]
    assert len(shown) == 7
    for page in ("README.md", "packenv/api.py"):
        text = [line.split("  #")[0].strip() for line in (REPO / page).read_text().splitlines()]
        assert [line for line in text if line in shown] == shown, page
