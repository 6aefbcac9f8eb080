"""Physics: the one package that imports pybullet.

Where pybullet is missing, importing it or any of its modules raises :class:`~packenv.errors.PhysicsError`.
Whoever is going to need physics imports it before long work begins.
"""

from __future__ import annotations

import platform
import sys

from packenv.errors import PhysicsError
from packenv.quiet import engine_muted


def _missing(problem: ImportError) -> str:
    """What is missing, why, and what would help; in one line."""
    needs = "physics needs the package pybullet"
    if problem.name != "pybullet":
        return f"{needs}, which cannot be loaded: {problem}"
    version, system, machine = sys.version_info[:2], sys.platform, platform.machine()
    if system == "linux" and machine == "x86_64" and version < (3, 12):
        return f"{needs}, which is not installed: pip install pybullet"
    return (
        f"{needs}, which is there for Python 3.10 and 3.11 on Linux x86-64 and not for "
        f"Python {version[0]}.{version[1]} on {system} {machine}: use one of those; all else works here"
    )


try:
    with engine_muted():
        # PyBullet tells its build time when it is first imported.
        import pybullet  # noqa: F401
except ImportError as problem:
    raise PhysicsError(_missing(problem)) from problem
