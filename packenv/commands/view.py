"""``robotpack view``: a page or picture of a plan."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from packenv.commands.loading import load_plan, load_planned_shapes, plan_catalogue, plan_cell_size
from packenv.commands.output import remark, say
from packenv.errors import InputError
from packenv.io.files import check_outputs
from packenv.io.scene import build_scene
from packenv.planning.container_map import ContainerMap
from packenv.planning.replay import replay
from packenv.types import Item, Plan


def run(arguments: argparse.Namespace) -> int:
    """Write a page or picture; returns the exit code."""
    path = arguments.out
    kind = path.suffix.lower()
    if kind not in (".html", ".htm", ".png"):
        raise InputError(f"--out {path}: unknown kind {kind!r}, give a name that ends in .html or .png")
    check_outputs({"--out": path}, arguments.plan)
    plan, items = load_plan(arguments.plan, arguments.catalogue, arguments.unit)
    cell_size = plan_cell_size(plan, arguments.plan)
    shelf = plan_catalogue(plan, arguments.catalogue, arguments.unit)
    shapes = load_planned_shapes(plan, arguments.plan, items, shelf)
    surfaces = _surfaces(plan, shapes, cell_size, arguments.plan)
    scene = build_scene(plan, items, [surface.heights for surface in surfaces], cell_size)
    if kind == ".png":
        from packenv.io.picture import render_plan_png

        render_plan_png(path, scene)
    else:
        from packenv.io.viewer import write_page

        write_page(path, scene)
    say(f"wrote {path}")
    return 0


def _surfaces(
    plan: Plan, items: Mapping[str, Item], cell_size: float, path: Path
) -> tuple[ContainerMap, ...]:
    """The heightmaps, or none: a plan that fails its audit is the one that a person wants to look at."""
    try:
        return replay(plan.placements, items, plan.container, cell_size)
    except ValueError as problem:
        remark(f"{path}: no heightmap is shown: {problem}")
        return ()
