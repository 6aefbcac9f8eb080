"""The names that a user types after ``python -m``, and what importing the package loads."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from packenv import __version__
from tests.conftest import REPO


def python(*arguments: str) -> str:
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=True, cwd=REPO)
    assert done.stderr == ""
    return done.stdout


@pytest.mark.parametrize("name", ["agents", "train", "packenv.agents", "packenv.train"])
def test_a_module_calls_itself_what_was_typed(name):
    assert python("-m", name, "--help").startswith(f"usage: python -m {name} ")


def test_the_package_is_a_command():
    assert python("-m", "packenv", "--version") == f"robotpack {__version__}\n"


def test_a_top_level_module_works_as_the_installed_one_does():
    settings = '{"mask": "legal"}'
    arguments = ("--agent", "hm,random", "--episodes", "2", "--workers", "2", "--env-config", settings)
    typed, installed = (
        json.loads(python("-m", name, *arguments, "--json"))["agents"]
        for name in ("agents", "packenv.agents")
    )
    for line in typed + installed:
        line.pop("steps_per_s")
    assert typed == installed


def test_the_package_loads_neither_torch_nor_physics_nor_agents():
    seen = python("-c", "import packenv, sys; print(*sys.modules)").split()
    assert not {"torch", "pybullet", "highspy", "packenv.agents", "packenv.train", "agents"} & set(seen)
