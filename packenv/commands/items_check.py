"""``robotpack items check``: every mesh of a catalogue and what is wrong with it."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from packenv.commands.output import say, say_json
from packenv.items.check import check_items, format_table


def run(arguments: argparse.Namespace) -> int:
    """Check a catalogue; returns the exit code: 0 where every mesh can be used."""
    reports = check_items(arguments.catalogue, unit=arguments.unit)
    if arguments.json:
        say_json([asdict(report) for report in reports])
    else:
        say(format_table(reports))
    return 1 if any(report.status == "error" for report in reports) else 0
