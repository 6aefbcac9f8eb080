"""Fixtures that several test packages share."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Generator
from pathlib import Path

import pytest

from packenv.errors import PhysicsError

PHYSICS = importlib.util.find_spec("pybullet") is not None
NO_PHYSICS = "pybullet is not installed: it is there for Python 3.10 and 3.11 on Linux x86-64"
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


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Skip a module that imports physics where pybullet is not installed."""
    report = yield
    found = report.call.excinfo if report.call is not None else None
    if not PHYSICS and found is not None and isinstance(found.value, PhysicsError):
        report.outcome = "skipped"
        report.longrepr = (str(collector.path), 0, f"Skipped: {found.value}")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup() -> Generator[None, None, None]:
    """Skip a test whose fixtures come to physics where pybullet is not installed."""
    return (yield from _skipped_without_physics())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, None, None]:
    """Skip a test that comes to physics where pybullet is not installed."""
    return (yield from _skipped_without_physics())


def _skipped_without_physics() -> Generator[None, None, None]:
    try:
        return (yield)
    except PhysicsError as problem:
        if PHYSICS:
            raise
        pytest.skip(str(problem))
