"""An execution as an animated GIF: robot, open box, items, and where the plan wants the one that moves."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from packenv.io.files import write_whole
from packenv.items.plan_items import cell_of
from packenv.types import Frame, Item, Plan, Pose
from packenv.view.painter import Image, silhouette
from packenv.view.stage import Stage
from packenv.view.surfaces import item_surface

if TYPE_CHECKING:
    from PIL.Image import Image as PillowPicture


Progress: TypeAlias = Callable[[Sequence["Frame"]], Iterable["Frame"]]

SIZE = (480, 360)
"""Width and height of the animation, px."""

_FRAME_MS = 80  # GIF counts in hundredths of a second: 12.5 frames a second
_LAST_MS = 2500
_WAY_FRAMES = 5
"""Moments of an item's way down in the animation of a plan."""
_THIN = 400
"""Pixels of a picture's shorter side for each of the outline's width."""
_GHOST = np.array([200.0, 30.0, 90.0])
_TEXT = (40, 48, 60)


def write_gif(
    path: Path,
    plan: Plan,
    items: Mapping[str, Item],
    frames: Sequence[Frame],
    ending: str = "",
    progress: Progress = iter,
) -> None:
    """Draw frames and write them as an animated GIF.

    Args:
        path: the file to write; an older one is replaced only when the new one is complete.
        plan: what is shown.
        items: the plan's items by name.
        frames: as recorded in an execution or made by :func:`planned_frames`, at least one.
        ending: text for the last frame.
        progress: iterates over the frames, for a progress bar.

    Raises:
        InputError: the file cannot be written.
    """
    from PIL import Image as PillowImage

    stage = Stage(cell_of(plan), SIZE)
    palette = _palette([draw_frame(stage, plan, items, frames[k]) for k in _spread(len(frames), 6)])
    pictures = []
    for number, frame in enumerate(progress(frames), start=1):
        drawn = PillowImage.fromarray(draw_frame(stage, plan, items, frame))
        _caption(drawn, _step_text(plan, frame), ending if number == len(frames) else "")
        pictures.append(drawn.quantize(palette=palette, dither=PillowImage.Dither.NONE))
    durations = [_FRAME_MS] * (len(pictures) - 1) + [_LAST_MS]
    buffer = io.BytesIO()
    pictures[0].save(
        buffer, format="GIF", save_all=True, append_images=pictures[1:], duration=durations, loop=0
    )
    write_whole(Path(path), buffer.getvalue())


def planned_frames(plan: Plan) -> tuple[Frame, ...]:
    """Moments of a plan as the robot would carry it out: each item on its way down, and in its place."""
    frames: list[Frame] = [Frame(0.0, None, ())]
    lying: list[Pose] = []
    for placement in plan.placements:
        path = placement.path
        lifts, joints = np.array([plan.container.height, 0.0]), None
        if path is not None:
            chosen = _spread(len(path.joints), _WAY_FRAMES)
            lifts, joints = (path.cup_heights - path.cup_heights[-1])[chosen], path.joints[chosen]
        for k, lift in enumerate(lifts):
            held = placement.pose.moved(np.array([0.0, 0.0, float(lift)]))
            now = None if joints is None else joints[k]
            frames.append(Frame(float(len(frames)), now, (*lying, held)))
        lying.append(placement.pose)
    return tuple(frames)


def _spread(count: int, wanted: int) -> list[int]:
    """So many of ``count`` indices, evenly, first and last among them."""
    return sorted({round(k * (count - 1) / (wanted - 1)) for k in range(wanted)})


def _palette(pictures: Sequence[Image]) -> PillowPicture:
    """The colours that do best for some pictures: one palette, so that colours do not flicker."""
    from PIL import Image as PillowImage

    return PillowImage.fromarray(np.concatenate(pictures)).quantize(256, kmeans=1)


def draw_frame(
    stage: Stage, plan: Plan, items: Mapping[str, Item], frame: Frame, outlined: int = -1
) -> Image:
    """One moment.

    Args:
        stage: the plan's cell.
        plan: what is shown.
        items: the plan's items by name.
        frame: the moment.
        outlined: of which of its items the place in the plan is outlined; by itself the latest.

    Returns:
        (height, width, 3) sRGB: what is there, and the outline.
    """
    shown = plan.placements[: len(frame.poses)]
    picture = stage.draw(
        [(items[p.item], pose) for p, pose in zip(shown, frame.poses, strict=True)], frame.joints
    )
    if shown:
        wanted = shown[outlined]
        inside = silhouette(item_surface(items[wanted.item]).at(wanted.pose), stage.camera)
        core = inside
        for _ in range(max(1, round(min(inside.shape) / _THIN))):
            core = np.logical_and.reduce(
                [core, *(np.roll(core, s, axis) for axis in (0, 1) for s in (-1, 1))]
            )
        edge = inside & ~core
        picture[edge] = np.rint(0.25 * picture[edge] + 0.75 * _GHOST).astype(np.uint8)
    return picture


def _step_text(plan: Plan, frame: Frame) -> str:
    step, count = len(frame.poses), len(plan.placements)
    return f"{step} / {count}   {plan.placements[step - 1].item}" if step else f"0 / {count}"


def _caption(picture: PillowPicture, text: str, ending: str) -> None:
    from PIL import ImageDraw, ImageFont

    pen = ImageDraw.Draw(picture)
    font = ImageFont.load_default(14)
    pen.text((10, 8), text, fill=_TEXT, font=font)
    if ending:
        pen.text((10, picture.height - 26), ending, fill=_TEXT, font=font)
