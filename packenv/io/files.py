"""Writing files whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from packenv.errors import InputError


def check_outputs(outputs: Mapping[str, Path | None], sources: Iterable[Path]) -> None:
    """Refuse output paths before any work is done for them.

    Args:
        outputs: the files to be written by the command-line option that named them; None is no file.
        sources: every file that is read, none of which an output may replace.

    Raises:
        InputError: a path is no regular file, its folder does not exist or cannot be written, or two of
            all these paths are the same.
    """
    taken = {_identity(source): f"{source}, which is read" for source in sources}
    for option, path in outputs.items():
        if path is None:
            continue
        try:
            _check_output(option, path)
        except OSError as problem:
            raise InputError(f"{option} {path}: cannot be written ({problem.strerror})") from None
        if (other := taken.get(_identity(path))) is not None:
            raise InputError(f"{option} {path}: is also {other}, give each file a name of its own")
        taken[_identity(path)] = option


def _identity(path: Path) -> object:
    """What two names of one file share: links, and upper and lower case where the file system has but one."""
    try:
        found = path.stat()
    except OSError:
        return path.resolve()
    return found.st_dev, found.st_ino


def _check_output(option: str, path: Path) -> None:
    folder = path.resolve().parent
    if path.is_dir():
        raise InputError(f"{option} {path}: is a folder, give a file name")
    if path.exists() and not path.is_file():
        raise InputError(f"{option} {path}: is not a regular file, give another name")
    if not folder.is_dir():
        raise InputError(f"{option} {path}: folder {folder} does not exist, create it first")
    if not os.access(folder, os.W_OK):
        raise InputError(f"{option} {path}: folder {folder} cannot be written")


def write_whole(path: Path, content: bytes) -> None:
    """Write a file by way of a temporary one beside it, so that no reader ever sees half of it.

    A link is followed: the file that it points to is replaced, not the link.

    Raises:
        InputError: the file cannot be written.
    """
    try:
        path = path.resolve()
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:40]}.", suffix=".tmp")
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
