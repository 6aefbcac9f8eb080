"""``robotpack view``: a page, a picture, an animation or a 3D file of a plan."""

from __future__ import annotations

import argparse

from packenv.cli.output import Terminal, say
from packenv.io.files import check_outputs
from packenv.items.plan_items import open_plan
from packenv.view.show import check_suffix, show


def run(arguments: argparse.Namespace) -> int:
    """Write the file; returns the exit code."""
    path = arguments.out
    check_suffix(path, "--out")
    plan, shelf = open_plan(arguments.plan, arguments.catalogue, unit=arguments.unit)
    check_outputs({"--out": path}, [arguments.plan, *shelf.catalogue.files])
    show(plan, path, shelf, watcher=Terminal())
    say(f"wrote {path}")
    return 0
