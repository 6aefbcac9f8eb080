"""The built wheel in an empty environment, outside the checkout, with the newest releases of all it needs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path
from typing import Any

import pytest

from packenv import __version__
from tests.conftest import REPO

pytestmark = pytest.mark.slow

LEGAL = '{"mask": "legal"}'


class Installed:
    """A virtual environment with the wheel, and a folder to work in."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "work"
        self.folder.mkdir()
        self.bin = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
        hidden = ("PYTHONPATH", "PIP_CONSTRAINT")
        kept = {name: value for name, value in os.environ.items() if name not in hidden}
        self.environment = {**kept, "ROBOTPACK_CACHE": str(folder / "cache")}

    def run(self, *command: str | Path) -> subprocess.CompletedProcess[str]:
        program, *arguments = map(str, command)
        return subprocess.run(
            [str(self.bin / program), *arguments],
            capture_output=True,
            text=True,
            cwd=self.folder,
            env=self.environment,
        )

    def json(self, *command: str | Path) -> Any:
        """All of standard output, read as JSON."""
        done = self.run(*command, "--json")
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A wheel built from the source distribution, and one from the checkout."""
    found = []
    for name, options in (("by-sdist", ()), ("direct", ("--wheel",))):
        folder = tmp_path_factory.mktemp(name)
        pip = subprocess.run(
            [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", str(folder), "hatchling"],
            capture_output=True,
            text=True,
        )
        if pip.returncode:
            pytest.skip(f"pip reaches no index: {pip.stderr.strip().splitlines()[-1]:.200}")
        command = [sys.executable, "-m", "build", *options, "--outdir", str(folder / "dist"), str(REPO)]
        built = subprocess.run(command, capture_output=True, text=True)
        assert built.returncode == 0, built.stdout + built.stderr
        found += list((folder / "dist").glob("*.whl"))
    by_sdist, direct = found
    return by_sdist, direct


@pytest.fixture(scope="module")
def installed(wheels: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Installed:
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder / "venv", with_pip=True)
    there = Installed(folder)
    done = there.run("python", "-m", "pip", "install", "-q", "--only-binary", ":all:", wheels[0])
    assert done.returncode == 0, done.stderr
    (there.folder / "order.csv").write_text("item,qty\nmug,2\n")
    return there


@pytest.fixture(scope="module")
def plan(installed: Installed) -> str:
    packed = installed.json("robotpack", "pack", "order.csv", "--container", "0.3x0.2x0.2", "--out", "p.json")
    assert len(packed["steps"]) == 2
    return "p.json"


def test_both_wheels_hold_one_package_with_agents_and_training_in_it(wheels):
    names = [set(zipfile.ZipFile(wheel).namelist()) for wheel in wheels]
    assert names[0] == names[1]
    tops = {name.split("/")[0] for name in names[0]}
    assert tops == {"packenv", f"robotpack-{__version__}.dist-info"}
    for folder in ("agents", "train"):
        sources = {path.name for path in (REPO / folder).iterdir() if path.suffix in (".py", ".typed")}
        assert len(sources) > 10
        assert {f"packenv/{folder}/{name}" for name in sources} <= names[0]


def test_a_plan_is_made_and_audited(installed, plan):
    assert installed.json("robotpack", "verify", plan)
    for name in ("plan.html", "plan.png"):
        assert installed.run("robotpack", "view", plan, "-o", name).returncode == 0
        assert (installed.folder / name).stat().st_size > 10_000


def test_a_plan_is_carried_out(installed, plan):
    assert installed.json("robotpack", "execute", plan)["success"]


def test_items_are_checked_and_prepared(installed):
    shelf = installed.folder / "shelf"
    shelf.mkdir()
    mesh = REPO / "assets" / "catalogue" / "mug.ply"
    (shelf / mesh.name).write_bytes(mesh.read_bytes())
    assert installed.json("robotpack", "items", "check", "shelf")
    assert installed.json("robotpack", "items", "prepare", "shelf")


def test_modules_run_by_their_installed_names(installed):
    assert installed.run("python", "-m", "packenv", "--version").stdout == f"robotpack {__version__}\n"
    command = ("-m", "packenv.agents", "--agent", "hm,random", "--episodes", "2")
    table = installed.json("python", *command, "--env-config", LEGAL)
    assert [line["agent"] for line in table["agents"]] == ["hm", "random"]
    help_text = installed.run("python", "-m", "packenv.train", "--help").stdout
    assert help_text.startswith("usage: python -m packenv.train ")
    done = installed.run("python", "-m", "packenv.train", "--out", "run")
    assert done.returncode == 2
    assert "pip install 'robotpack[train]'" in done.stderr


def test_nothing_else_is_importable(installed):
    for name in ("agents", "train"):
        done = installed.run("python", "-c", f"import {name}")
        assert f"No module named '{name}'" in done.stderr
