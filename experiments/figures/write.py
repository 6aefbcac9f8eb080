"""All figures of the paper, redone with the items of a catalogue: ``robotpack bench figures``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from packenv.config import EngineName
from packenv.errors import InputError
from packenv.io.files import write_whole
from packenv.items.catalogue import open_catalogue
from packenv.watcher import SILENT, Watcher

from ..extras import require_extras
from .bowls import bowls
from .failure import failure
from .figure import Figure, Source
from .galleries import large_gallery, small_gallery
from .terrain import heightmap
from .waste import stable_versus_not

INDEX = "figures.json"
"""File that lists the figures."""

MAKERS: dict[str, Callable[[Source], Figure | None]] = {
    "heightmap": heightmap,
    "bowls": bowls,
    "stable-versus-not": stable_versus_not,
    "small-orders": small_gallery,
    "large-orders": large_gallery,
    "failure": failure,
}
"""Each figure by its name, in the sequence of the paper; None where the catalogue has not what it shows."""


def write_figures(
    catalogue: str,
    out: Path,
    *,
    unit: str | None = None,
    seed: int = 0,
    engine: EngineName = "auto",
    watcher: Watcher = SILENT,
) -> tuple[Figure, ...]:
    """Make the paper's figures with the items of a catalogue, and list them in ``figures.json``.

    Args:
        catalogue: ``builtin`` or a folder.
        out: folder of the files; it is made where it is missing.
        unit: of the meshes; None takes what they state, else metres.
        seed: of the draw of orders; the same one gives the same files.
        engine: of executions.
        watcher: is told of progress, and of figures that are left out.

    Returns:
        The figures that were written.

    Raises:
        InputError: matplotlib is not installed, the seed or the catalogue cannot be used, or a file cannot be written.
    """
    require_extras("figures", "matplotlib")
    if seed < 0:
        raise InputError(f"seed is {seed}, give a whole number of at least 0")
    source = Source(open_catalogue(catalogue, unit=unit), unit, seed, engine, out, watcher)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputError(f"{out}: cannot be made ({problem.strerror})") from None
    found = [MAKERS[name](source) for name in watcher.progress(MAKERS, "figures")]
    figures = tuple(figure for figure in found if figure is not None)
    document = {"catalogue": catalogue, "figures": [figure.to_json() for figure in figures]}
    write_whole(out / INDEX, (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode())
    return figures
