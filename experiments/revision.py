"""Which product made a row."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import packenv
from packenv.version import __version__

APART = ("agents", "backends", "cli", "env", "experiments", "train", "view")
"""Packages that no plan and no execution depends on."""


@cache
def revision(work: Callable[..., Any] | None = None) -> str:
    """The version, and a digest of the source that rows depend on: one that an older source left is none of its own.

    Args:
        work: what makes the rows; the file that it stands in counts, too.
    """
    digest = hashlib.sha256()
    folder = Path(packenv.__file__).parent
    for path in sorted(folder.rglob("*.py")):
        inside = path.relative_to(folder)
        if inside.parts[0] not in APART:
            digest.update(inside.as_posix().encode() + b"\0" + path.read_bytes())
    if work is not None:
        digest.update(Path(inspect.getfile(work)).read_bytes())
    return f"{__version__}+{digest.hexdigest()[:12]}"
