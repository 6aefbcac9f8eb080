"""The software picture: what is nearer hides what is farther, and every run gives the same bytes."""

from __future__ import annotations

import colorsys
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from packenv.errors import InputError
from packenv.types import Container, Item, Placement, Plan
from packenv.view.camera import Camera, camera_around
from packenv.view.colours import hex_colour, item_colour
from packenv.view.picture import render_image, write_png
from packenv.view.scene import Scene, build_scene
from packenv.view.surfaces import box_corners
from tests import shapes

SIZE = (320, 240)
BOX = Container(0.4, 0.3, 0.2)


def scene_of(*placed: tuple[Item, tuple[float, float, float]]) -> Scene:
    placements = tuple(
        Placement(
            item.name,
            1,
            np.eye(3),
            np.array(corner) - item.vertices.min(axis=0),
            np.array(corner),
            item.extents,
            0,
            0.0,
            0.0,
            1,
        )
        for item, corner in placed
    )
    return build_scene(Plan(BOX, placements, ()), {item.name: item for item, _ in placed})


def camera_of(container: Container, size: tuple[int, int] = SIZE, **view: float) -> Camera:
    return camera_around(box_corners(container), size, **view)


def hue_at(image: np.ndarray, scene: Scene, point: tuple[float, float, float], **view: float) -> float:
    """Hue of the pixel where a point of the container frame appears."""
    column, row, nearness = camera_of(scene.container, SIZE, **view).project(np.array([point]))[0]
    assert nearness > 0
    red, green, blue = image[int(row), int(column)] / 255
    return colorsys.rgb_to_hsv(red, green, blue)[0]


def hue_of(index: int) -> float:
    return colorsys.rgb_to_hsv(*(part / 255 for part in item_colour(index)))[0]


VIEWS = [
    {"azimuth": a, "elevation": e}
    for a, e in itertools.product((-58.0, 35.0, 100.0, 200.0), (10.0, 32.0, 80.0))
]


@pytest.mark.parametrize("view", VIEWS)
def test_a_known_point_has_the_colour_of_its_item(view: dict[str, float]) -> None:
    scene = scene_of((shapes.box(0.1, 0.1, 0.1), (0.05, 0.05, 0.0)), (shapes.ball(0.05), (0.25, 0.15, 0.0)))
    image = render_image(scene, size=SIZE, **view)
    # A top face's middle, and a place of the ball that is turned both upwards and to the eye, are seen from
    # every side.
    middle = np.array([0.3, 0.2, 0.05])
    to_eye = camera_of(BOX, SIZE, **view).eye - middle
    outward = to_eye / np.linalg.norm(to_eye) + [0.0, 0.0, 1.0]
    on_ball = tuple(middle + 0.0499 * outward / np.linalg.norm(outward))
    assert hue_at(image, scene, (0.1, 0.1, 0.1), **view) == pytest.approx(hue_of(0), abs=0.03)
    assert hue_at(image, scene, on_ball, **view) == pytest.approx(hue_of(1), abs=0.03)


def test_the_nearer_item_hides_the_farther_whatever_the_sequence() -> None:
    front, back = shapes.box(0.3, 0.02, 0.15, "front"), shapes.box(0.05, 0.05, 0.05, "back")
    in_front, behind = (front, (0.05, 0.05, 0.0)), (back, (0.15, 0.2, 0.0))
    view = {"azimuth": -90.0, "elevation": 5.0}
    for order, owner in (((in_front, behind), 0), ((behind, in_front), 1)):
        scene = scene_of(*order)
        image = render_image(scene, size=SIZE, **view)
        assert hue_at(image, scene, (0.175, 0.2, 0.025), **view) == pytest.approx(hue_of(owner), abs=0.03)


def test_steps_appear_one_after_the_other() -> None:
    scene = scene_of((shapes.box(0.1, 0.1, 0.1), (0.0, 0.0, 0.0)), (shapes.ball(0.05), (0.25, 0.15, 0.0)))
    images = [render_image(replace(scene, steps=scene.steps[:k]), size=SIZE) for k in range(3)]
    assert not np.array_equal(images[0], images[1])
    assert not np.array_equal(images[1], images[2])
    assert np.array_equal(images[2], render_image(scene, size=SIZE))
    saturation = [int((np.ptp(image.astype(int), axis=2) > 60).sum()) for image in images]
    assert saturation[0] == 0
    assert saturation[0] < saturation[1] < saturation[2]


def test_an_item_above_the_floor_darkens_the_floor_below() -> None:
    lid = shapes.box(0.2, 0.2, 0.01, "lid")
    scene = scene_of((lid, (0.1, 0.05, 0.1)))
    view = {"azimuth": -90.0, "elevation": 15.0}
    column, row, _ = camera_of(BOX, SIZE, **view).project(np.array([[0.2, 0.12, 0.0]]))[0].astype(int)
    shaded = render_image(scene, size=SIZE, **view)[row, column].astype(int)
    free = render_image(replace(scene, steps=()), size=SIZE, **view)[row, column].astype(int)
    assert (shaded < free - 8).all()


def test_the_same_scene_gives_the_same_bytes(tmp_path: Path) -> None:
    scene = scene_of((shapes.cup(0.05, 0.1), (0.05, 0.05, 0.0)), (shapes.ball(0.05), (0.25, 0.15, 0.0)))
    for name in ("a.png", "b.png"):
        write_png(tmp_path / name, scene)
    first, second = ((tmp_path / name).read_bytes() for name in ("a.png", "b.png"))
    assert first == second
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "b.png"]
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (1280, 960)
        assert image.mode == "RGB"


@pytest.mark.parametrize("view", VIEWS)
def test_the_camera_holds_the_whole_container_and_no_more_than_needed(view: dict[str, float]) -> None:
    for size in (SIZE, (200, 400), (640, 100)):
        corners = np.array(list(itertools.product(*((0.0, s) for s in BOX.size))))
        seen = camera_of(BOX, size, **view).project(corners)
        margin = 0.04 * min(size)
        assert (seen[:, 2] > 0).all()
        low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
        assert (low >= margin - 1e-6).all()
        assert (high <= np.array(size) - margin + 1e-6).all()
        # It touches the margin on both sides in one direction: no nearer camera would do.
        touches = (np.abs(low - margin) < 1e-6) & (np.abs(high - (np.array(size) - margin)) < 1e-6)
        assert touches.any()


def test_projection_agrees_with_the_pinhole_formula() -> None:
    camera = camera_of(BOX, SIZE, azimuth=-90.0, elevation=0.0)
    # Straight along +y: columns grow with x, rows fall with z, both as focal length over depth.
    points = np.array([[0.1, 0.0, 0.05], [0.3, 0.0, 0.05], [0.1, 0.3, 0.05], [0.3, 0.3, 0.15]])
    column, row, nearness = camera.project(points).T
    depth = points[:, 1] - camera.eye[1]
    assert nearness == pytest.approx(1 / depth)
    assert column[1] - column[0] == pytest.approx(camera.focal * 0.2 / depth[0])
    assert row[2] - row[3] == pytest.approx(camera.focal * 0.1 / depth[2])


def test_outside_the_box_the_picture_is_white() -> None:
    scene = scene_of((shapes.ball(0.05), (0.2, 0.1, 0.0)))
    image = render_image(scene, size=SIZE)
    for row, column in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        assert image[row, column].tolist() == [255, 255, 255]


def test_values_out_of_range_are_named() -> None:
    scene = scene_of((shapes.ball(0.05), (0.2, 0.1, 0.0)))
    with pytest.raises(ValueError, match="elevation 91"):
        render_image(scene, size=SIZE, elevation=91.0)
    with pytest.raises(ValueError, match="at least 16 x 16"):
        render_image(scene, size=(5, 500))


def test_a_picture_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    scene = scene_of((shapes.ball(0.05), (0.2, 0.1, 0.0)))
    with pytest.raises(InputError):
        write_png(tmp_path / "missing" / "a.png", scene)
    assert list(tmp_path.iterdir()) == []


def test_item_colours_differ() -> None:
    colours = [item_colour(index) for index in range(40)]
    assert len({hex_colour(colour) for colour in colours}) == 40
    assert all(0 <= part <= 255 for colour in colours for part in colour)
    neighbours = np.abs(np.diff(np.array(colours, dtype=int), axis=0)).max(axis=1)
    assert (neighbours > 40).all()
