"""Pictures of the cell: what is there is seen where it is, and nothing depends on what was drawn before."""

from __future__ import annotations

import gc
import hashlib
import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import psutil
import pytest
from hypothesis import given, settings, strategies as st
from PIL import Image as PillowImage, ImageDraw, ImageFilter

from packenv.robot.files import default_cell
from packenv.types import Container, FloatArray, Item, Pose
from packenv.view import surfaces
from packenv.view.colours import item_colour
from packenv.view.painter import Image
from packenv.view.stage import Stage, robot_surfaces
from tests.conftest import REPO
from tests.shapes import ball, box, cup, cylinder

CONTAINER = Container(0.32, 0.32, 0.30)
SIZE = (160, 120)
BENT = np.array([0.0, 0.3, 1.8, 0.0, 1.0, 0.0])


def at(item: Item, x: float, y: float, z: float = 0.0) -> tuple[Item, Pose]:
    """The item upright with its bounding box from this corner."""
    return item, Pose(np.eye(3), np.array([x, y, z]) - item.vertices.min(axis=0))


def scene() -> list[tuple[Item, Pose]]:
    shapes = box(0.12, 0.10, 0.08), cylinder(0.04, 0.12), ball(0.05), cup(0.04, 0.1)
    places = (0.0, 0.0), (0.2, 0.02), (0.02, 0.18), (0.18, 0.16)
    return [at(item, *place) for item, place in zip(shapes, places, strict=True)]


SCENE = scene()


def stage(container: Container = CONTAINER, size: tuple[int, int] = SIZE) -> Stage:
    return Stage(default_cell().with_container(container), size)


def projected(points: FloatArray, there: Stage) -> FloatArray:
    """(n, 2) column and row of points, by the matrices of a viewer and a frustum as in any text book.

    Only the eye is taken from the camera; its direction and field of view are what the module says.
    """
    width, height = there.camera.size
    azimuth, elevation = math.radians(-38.0), math.radians(24.0)
    back = np.array(
        [
            math.cos(azimuth) * math.cos(elevation),
            math.sin(azimuth) * math.cos(elevation),
            math.sin(elevation),
        ]
    )
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = [right, np.cross(back, right), back]
    view[:3, 3] = -view[:3, :3] @ there.camera.eye
    half = math.tan(math.radians(15.0))
    wide = max(width, height)
    frustum = np.diag([wide / (half * width), wide / (half * height), 0.0, 0.0])
    frustum[3, 2] = -1.0
    clip = np.column_stack([points, np.ones(len(points))]) @ (frustum @ view).T
    x, y = (clip[:, :2] / clip[:, 3:]).T
    return np.column_stack([(x + 1) / 2 * width, (1 - y) / 2 * height])


def coloured(picture: Image, place: int) -> FloatArray:
    """(n, 2) column and row of the middle of every pixel with about the hue of an item, whatever its light."""
    wide, colour = (np.asarray(c, dtype=float) ** 2.2 for c in (picture, item_colour(place)))
    unit = wide / np.maximum(np.linalg.norm(wide, axis=2, keepdims=True), 1.0)
    return np.argwhere(unit @ (colour / np.linalg.norm(colour)) > 0.99)[:, ::-1] + 0.5


def test_a_picture_has_the_size_asked_for_and_is_the_same_again() -> None:
    for size in (SIZE, (64, 96)):
        there = stage(size=size)
        first, again = (there.draw(SCENE, BENT) for _ in range(2))
        assert first.shape == (size[1], size[0], 3)
        assert first.dtype == np.uint8
        assert np.array_equal(first, again)
        assert not np.shares_memory(first, again)


def test_a_picture_does_not_depend_on_what_was_drawn_before() -> None:
    alone = stage().draw(scene())
    there = stage()
    for part in (SCENE[:1], SCENE[:3], SCENE, SCENE[::-1], [], SCENE):
        last = there.draw(part)
        stage(Container(0.2, 0.4, 0.25), (50, 50)).draw(part[:2], np.zeros(6))
    assert np.array_equal(last, alone)
    moved = [*SCENE[:-1], at(SCENE[-1][0], 0.1, 0.1, 0.15)]
    assert np.array_equal(there.draw(moved), stage().draw(moved))


def test_another_process_without_pybullet_and_display_draws_the_same() -> None:
    code = (
        "import hashlib, sys\n"
        "sys.modules['pybullet'] = sys.modules['pygame'] = None\n"
        "from tests.view.test_stage import BENT, SCENE, stage\n"
        "print(hashlib.sha256(stage().draw(SCENE, BENT).tobytes()).hexdigest())\n"
    )
    bare = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")}
    done = subprocess.run(
        [sys.executable, "-c", code], env=bare, capture_output=True, text=True, cwd=REPO, check=True
    )
    assert done.stdout.strip() == hashlib.sha256(stage().draw(SCENE, BENT).tobytes()).hexdigest()


@settings(max_examples=20, deadline=None)
@given(st.floats(0.1, 0.22), st.floats(0.1, 0.22), st.floats(0.0, 0.3), st.floats(0, 6.28), st.integers(0, 3))
def test_an_item_is_seen_where_it_is_and_nowhere_else(
    x: float, y: float, z: float, yaw: float, which: int
) -> None:
    item = SCENE[which][0]
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    low, high = item.vertices.min(axis=0), item.vertices.max(axis=0)
    middle = (low + high) / 2
    position = np.array([x, y, z - low[2]]) - turn @ [middle[0], middle[1], 0.0]
    there = stage(size=(320, 240))
    found = coloured(there.draw([(item, Pose(turn, position))]), 0)
    # Pillow fills the projected faces; lines are drawn along its edges, and those of the box across it.
    mask = PillowImage.new("L", (320, 240))
    for triangle in projected(item.vertices @ turn.T + position, there)[item.faces]:
        ImageDraw.Draw(mask).polygon([tuple(corner) for corner in triangle], fill=255)
    inner, outer = (
        np.asarray(mask.filter(each(5))) > 0 for each in (ImageFilter.MinFilter, ImageFilter.MaxFilter)
    )
    columns, rows = (found - 0.5).astype(int).T
    assert inner.sum() > 100
    assert outer[rows, columns].all()
    assert inner[rows, columns].sum() > 0.85 * inner.sum()


def test_a_known_point_is_at_its_pixel_and_the_picture_is_not_mirrored() -> None:
    there = stage(size=(480, 480))
    dot = box(0.012, 0.012, 0.012)
    middles = np.array([[0.1, 0.1, 0.1], [0.25, 0.1, 0.1], [0.1, 0.25, 0.1], [0.1, 0.1, 0.25]])
    seen = []
    for middle in middles:
        found = coloured(there.draw([at(dot, *(middle - 0.006))]), 0)
        seen.append((found.min(axis=0) + found.max(axis=0)) / 2)
    assert np.array(seen) == pytest.approx(projected(middles, there), abs=1.5)
    origin, along_x, along_y, along_z = np.array(seen)
    # From the right of the robot's front: x comes nearer and y goes away, both to the right; z goes up.
    assert along_x[0] > origin[0] < along_y[0]
    assert along_y[1] < origin[1] < along_x[1]
    assert along_z[1] < origin[1] - 50
    assert along_z[0] == pytest.approx(origin[0], abs=8.0)


def test_the_nearer_item_hides_the_farther() -> None:
    there = stage()
    small, large = at(box(0.04, 0.04, 0.04), 0.02, 0.26), at(box(0.02, 0.3, 0.28), 0.28, 0.0)
    alone = len(coloured(there.draw([small]), 0))
    assert alone > 30
    for pair, place in (([small, large], 0), ([large, small], 1)):
        assert len(coloured(there.draw(pair), place)) == 0


def test_every_item_has_the_colour_of_its_place() -> None:
    there = stage(size=(320, 320))
    for place in range(4):
        # The same item at the same pose; what comes before it is out of sight.
        before = [at(box(0.02, 0.02, 0.02), 0.1, 0.1, -30.0)] * place
        picture = there.draw([*before, at(box(0.2, 0.2, 0.2), 0.05, 0.05)])
        counts = [len(coloured(picture, k)) for k in range(12)]
        assert int(np.argmax(counts)) == place
        assert counts[place] > 3000


def test_the_arm_is_seen_and_follows_its_joints() -> None:
    there = stage()
    without, bent, turned = (
        there.draw(SCENE),
        there.draw(SCENE, BENT),
        there.draw(SCENE, BENT + 0.4 * np.eye(6)[0]),
    )
    for one, other in ((without, bent), (bent, turned)):
        assert (one != other).any(axis=2).mean() > 0.03


def test_the_robot_is_drawn_as_it_is_checked() -> None:
    """Every primitive's surface lies at its radius, closed and turned outwards."""
    primitives = default_cell().robot.shapes.primitives
    for (link, surface), primitive in zip(robot_surfaces(primitives), primitives, strict=True):
        assert link == primitive.link
        start, end = np.array(primitive.start), np.array(primitive.end)
        along = (end - start) / np.linalg.norm(end - start)
        apart = (surface.vertices - start) - np.outer((surface.vertices - start) @ along, along)
        assert np.linalg.norm(apart, axis=1).max() == pytest.approx(primitive.radius)
        a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
        volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)
        round_ends = 4.0 / 3.0 * np.pi * primitive.radius**3 if primitive.capsule else 0.0
        true = np.pi * primitive.radius**2 * float(np.linalg.norm(end - start)) + round_ends
        assert volume == pytest.approx(true, rel=0.03)
        middle = (a + b + c) / 3
        outward = np.einsum("ij,ij->i", surface.normals[surface.faces[:, 0]], middle - (start + end) / 2)
        assert (outward > 0).all()


def test_at_home_the_cup_is_above_the_middle_of_the_rim() -> None:
    there = stage()
    tool = there.cell.to_container(there.cell.robot.tool(there.home[None])[0, :3, 3])
    assert tool == pytest.approx([0.16, 0.16, 0.36], abs=1e-6)
    assert (there.draw([], there.home) != there.draw([])).any(axis=2).mean() > 0.03
    far = Stage(replace(there.cell, position=(3.0, 0.0, 0.0)), SIZE)
    assert np.array_equal(far.home, np.zeros(6))


@pytest.mark.parametrize(
    "size", [(0.1, 0.1, 0.1), (0.6, 0.4, 0.4), (0.3, 0.6, 0.2), (1.2, 0.8, 0.9)], ids=str
)
def test_the_whole_container_is_in_the_picture(size: tuple[float, float, float]) -> None:
    there = stage(Container(*size), (480, 480))
    corners = np.array(np.meshgrid(*[(0.0, s) for s in size])).reshape(3, -1).T
    seen = projected(corners, there)
    assert (seen > 0).all()
    assert (seen < 480).all()
    assert np.ptp(seen, axis=0).max() > 80


def test_a_thousand_frames_of_ever_new_items_keep_no_memory() -> None:
    there, process = stage(size=(16, 16)), psutil.Process()

    def draw(count: int) -> None:
        for k in range(count):
            there.draw([at(cylinder(0.05, 0.1 + 1e-5 * k), 0.1, 0.1)])

    draw(100)
    gc.collect()
    kept = len(surfaces._ITEMS)  # of items that other tests hold
    before = process.memory_info().rss
    draw(900)
    gc.collect()
    assert process.memory_info().rss - before < 20e6
    assert len(surfaces._ITEMS) <= kept


def test_a_size_out_of_range_is_named() -> None:
    with pytest.raises(ValueError, match="at least 16 x 16"):
        stage(size=(8, 8))
