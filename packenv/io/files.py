"""Writing files whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from packenv.errors import InputError


def check_writable(path: Path, option: str) -> None:
    """Refuse an output path before any work is done for it.

    Args:
        path: the file to be written.
        option: the command-line option that named it, for the message.

    Raises:
        InputError: the path is a folder, or its folder does not exist or cannot be written.
    """
    folder = path.parent
    if path.is_dir():
        raise InputError(f"{option} {path}: is a folder, give a file name")
    if not folder.is_dir():
        raise InputError(f"{option} {path}: folder {folder} does not exist, create it first")
    if not os.access(folder, os.W_OK):
        raise InputError(f"{option} {path}: folder {folder} cannot be written")


def write_whole(path: Path, content: bytes) -> None:
    """Write a file by way of a temporary one beside it, so that no reader ever sees half of it.

    Raises:
        InputError: the file cannot be written.
    """
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".tmp")
        temporary = Path(name)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(content)
            temporary.chmod(0o666 & ~_umask())
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem.strerror})") from None


def _umask() -> int:
    """The process's file mode mask, which can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
