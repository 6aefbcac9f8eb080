"""``robotpack items prepare``: stable poses and heightmaps of a whole catalogue into the cache."""

from __future__ import annotations

import argparse
import time

from packenv.commands.output import remark, say, say_json, with_progress
from packenv.config import GridConfig
from packenv.errors import InputError
from packenv.items.cache import ItemCache
from packenv.items.catalogue import open_catalogue


def run(arguments: argparse.Namespace) -> int:
    """Prepare a catalogue; returns the exit code: 1 where a mesh could not be used."""
    catalogue = open_catalogue(arguments.catalogue, unit=arguments.unit)
    cache, grid = ItemCache(), GridConfig()
    start = time.process_time()
    made = kept = failed = 0
    for name in with_progress(catalogue.names, "preparing"):
        try:
            item = catalogue.item(name)
        except InputError as problem:
            remark(str(problem))
            failed += 1
            continue
        if cache.get(item, grid) is None:
            cache.prepare(item, grid)
            made += 1
        else:
            kept += 1
    seconds = time.process_time() - start
    if arguments.json:
        figures = {"prepared": made, "cached": kept, "failed": failed, "cpu_s": round(seconds, 3)}
        say_json({**figures, "folder": str(cache.folder)})
    else:
        say(
            f"prepared {made} items, {kept} were in the cache, {failed} cannot be used "
            f"({seconds:.1f} CPU-seconds); cache: {cache.folder}"
        )
    return 1 if failed else 0
