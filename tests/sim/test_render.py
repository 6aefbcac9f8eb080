"""Pictures: what is there is seen where it is, and nothing depends on what was drawn before."""

from __future__ import annotations

import gc

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from packenv.errors import InputError
from packenv.robot.files import default_cell
from packenv.sim.backdrop import Standing, View, backdrop
from packenv.sim.render import Placed, Renderer, _home
from packenv.sim.view_meshes import view_mesh
from packenv.types import Container, FloatArray, Item
from packenv.view.colours import item_colour
from tests.conftest import NO_PHYSICS
from tests.shapes import ball, box, cup, cylinder

pybullet = pytest.importorskip("pybullet", reason=NO_PHYSICS)

CONTAINER = Container(0.32, 0.32, 0.30)
SIZE = (160, 120)


def at(item: Item, x: float, y: float, z: float = 0.0) -> Placed:
    """The item upright with its bounding box from this corner."""
    return item, np.eye(3), np.array([x, y, z]) - item.vertices.min(axis=0)


SCENE = [
    at(box(0.12, 0.10, 0.08), 0.0, 0.0),
    at(cylinder(0.04, 0.12), 0.2, 0.02),
    at(ball(0.05), 0.02, 0.18),
    at(cup(0.04, 0.1), 0.18, 0.16),
]


def pixels(container: Container = CONTAINER, scene: list[Placed] = SCENE) -> NDArray[np.uint8]:
    with Renderer(item_colour) as fresh:
        return fresh.frame(container, scene, size=SIZE)


def changed(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(n, 2) row and column of every pixel that differs."""
    return np.argwhere((a != b).any(axis=2))


def test_a_picture_has_the_size_asked_for_and_is_the_same_again() -> None:
    with Renderer(item_colour) as renderer:
        for size in (SIZE, (64, 96)):
            first, again = (renderer.frame(CONTAINER, SCENE, size=size) for _ in range(2))
            assert first.shape == (size[1], size[0], 3)
            assert first.dtype == np.uint8
            assert np.array_equal(first, again)
            assert not np.shares_memory(first, again)


def test_a_picture_does_not_depend_on_what_was_drawn_before() -> None:
    other = Container(0.2, 0.4, 0.25)
    alone = pixels()
    with Renderer(item_colour) as renderer:
        for scene in (SCENE[:1], SCENE[:3], SCENE, SCENE[::-1], [], SCENE):
            last = renderer.frame(CONTAINER, scene, size=SIZE)
        assert np.array_equal(last, alone)
        renderer.frame(other, SCENE[:2], np.zeros(6), size=(50, 50))
        assert np.array_equal(renderer.frame(CONTAINER, SCENE, size=SIZE), alone)
        moved = [*SCENE[:-1], at(SCENE[-1][0], 0.1, 0.1, 0.15)]
        assert np.array_equal(renderer.frame(CONTAINER, moved, size=SIZE), pixels(scene=moved))


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer(item_colour)


def projected(points: FloatArray, container: Container, size: tuple[int, int]) -> FloatArray:
    """(n, 2) row and column of points, by PyBullet's own matrices."""
    from packenv.sim.render import _view

    view = _view(container)
    matrices = [np.reshape(m, (4, 4)).T for m in (view.projection(size[0] / size[1]), view.matrix)]
    clip = np.column_stack([points, np.ones(len(points))]) @ (matrices[0] @ matrices[1]).T
    ndc = clip[:, :2] / clip[:, 3:]
    return np.column_stack([(1 - ndc[:, 1]) / 2 * size[1], (ndc[:, 0] + 1) / 2 * size[0]])


@settings(max_examples=25, deadline=None)
@given(st.floats(0.0, 0.2), st.floats(0.0, 0.2), st.floats(0.0, 0.3), st.floats(0, 6.28), st.integers(0, 3))
def test_an_item_is_seen_where_it_is_and_nowhere_else(
    renderer: Renderer, x: float, y: float, z: float, yaw: float, which: int
) -> None:
    item = SCENE[which][0]
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    position = np.array([x + 0.05, y + 0.05, z]) - [0.0, 0.0, item.vertices[:, 2].min()]
    without = renderer.frame(CONTAINER, [], size=SIZE)
    found = changed(without, renderer.frame(CONTAINER, [(item, turn, position)], size=SIZE))
    corners = projected(item.vertices @ turn.T + position, CONTAINER, SIZE)
    low, high = corners.min(axis=0) - 1.5, corners.max(axis=0) + 1.5
    assert len(found) > 30
    assert (low <= found).all()
    assert (found <= high).all()


def test_every_item_has_the_colour_of_its_place(renderer: Renderer) -> None:
    without = renderer.frame(CONTAINER, [], size=(320, 320))
    for place in range(4):
        # The same item at the same pose; what comes before it is out of sight, below the table.
        scene = [at(box(0.02, 0.02, 0.02), 0.1, 0.1, -3.0)] * place + [at(box(0.2, 0.2, 0.2), 0.05, 0.05)]
        seen = renderer.frame(CONTAINER, scene, size=(320, 320))
        rows, columns = changed(without, seen).T
        mean = seen[rows, columns].mean(axis=0)
        likeness = [
            float(mean @ c / np.linalg.norm(mean) / np.linalg.norm(c))
            for c in (np.array(item_colour(k), dtype=float) for k in range(12))
        ]
        assert int(np.argmax(likeness)) == place


def test_the_arm_is_seen_and_follows_its_joints(renderer: Renderer) -> None:
    home = _home(default_cell().with_container(CONTAINER))
    assert home is not None
    resting = renderer.frame(CONTAINER, SCENE, size=SIZE)
    assert np.array_equal(renderer.frame(CONTAINER, SCENE, home, size=SIZE), resting)
    turned = renderer.frame(CONTAINER, SCENE, home + 0.4 * np.eye(6)[0], size=SIZE)
    assert len(changed(resting, turned)) > 0.03 * SIZE[0] * SIZE[1]
    yellow = (resting[..., 0] > 140) & (resting[..., 2] < 60)
    assert yellow.mean() > 0.05


@pytest.mark.parametrize(
    "size", [(0.1, 0.1, 0.1), (0.6, 0.4, 0.4), (0.3, 0.6, 0.2), (1.2, 0.8, 0.9)], ids=str
)
def test_the_whole_container_is_in_the_picture(size: tuple[float, float, float]) -> None:
    container = Container(*size)
    corners = np.array(np.meshgrid(*[(0.0, s) for s in size])).reshape(3, -1).T
    seen = projected(corners, container, (480, 480))
    assert (seen > 0).all()
    assert (seen < 480).all()
    assert np.ptp(seen, axis=0).max() > 150


def test_items_behind_the_front_walls_are_seen_and_those_behind_the_back_walls_are_not(
    renderer: Renderer,
) -> None:
    thin = box(0.02, 0.02, 0.1)
    empty = renderer.frame(CONTAINER, [], size=SIZE)
    front = [at(thin, 0.15, 0.0), at(thin, 0.30, 0.15)]
    for placed in front:
        assert len(changed(empty, renderer.frame(CONTAINER, [placed], size=SIZE))) > 20
    behind = at(thin, 0.2, 0.34)
    assert len(changed(empty, renderer.frame(CONTAINER, [behind], size=SIZE))) == 0


def test_closing_twice_is_fine_and_drawing_afterwards_is_not() -> None:
    renderer = Renderer(item_colour)
    folder, client = renderer._folder, renderer._client
    renderer.frame(CONTAINER, SCENE[:1], size=(16, 16))
    assert any(folder.iterdir())
    renderer.close()
    renderer.close()
    assert not renderer.open
    assert not folder.exists()
    assert not pybullet.isConnected(client)
    with pytest.raises(RuntimeError, match="closed"):
        renderer.frame(CONTAINER, [])


def test_a_forgotten_renderer_frees_its_engine() -> None:
    renderer = Renderer(item_colour)
    client, folder = renderer._client, renderer._folder
    del renderer
    gc.collect()
    assert not pybullet.isConnected(client)
    assert not folder.exists()


def test_many_different_items_do_not_pile_up(renderer: Renderer) -> None:
    for k in range(300):
        renderer.frame(CONTAINER, [at(box(0.02 + 1e-4 * k, 0.05, 0.05), 0.1, 0.1)], size=(8, 8))
    assert len(renderer._shapes) <= 257
    assert len(list(renderer._folder.iterdir())) <= 258
    assert np.array_equal(renderer.frame(CONTAINER, SCENE, size=SIZE), pixels())


def test_a_window_without_a_display_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(InputError, match="no display") as caught:
        Renderer(item_colour, mode="human")
    assert "\n" not in str(caught.value)
    assert "rgb_array" in str(caught.value)


@pytest.mark.slow
def test_opengl_sees_the_same_things() -> None:
    with Renderer(item_colour, egl=True) as renderer:
        if not renderer.hardware:
            pytest.skip("PyBullet's EGL plugin does not load here")
        empty, full = (renderer.frame(CONTAINER, scene, size=(320, 320)) for scene in ([], SCENE))
    with Renderer(item_colour) as plain:
        soft = [plain.frame(CONTAINER, scene, size=(320, 320)) for scene in ([], SCENE)]
    masks = [(a.astype(int) - b).any(axis=2) for a, b in ((empty, full), (soft[0], soft[1]))]
    # OpenGL casts shadows besides.
    assert (masks[0] & masks[1]).sum() > 0.9 * masks[1].sum()


def test_rays_go_through_the_pixels_that_pybullet_fills(renderer: Renderer) -> None:
    from packenv.sim.render import _view

    view = _view(CONTAINER)
    rays = view.rays(SIZE)
    rows, columns = np.mgrid[0 : SIZE[1] : 17, 0 : SIZE[0] : 13].reshape(2, -1)
    points = view.eye + 0.8 * rays[rows, columns]
    expected = np.column_stack([rows, columns]) + 0.5
    assert projected(points, CONTAINER, SIZE) == pytest.approx(expected, abs=2e-3)


def test_the_table_is_darker_beside_what_stands_on_it() -> None:
    view = View(np.array([0.0, -2.0, 2.0]), np.zeros(3), 40.0)
    thing = Standing((-0.1, -0.1), (0.1, 0.1), 0.01)
    picture = backdrop(view, (101, 101), [thing])
    # Straight down the middle column the ground comes nearer to the thing, and then recedes from it.
    assert picture[50, 50, 0] < picture[60, 50, 0] < picture[90, 50, 0]
    assert np.array_equal(picture[:, 0], picture[:, 100])
    points = np.array([[0.0, 0.0], [0.21, 0.0], [0.1 + 0.03, 0.1 + 0.04]])
    assert thing.distance(points) == pytest.approx([0.0, 0.10, 0.04])


def test_small_meshes_are_drawn_as_they_are_with_sharp_edges() -> None:
    item = box(0.1, 0.2, 0.3)
    mesh = view_mesh(item)
    assert np.array_equal(mesh.vertices, item.vertices)
    assert np.array_equal(mesh.faces, item.faces)
    corners = item.vertices[item.faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    assert mesh.normals == pytest.approx(np.repeat(outward[:, None], 3, axis=1))


def test_fine_meshes_get_coarser_and_stay_within_a_cell() -> None:
    item = ball(0.05, subdivisions=6)
    mesh = view_mesh(item)
    assert len(mesh.faces) < 0.7 * len(item.faces)
    radii = np.linalg.norm(mesh.vertices, axis=1)
    assert np.abs(radii - 0.05).max() < 0.1 / 56
    radial = mesh.vertices[mesh.faces]
    radial = radial / np.linalg.norm(radial, axis=2, keepdims=True)
    assert (mesh.normals * radial).sum(axis=2).min() > 0.9
    assert np.linalg.norm(mesh.normals, axis=2) == pytest.approx(1.0)


def test_the_obj_file_holds_the_surface() -> None:
    mesh = view_mesh(cup(0.04, 0.1))
    words = [line.split() for line in mesh.obj_text().splitlines()]
    vertices, normals = (np.array([w[1:] for w in words if w[0] == k], dtype=float) for k in ("v", "vn"))
    faces = np.array([[c.split("//") for c in w[1:]] for w in words if w[0] == "f"], dtype=int) - 1
    assert vertices == pytest.approx(mesh.vertices, abs=1e-6)
    assert np.array_equal(faces[..., 0], mesh.faces)
    assert normals[faces[..., 1]] == pytest.approx(mesh.normals, abs=1e-3)
