"""Files of arrays in the user's cache: a missing, damaged or foreign one is made anew, never believed."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from packenv.errors import InputError
from packenv.io.files import write_whole

T = TypeVar("T")

_DIGEST = hashlib.sha256().digest_size
_ABANDONED = 3600.0
"""A temporary file of this age is of a process that was killed, s."""


def default_folder() -> Path:
    """The cache folder: ``ROBOTPACK_CACHE``, else the platform's for the user, else one for temporary files.

    The last is for a user without a home, as in containers and under service managers.
    """
    if named := os.environ.get("ROBOTPACK_CACHE"):
        return Path(named)
    from platformdirs import user_cache_path

    with contextlib.suppress(RuntimeError):
        folder = user_cache_path("robotpack", appauthor=False, opinion=False)
        if folder.is_absolute():
            return folder
    user = os.getuid() if hasattr(os, "getuid") else "user"
    return Path(tempfile.gettempdir()) / f"robotpack-{user}"


@dataclass(frozen=True)
class CacheFile:
    """Arrays in one file of the cache, after the digest of its key and of its content.

    So whatever is read is what was written, for this very key: no damage and no other file passes for it.

    Attributes:
        cache: the cache's folder, named in messages.
        kind: of content, the folder inside it.
        key: all that the arrays were made of, the format of the file included.
    """

    cache: Path
    kind: str
    key: str

    @property
    def path(self) -> Path:
        """The file: the key's digest names it."""
        return self.cache / self.kind / f"{hashlib.sha256(self.key.encode()).hexdigest()[:40]}.cache"

    def read(self) -> dict[str, np.ndarray] | None:
        """The arrays by name, or None where the file is missing, damaged or foreign."""
        try:
            content = self.path.read_bytes()
        except OSError:
            return None
        if content[:_DIGEST] != self._digest(content[_DIGEST:]):
            return None
        with np.load(io.BytesIO(content[_DIGEST:]), allow_pickle=False) as stored:
            return dict(stored)

    def write(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Write the arrays, whole or not at all, and remove what processes that were killed left beside them.

        Raises:
            InputError: the cache folder cannot be written.
        """
        stream = io.BytesIO()
        np.savez(stream, **arrays)  # type: ignore[arg-type]
        content, path = stream.getvalue(), self.path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, self._digest(content) + content)
            self._remove_abandoned()
        except (OSError, InputError):
            raise InputError(
                f"cache folder {self.cache} cannot be written; set ROBOTPACK_CACHE to a folder that can"
            ) from None

    def kept(
        self,
        make: Callable[[], T],
        pack: Callable[[T], Mapping[str, np.ndarray]],
        unpack: Callable[[Mapping[str, np.ndarray]], T],
    ) -> T:
        """What the file holds, or what is made now and written.

        Raises:
            InputError: the cache folder cannot be written.
        """
        arrays = self.read()
        if arrays is not None:
            return unpack(arrays)
        made = make()
        self.write(pack(made))
        return made

    def _digest(self, content: bytes) -> bytes:
        digest = hashlib.sha256(self.key.encode())
        digest.update(content)
        return digest.digest()

    def _remove_abandoned(self) -> None:
        for left in self.path.parent.glob(".*.tmp"):
            # Another process may be writing it, or remove it first.
            with contextlib.suppress(OSError):
                if time.time() - left.stat().st_mtime > _ABANDONED:
                    left.unlink()
