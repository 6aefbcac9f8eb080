"""Where the files are that RobotPack brings along: its catalogue, orders, boxes and robots."""

from __future__ import annotations

from pathlib import Path

from packenv.errors import RobotPackError

BUILTIN = "builtin"
"""Label of the catalogue that RobotPack brings along."""

MEMORY = "<memory>"
"""Label of a catalogue whose items are in no folder; no folder is likely to have this name."""


def assets_dir() -> Path:
    """Folder of the built-in assets: inside the installed package, or beside it in a checkout.

    Raises:
        RobotPackError: neither is there, so the installation is damaged.
    """
    package = Path(__file__).resolve().parent
    for folder in (package / "assets", package.parent / "assets"):
        if folder.is_dir():
            return folder
    raise RobotPackError(f"the assets folder is missing beside {package}; install robotpack again")
