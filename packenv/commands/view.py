"""``robotpack view``: a page or picture of a plan."""

from __future__ import annotations

import argparse

from packenv.commands.loading import load_plan
from packenv.commands.output import say
from packenv.errors import InputError
from packenv.io.files import check_writable
from packenv.io.scene import build_scene
from packenv.planning.replay import replay


def run(arguments: argparse.Namespace) -> int:
    """Write a page or picture; returns the exit code."""
    path = arguments.out
    kind = path.suffix.lower()
    if kind not in (".html", ".htm", ".png"):
        raise InputError(f"--out {path}: unknown kind {kind!r}, give a name that ends in .html or .png")
    check_writable(path, "--out")
    plan, items = load_plan(arguments.plan, arguments.catalogue, arguments.unit)
    cell_size = plan.settings.get("cell_size")
    if not isinstance(cell_size, float):
        raise InputError(
            f"{arguments.plan}: settings.cell_size is {cell_size!r}, should be a number in metres"
        )
    surfaces = replay(plan.placements, items, plan.container, cell_size)
    scene = build_scene(plan, items, [surface.heights for surface in surfaces], cell_size)
    if kind == ".png":
        from packenv.io.picture import render_plan_png

        render_plan_png(path, scene)
    else:
        from packenv.io.viewer import write_page

        write_page(path, scene)
    say(f"wrote {path}")
    return 0
