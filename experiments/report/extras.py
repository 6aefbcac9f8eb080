"""Packages that only a report needs."""

from __future__ import annotations

import importlib

from packenv.errors import InputError

_PACKAGES = ("jinja2", "matplotlib")


def require_extras() -> None:
    """Refuse to begin a report where a package is missing.

    Raises:
        InputError: one is.
    """
    for name in _PACKAGES:
        try:
            importlib.import_module(name)
        except ImportError:
            raise InputError(
                f"report.html and report.md need the package {name}, which is not installed: "
                "pip install 'robotpack[bench]'"
            ) from None
