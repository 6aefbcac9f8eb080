"""Show a plan or an execution: a page, a picture, an animation or a 3D file, by the file's suffix."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from packenv.errors import InputError
from packenv.io.files import check_outputs, write_whole
from packenv.items.plan_items import Items, options_of, require_plan, shelf_of, surfaces_of
from packenv.types import Plan
from packenv.view.scene import Scene, build_scene
from packenv.watcher import SILENT, Watcher

if TYPE_CHECKING:
    from packenv.execution.execute import ExecutedPlan

SUFFIXES = (".html", ".htm", ".png", ".gif", ".glb")
"""What :func:`show` writes."""


def check_suffix(path: Path | None, option: str = "show", kinds: Sequence[str] = SUFFIXES) -> None:
    """Refuse a file name whose ending is wrong, before any work is done.

    Args:
        path: the file; None is no file.
        option: what named it, for the message.
        kinds: the right endings, an empty one for none.

    Raises:
        InputError: the ending is none of these.
    """
    if path is not None and path.suffix.lower() not in kinds:
        names = [kind for kind in kinds if kind]
        known = " or ".join((", ".join(names[:-1]), names[-1]) if len(names) > 1 else names)
        raise InputError(f"{option} {path}: unknown kind {path.suffix!r}, give a name that ends in {known}")


def show(
    thing: Plan | ExecutedPlan,
    path: str | Path,
    catalogue: Items | None = None,
    *,
    unit: str | None = None,
    watcher: Watcher = SILENT,
) -> None:
    """Write what there is to see of a plan or of an execution.

    ``.html`` is a page to orbit and step through, ``.png`` a picture, ``.gif`` an animation, and ``.glb`` the
    placed items for any 3D program (z up, m), without the container. Of an execution all show measured poses.

    Args:
        thing: the plan, or what :func:`packenv.execute` returned.
        path: the file to write; an older one is replaced only when the new one is complete.
        catalogue: where the items are from; None takes what the plan names.
        unit: unit of the meshes; None takes the plan's.
        watcher: is told of remarks and of progress.

    Raises:
        InputError: the ending is unknown, the file cannot be written or is one of the catalogue's, a mesh is not
            the plan's, or an animation is asked of an execution that recorded none.
    """
    path = Path(path)
    check_suffix(path)
    if not hasattr(thing, "execution"):
        require_plan(thing)
    plan, executed = (thing, None) if isinstance(thing, Plan) else (thing.plan, thing)
    kind = path.suffix.lower()
    if kind == ".gif" and executed is not None and not executed.frames:
        raise InputError(f"show {path}: nothing was recorded, give record=True to execute")
    shelf = shelf_of(plan, catalogue, unit=unit)
    check_outputs({"show": path}, shelf.catalogue.files)
    items = {p.item: shelf.items[p.item] for p in plan.placements}
    if kind == ".glb":
        poses = None if executed is None else executed.execution.final
        content: bytes = plan.to_scene(poses, items).export(file_type="glb")  # type: ignore[no-untyped-call]
        write_whole(path, content)
    elif kind == ".gif":
        from packenv.view.animation import planned_frames, write_gif

        frames = planned_frames(plan) if executed is None else executed.frames
        ending = "" if executed is None else executed.verdict
        write_gif(path, plan, items, frames, ending, lambda f: watcher.progress(f, "drawing"))
    else:
        _draw(path, scene_of(thing, shelf, watcher=watcher))


def scene_of(
    thing: Plan | ExecutedPlan,
    catalogue: Items | None = None,
    *,
    unit: str | None = None,
    watcher: Watcher = SILENT,
) -> Scene:
    """What page and picture draw; as for :func:`show`."""
    plan = thing if isinstance(thing, Plan) else thing.plan
    shelf = shelf_of(plan, catalogue, unit=unit)
    items = {p.item: shelf.items[p.item] for p in plan.placements}
    if not isinstance(thing, Plan):
        from packenv.view.execution_scene import executed_scene

        return executed_scene(plan, items, thing.execution, thing.lying)
    try:
        heights = [surface.heights for surface in surfaces_of(plan, shelf)]
    except ValueError as problem:
        # A plan that fails its audit is the one that a person wants to look at.
        watcher.remark(f"{plan.label}: no heightmap is shown: {problem}")
        heights = []
    return build_scene(plan, items, heights, options_of(plan).grid.cell_size)


def _draw(path: Path, scene: Scene) -> None:
    if path.suffix.lower() == ".png":
        from packenv.view.picture import write_png

        write_png(path, scene)
    else:
        from packenv.view.page import write_page

        write_page(path, scene)
