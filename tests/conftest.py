"""Fixtures that several test packages share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

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
