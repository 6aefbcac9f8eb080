"""The engines by name; an engine's package is imported when its settings are asked for."""

from __future__ import annotations

import platform
import sys
from importlib.util import find_spec

from packenv.config import EngineName
from packenv.errors import PhysicsError
from packenv.quiet import engine_muted
from packenv.sim.engine import EngineConfig

_PACKAGES = {"bullet": "pybullet", "mujoco": "mujoco"}
"""The package of each engine, in the sequence in which ``auto`` takes them."""


def is_there(name: EngineName) -> bool:
    """Whether an engine, ``bullet`` or ``mujoco``, is installed."""
    return _installed(_PACKAGES[name])


def engine_config(name: str = "auto") -> EngineConfig:
    """The settings of an engine.

    Args:
        name: ``bullet``, ``mujoco``, or ``auto``: PyBullet where it is installed, else MuJoCo.

    Raises:
        PhysicsError: it is not installed.
    """
    if name == "auto":
        name = next((known for known, package in _PACKAGES.items() if _installed(package)), "mujoco")
    try:
        if name == "bullet":
            with engine_muted():  # PyBullet tells its build time when it is first imported
                from packenv.sim.bullet import BulletConfig

                return BulletConfig()
        from packenv.sim.mujoco_engine import MujocoConfig

        return MujocoConfig()
    except ImportError as problem:
        raise PhysicsError(_missing(name, problem)) from problem


def _installed(package: str) -> bool:
    try:
        return find_spec(package) is not None
    except (ImportError, ValueError):  # somebody has blocked it
        return False


def _missing(name: str, problem: ImportError) -> str:
    """What is missing, why, and what would help; in one line."""
    package = _PACKAGES[name]
    needs = f"engine {name} needs the package {package}"
    if problem.name != package:
        return f"{needs}, which cannot be loaded: {problem}"
    version, system, machine = sys.version_info[:2], sys.platform, platform.machine()
    if name == "bullet" and not (system == "linux" and machine == "x86_64" and version < (3, 12)):
        return (
            f"{needs}, which is there for Python 3.10 and 3.11 on Linux x86-64 and not for "
            f"Python {version[0]}.{version[1]} on {system} {machine}: give --engine mujoco"
        )
    return f"{needs}, which is not installed: pip install {package}"
