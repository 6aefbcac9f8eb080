"""Packages that only some results need."""

from __future__ import annotations

import importlib

from packenv.errors import InputError


def require_extras(what: str, *packages: str) -> None:
    """Refuse to begin where a package is missing.

    Args:
        what: needs them, for the message.
        packages: names to import.

    Raises:
        InputError: one is not installed.
    """
    for name in packages:
        try:
            importlib.import_module(name)
        except ImportError:
            raise InputError(
                f"{what} need the package {name}, which is not installed: pip install 'robotpack[bench]'"
            ) from None
