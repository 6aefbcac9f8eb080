"""``robotpack items``: check or prepare the items of a catalogue."""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict

from packenv.cli.output import remark, say, say_json, with_progress
from packenv.config import GridConfig
from packenv.errors import InputError
from packenv.items.cache import ItemCache
from packenv.items.catalogue import open_catalogue
from packenv.items.check import check_items, format_table


def run(arguments: argparse.Namespace) -> int:
    """Do what ``action`` says; returns the exit code."""
    return {"check": check, "prepare": prepare}[arguments.action](arguments)


def check(arguments: argparse.Namespace) -> int:
    """Check a catalogue; returns the exit code: 0 where every mesh can be used."""
    reports = check_items(arguments.catalogue, unit=arguments.unit)
    if arguments.json:
        say_json([asdict(report) for report in reports])
    else:
        say(format_table(reports))
    return 1 if any(report.status == "error" for report in reports) else 0


def prepare(arguments: argparse.Namespace) -> int:
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
