"""A picture of a plan as PNG: the same bytes every time."""

from __future__ import annotations

import io
from pathlib import Path

from packenv.io.files import write_whole
from packenv.view.camera import camera_around
from packenv.view.painter import FINE, Image, paint
from packenv.view.scene import Scene
from packenv.view.stage import placed_surfaces
from packenv.view.surfaces import box_corners


def render_image(
    scene: Scene,
    *,
    size: tuple[int, int] = (1280, 960),
    azimuth: float = -58.0,
    elevation: float = 32.0,
) -> Image:
    """Draw a scene, without the robot, by the nearest camera that sees the whole container.

    Args:
        scene: what to show.
        size: (width, height), px.
        azimuth: from the container's middle to the eye, degrees from +x towards +y.
        elevation: degrees above the horizon, between -90 and 90.

    Returns:
        (height, width, 3) sRGB.

    Raises:
        ValueError: ``size`` or ``elevation`` is out of range.
    """
    corners = box_corners(scene.container)
    camera = camera_around(corners, size, azimuth, elevation)
    placed = [(s.item, s.measured or s.placement.pose) for s in scene.steps]
    return paint(scene.container, placed_surfaces(placed), camera, FINE, corners)


def write_png(path: Path, scene: Scene) -> None:
    """Write a picture of a scene.

    Args:
        path: the file to write; an older one is replaced only when the new one is complete.
        scene: what to show.

    Raises:
        InputError: the file cannot be written.
    """
    from PIL import Image as PillowImage

    buffer = io.BytesIO()
    PillowImage.fromarray(render_image(scene)).save(buffer, format="PNG")
    write_whole(path, buffer.getvalue())
