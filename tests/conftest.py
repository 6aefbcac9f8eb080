"""Fixtures that several test packages share."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

import pytest

BULLET = importlib.util.find_spec("pybullet") is not None
NO_BULLET = "pybullet is not installed: it is there for Python 3.10 and 3.11 on Linux x86-64"
needs_bullet = pytest.mark.skipif(not BULLET, reason=NO_BULLET)
REPO = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def objects_dir() -> Path:
    """The folder of 94 scanned items, which is not ours to redistribute."""
    folder = Path(os.environ.get("ROBOTPACK_OBJECTS", REPO.parent / "shared" / "objects"))
    if not (folder / "objects.csv").is_file():
        pytest.skip(f"the scanned items are not at {folder}; set ROBOTPACK_OBJECTS to their folder")
    return folder


@pytest.fixture(autouse=True, scope="session")
def private_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Keep the tests' item cache apart from the user's."""
    os.environ.setdefault("ROBOTPACK_CACHE", str(tmp_path_factory.mktemp("robotpack-cache")))


@pytest.fixture(params=[pytest.param("bullet", marks=needs_bullet), "mujoco"])
def engine(request: pytest.FixtureRequest) -> str:
    """Name of a physics engine: every one in turn."""
    return str(request.param)


@pytest.fixture
def auto(engine: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """Every engine in turn is the one that ``auto`` finds."""
    package = {"bullet": "pybullet", "mujoco": "mujoco"}[engine]
    monkeypatch.setattr("packenv.sim.engines._installed", lambda name: name == package)
    return engine
