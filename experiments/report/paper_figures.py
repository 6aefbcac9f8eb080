"""The paper's figures in a report, where ``robotpack bench figures`` wrote them into its folder."""

from __future__ import annotations

from pathlib import Path

from packenv.errors import InputError
from packenv.json_text import read_json

from ..figures.write import INDEX
from .document import Block, Gallery, Heading, Section, Shot
from .words import plain

FOLDER = "figures"
"""Of the figures, in the folder of the report."""


def figures_section(folder: Path) -> Section | None:
    """The figures of a report's folder; None where there are none.

    Args:
        folder: of the report.

    Raises:
        InputError: the list of figures is not one, or a picture cannot be read.
    """
    index = folder / FOLDER / INDEX
    if not index.exists():
        return None
    right = "what robotpack bench figures wrote"
    blocks: list[Block] = []
    try:
        for figure in read_json(index, right)["figures"]:
            picture = (index.parent / figure["files"][0]).read_bytes()
            shot = Shot(f"{FOLDER}-{figure['name']}", plain(figure["caption"]), picture)
            blocks += [Heading(plain(f"{figure['title']} ({figure['paper']})")), Gallery((shot,), large=True)]
    except (KeyError, TypeError, IndexError):
        raise InputError(f"{index}: is no list of figures, give {right}") from None
    except OSError as problem:
        raise InputError(f"{problem.filename}: cannot be read ({problem.strerror}), give {right}") from None
    return Section(FOLDER, "The paper's figures", tuple(blocks))
