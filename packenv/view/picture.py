"""A picture of a plan, drawn in software: no graphics card, no display, the same bytes every time."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from packenv.io.files import write_whole
from packenv.types import Container
from packenv.view.colours import item_colour
from packenv.view.painter import CREASE, Camera, Image, Quality, Surface, box_corners, camera_around, paint
from packenv.view.scene import Scene


def fit_camera(
    container: Container, size: tuple[int, int] = (1280, 960), azimuth: float = -58.0, elevation: float = 32.0
) -> Camera:
    """The nearest camera that sees the whole container from a side.

    Args:
        container: the box.
        size: (width, height) of the picture, px.
        azimuth: from the container's middle to the eye, degrees from +x towards +y.
        elevation: degrees above the horizon, between -90 and 90.

    Returns:
        The camera; the container fills the picture but for a small margin.

    Raises:
        ValueError: the size or the elevation is out of range.
    """
    return camera_around(box_corners(container), size, azimuth, elevation)


def render_image(
    scene: Scene,
    *,
    size: tuple[int, int] = (1280, 960),
    step: int | None = None,
    azimuth: float = -58.0,
    elevation: float = 32.0,
) -> Image:
    """Draw a scene.

    Args:
        scene: what to show.
        size: (width, height), px.
        step: number of placed items to show; all by default.
        azimuth: as in :func:`fit_camera`.
        elevation: as in :func:`fit_camera`.

    Returns:
        (height, width, 3) sRGB.

    Raises:
        ValueError: ``step``, ``size`` or ``elevation`` is out of range.
    """
    from packenv.view.zbuffer_kernels import corner_normals

    shown = len(scene.steps) if step is None else step
    if not 0 <= shown <= len(scene.steps):
        raise ValueError(f"step {shown}: the scene has steps 0 to {len(scene.steps)}")
    surfaces = []
    for index, placed in enumerate(scene.steps[:shown]):
        vertices = np.ascontiguousarray(placed.vertices)
        faces = np.ascontiguousarray(placed.item.faces, dtype=np.int64)
        normals = corner_normals(vertices, faces, CREASE)
        surfaces.append(Surface(vertices, faces, normals, item_colour(index)))
    camera = fit_camera(scene.container, size, azimuth, elevation)
    return paint(scene.container, surfaces, camera, Quality())


def render_plan_png(
    path: Path,
    scene: Scene,
    *,
    size: tuple[int, int] = (1280, 960),
    step: int | None = None,
    azimuth: float = -58.0,
    elevation: float = 32.0,
) -> None:
    """Write a picture of a scene as PNG.

    Args:
        path: the file to write; an older one is replaced only when the new one is complete.
        scene: as in :func:`render_image`, like all further arguments.
        size: (width, height), px.
        step: number of placed items to show; all by default.
        azimuth: degrees.
        elevation: degrees.

    Raises:
        ValueError: an argument is out of range.
        InputError: the file cannot be written.
    """
    from PIL import Image as PillowImage

    image = render_image(scene, size=size, step=step, azimuth=azimuth, elevation=elevation)
    buffer = io.BytesIO()
    PillowImage.fromarray(image).save(buffer, format="PNG")
    write_whole(Path(path), buffer.getvalue())
