"""Files of arrays in the user's cache: a missing, torn or foreign one is made anew, never trusted."""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np

from packenv.errors import InputError
from packenv.io.files import write_whole

T = TypeVar("T")


def default_folder() -> Path:
    """The cache folder: ``ROBOTPACK_CACHE``, else the platform's cache folder for the user."""
    if named := os.environ.get("ROBOTPACK_CACHE"):
        return Path(named)
    from platformdirs import user_cache_path

    return user_cache_path("robotpack", appauthor=False, opinion=False)


def read_arrays(path: Path, build: Callable[[Mapping[str, np.ndarray]], T]) -> T | None:
    """What ``build`` makes of a file's arrays, or None where the file is missing, torn or foreign."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            return build(stored)
    except (OSError, ValueError, KeyError, EOFError, IndexError, zipfile.BadZipFile, zlib.error):
        return None


def write_arrays(folder: Path, path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write a file of arrays, whole or not at all.

    Args:
        folder: the cache, named in messages.
        path: the file inside it.
        arrays: by name.

    Raises:
        InputError: the cache folder cannot be written.
    """
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, stream.getvalue())
    except (OSError, InputError):
        raise InputError(
            f"cache folder {folder} cannot be written; set ROBOTPACK_CACHE to a folder that can"
        ) from None
