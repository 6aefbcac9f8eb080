"""trimesh's readers, for what a gate in front of them lets through."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

from packenv.errors import MeshError
from packenv.geometry.readers.raw import brief


def by_trimesh(path: Path, kind: str, data: bytes, **options: Any) -> Any:
    """What trimesh makes of a file's bytes, nothing merged or dropped.

    Args:
        path: named in messages.
        kind: ``stl``, ``ply`` or ``glb``.
        data: what the gate lets through.
        options: for trimesh's reader.

    Returns:
        A ``trimesh.Scene``.

    Raises:
        MeshError: trimesh cannot read it, or stops at a word that is no number.
    """
    import trimesh

    with warnings.catch_warnings():
        # NumPy ends at such a word and warns; the numbers up to it would be taken for all.
        warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
        try:
            return trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False, **options)
        except Exception as problem:  # trimesh lets the errors of many libraries through
            said = brief(" ".join(f"{type(problem).__name__}: {problem}".split()))
            raise MeshError(f"{path}: truncated or damaged ({said}); export it again") from None
