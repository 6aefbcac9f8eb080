"""Conservative heightmaps: exact extremes over whole cells, checked against another engine."""

from __future__ import annotations

import math
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from packenv.config import HEIGHT_QUANTUM
from packenv.geometry.heightmaps import edges_of, orient_item
from packenv.geometry.raster_kernels import rasterize
from packenv.geometry.transforms import yaw_rotation
from packenv.items.catalogue import open_catalogue
from packenv.types import Item
from tests.geometry_samples import rasterize_by_clipping
from tests.shapes import as_item, ball, box, cup, cylinder

CELL = 0.002


def _solid(item: Item, rotation: np.ndarray, offset: np.ndarray) -> manifold3d.Manifold:
    vertices = item.vertices @ rotation.T + offset
    mesh = manifold3d.Mesh64(
        np.ascontiguousarray(vertices), np.ascontiguousarray(item.faces.astype(np.uint64))
    )
    return manifold3d.Manifold(mesh)


@pytest.mark.parametrize("seed", range(6))
def test_maps_equal_a_boolean_engine_column_by_column(seed: int) -> None:
    """The solid cut by the column over a cell (manifold3d) has the map's extremes."""
    rng = np.random.default_rng(seed)
    cell = 0.007
    item = [cup(0.03, 0.05), cylinder(0.02, 0.06, sections=24), box(0.03, 0.02, 0.05)][seed % 3]
    rotation = Rotation.random(random_state=rng).as_matrix()
    oriented = orient_item(item, rotation, cell_size=cell)
    solid = _solid(item, oriented.rotation, oriented.offset)
    missed_cells = 0
    for i in range(oriented.top.shape[0]):
        for j in range(oriented.top.shape[1]):
            column = manifold3d.Manifold.cube((cell, cell, 1.0)).translate((i * cell, j * cell, -0.5))
            cut = solid ^ column
            if cut.volume() < 1e-15:
                # A cell that is only grazed may or may not be in the footprint; one that is missed is not.
                wide = manifold3d.Manifold.cube((cell + 4e-6, cell + 4e-6, 1.0))
                missed = (solid ^ wide.translate((i * cell - 2e-6, j * cell - 2e-6, -0.5))).is_empty()
                assert not (missed and oriented.footprint[i, j])
                missed_cells += missed
                continue
            assert oriented.footprint[i, j]
            low, high = cut.bounding_box()[2], cut.bounding_box()[5]
            assert high - 1e-8 <= oriented.top[i, j] <= high + HEIGHT_QUANTUM + 1e-7
            assert low - HEIGHT_QUANTUM - 1e-7 <= oriented.bottom[i, j] <= low + 1e-8


@pytest.mark.parametrize("seed", range(20))
def test_every_surface_point_is_between_bottom_and_top(seed: int) -> None:
    rng = np.random.default_rng(seed)
    item = [cup(0.04, 0.06), ball(0.03), cylinder(0.03, 0.08), box(0.05, 0.0213, 0.033)][seed % 4]
    oriented = orient_item(item, Rotation.random(random_state=rng).as_matrix(), cell_size=CELL)
    triangles = item.vertices[item.faces]
    pick = rng.integers(0, len(triangles), 20_000)
    weights = rng.dirichlet((1, 1, 1), len(pick))
    points = np.einsum("nk,nkd->nd", weights, triangles[pick]) @ oriented.rotation.T + oriented.offset
    i, j = (points[:, :2] / CELL).astype(int).T
    inside = (i < oriented.top.shape[0]) & (j < oriented.top.shape[1])
    assert np.all(points[~inside, :2] <= np.array(oriented.top.shape) * CELL + 2e-6)
    i, j, z = i[inside], j[inside], points[inside, 2]
    assert oriented.footprint[i, j].all()
    assert np.all(z <= oriented.top[i, j] + 1e-9)
    assert np.all(z >= oriented.bottom[i, j] - 1e-9)


def test_a_box_on_the_grid_fills_exactly_its_cells() -> None:
    oriented = orient_item(box(0.1, 0.06, 0.04), np.eye(3), cell_size=CELL)
    assert oriented.top.shape == (50, 30)
    assert oriented.footprint.all()
    assert np.all(oriented.bottom == 0)
    np.testing.assert_allclose(oriented.top, 0.04, atol=HEIGHT_QUANTUM)
    assert np.all(oriented.top >= np.float32(0.04) - 1e-9)


@pytest.mark.parametrize("turn", range(4))
def test_quarter_turns_turn_the_maps(turn: int) -> None:
    item = cup(0.03, 0.05)
    tilt = Rotation.from_euler("xyz", [0.4, 0.3, 0.2]).as_matrix()
    straight = orient_item(item, tilt, cell_size=0.0005)
    turned = orient_item(item, yaw_rotation(turn * math.pi / 2) @ tilt, cell_size=0.0005)
    # The item starts on a cell boundary at its smallest x and y, so turned maps may shift by one cell:
    # compare what does not depend on that.
    assert abs(int(turned.footprint.sum()) - int(straight.footprint.sum())) < 0.02 * straight.footprint.sum()
    assert turned.height == pytest.approx(straight.height, abs=2 * HEIGHT_QUANTUM)
    shape = straight.top.shape if turn % 2 == 0 else straight.top.shape[::-1]
    assert turned.top.shape == shape


def test_maps_do_not_depend_on_where_the_mesh_frame_is() -> None:
    item = cup(0.03, 0.05)
    moved = Item(**{**vars(item), "vertices": item.vertices + np.array([0.125, -0.25, 0.5])})
    rotation = Rotation.from_euler("xyz", [1.0, 0.3, 0.7]).as_matrix()
    a, b = (orient_item(i, rotation, cell_size=CELL) for i in (item, moved))
    assert a.top.shape == b.top.shape
    assert np.mean(a.footprint != b.footprint) < 1e-3
    both = a.footprint & b.footprint
    np.testing.assert_allclose(a.top[both], b.top[both], atol=2 * HEIGHT_QUANTUM)
    np.testing.assert_allclose(a.bottom[both], b.bottom[both], atol=2 * HEIGHT_QUANTUM)


def test_a_ball_has_its_closed_form() -> None:
    radius = 0.03
    oriented = orient_item(ball(radius, subdivisions=5), np.eye(3), cell_size=CELL)
    edges = np.arange(oriented.top.shape[0] + 1) * CELL - radius
    nearest = np.clip(0.0, edges[:-1], edges[1:])
    squared = nearest[:, None] ** 2 + nearest[None, :] ** 2
    inside = squared < (0.95 * radius) ** 2
    top = radius + np.sqrt(np.maximum(radius**2 - squared, 0))
    # The mesh is inscribed in the ball: its surface is at most the sagitta of a 1.2 mm edge below.
    assert np.all(oriented.top[inside] <= top[inside] + HEIGHT_QUANTUM)
    np.testing.assert_allclose(oriented.top[inside], top[inside], atol=3e-4)
    np.testing.assert_allclose(oriented.bottom[inside], (2 * radius - top)[inside], atol=3e-4)


@pytest.mark.parametrize("turn", range(4))
def test_a_wall_on_a_cell_boundary_belongs_to_the_inner_cell(turn: int) -> None:
    """A step whose riser is on a cell boundary: the low half keeps its own height, on both sides."""
    profile = np.array([[0, 0], [0.02, 0], [0.02, 0.01], [0.01, 0.01], [0.01, 0.03], [0, 0.03]])
    stairs = as_item(trimesh.creation.extrude_triangulation(*_fan(profile), height=0.02))
    upright = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    oriented = orient_item(stairs, yaw_rotation(turn * math.pi / 2) @ upright, cell_size=CELL)
    assert oriented.top.shape == (10, 10)
    low = oriented.top < 0.0101
    np.testing.assert_allclose(oriented.top[low], 0.01, atol=HEIGHT_QUANTUM)
    np.testing.assert_allclose(oriented.top[~low], 0.03, atol=HEIGHT_QUANTUM)
    assert low.sum() == 50


def _fan(polygon: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The L-shaped polygon as two rectangles' triangles."""
    faces = np.array([[0, 3, 5], [3, 4, 5], [0, 1, 3], [1, 2, 3]])
    return polygon, faces


def test_rounding_noise_does_not_lift_an_item() -> None:
    """A flat bottom stays at height 0 and a flat top at its own quantum after any rotation about z."""
    for angle in np.linspace(0.1, 3.0, 30):
        tilt = Rotation.from_euler("x", math.pi / 2).as_matrix()
        oriented = orient_item(box(0.064, 0.032, 0.048), yaw_rotation(angle) @ tilt, cell_size=CELL)
        assert np.all(oriented.bottom[oriented.footprint] == 0)
        exact = math.ceil(0.032 / HEIGHT_QUANTUM - 1e-6) * HEIGHT_QUANTUM
        assert np.all(oriented.top[oriented.footprint] == exact)


def test_a_sheet_thinner_than_a_cell_is_not_missed() -> None:
    """A centre-sampled map would not see it."""
    oriented = orient_item(box(0.05, 0.0003, 0.03), yaw_rotation(0.3), cell_size=CELL)
    assert oriented.height == pytest.approx(0.03, abs=HEIGHT_QUANTUM)
    columns = oriented.footprint.any(axis=1)
    assert columns.all()


# ------------------------------------------------------------------- the raster and its definition


def _rasters(vertices: np.ndarray, faces: np.ndarray, cell: float) -> list[np.ndarray]:
    """Top and bottom by the raster, then by its definition."""
    shape = tuple(max(1, math.ceil((e - 1e-6) / cell)) for e in vertices.max(axis=0)[:2])
    maps = [np.full(shape, extreme) for extreme in (-np.inf, np.inf) * 2]
    rasterize(vertices, faces, *edges_of(faces), cell, *maps[:2])
    rasterize_by_clipping(vertices, faces, cell, *maps[2:])
    return maps


def _assert_rasters_agree(vertices: np.ndarray, faces: np.ndarray, cell: float) -> None:
    vertices = np.ascontiguousarray(vertices - vertices.min(axis=0))
    top, bottom, top_wanted, bottom_wanted = _rasters(vertices, faces, cell)
    assert np.isfinite(bottom_wanted).any()
    np.testing.assert_array_equal(np.isfinite(bottom), np.isfinite(bottom_wanted))
    np.testing.assert_array_equal(np.isfinite(top), np.isfinite(top_wanted))
    there = np.isfinite(bottom)
    np.testing.assert_allclose(top[there], top_wanted[there], rtol=0, atol=1e-14)
    np.testing.assert_allclose(bottom[there], bottom_wanted[there], rtol=0, atol=1e-14)


@pytest.mark.parametrize("cell", [0.0007, 0.002, 0.011])
@pytest.mark.parametrize("seed", range(12))
def test_the_raster_equals_clipping_every_triangle(seed: int, cell: float) -> None:
    """Turned at random, turned in steps of 45° as the planner does, and not at all."""
    rng = np.random.default_rng(seed)
    item = [cup(0.03, 0.05), ball(0.03), cylinder(0.02, 0.06), box(0.04, 0.02, 0.06)][seed % 4]
    turn = [
        Rotation.random(random_state=rng),
        Rotation.from_euler("zyx", rng.integers(0, 8, 3) * math.pi / 4),
        Rotation.identity(),
    ][seed // 4]
    _assert_rasters_agree(item.vertices @ turn.as_matrix().T, item.faces, cell)


@pytest.mark.parametrize("grain", [0.0, 1e-7, 5e-7, 9.999e-7, 1.001e-6, 3e-6, 0.001, 0.3])
@pytest.mark.parametrize("seed", range(10))
def test_the_raster_equals_clipping_where_the_tolerance_decides(seed: int, grain: float) -> None:
    """A soup of triangles, needles and points with corners about ``grain`` off the lines between cells."""
    rng = np.random.default_rng(seed)
    cell = 0.002
    vertices = np.round(rng.uniform(0, 12, (60, 3)))
    vertices[:, :2] += rng.choice([-1.0, 0.0, 1.0], (60, 2)) * grain / cell * rng.uniform(0.9, 1.1, (60, 2))
    faces = rng.integers(0, 60, (90, 3))
    _assert_rasters_agree(vertices * cell, faces, cell)


@pytest.mark.parametrize("seed", range(20))
def test_the_raster_equals_clipping_on_any_soup(seed: int) -> None:
    """Nothing is asked of the mesh: neither closed nor oriented, of any size of triangle, in any cells."""
    rng = np.random.default_rng(seed)
    vertices = rng.uniform(0, rng.choice([0.002, 0.01, 0.1]), (40, 3))
    faces = rng.integers(0, 40, (30, 3))
    _assert_rasters_agree(vertices, faces, float(rng.uniform(0.001, 0.01)))


@pytest.mark.objects
def test_maps_of_scanned_items_are_those_of_the_definition(objects_dir: Path) -> None:
    """To the last quantum, on triangles as they come."""
    catalogue = open_catalogue(str(objects_dir))
    rng = np.random.default_rng(0)
    for name in catalogue.names[::12]:
        item = catalogue.item(name)
        for _ in range(3):
            oriented = orient_item(item, Rotation.random(random_state=rng).as_matrix(), cell_size=CELL)
            vertices = item.vertices @ oriented.rotation.T + oriented.offset
            top, bottom = np.full(oriented.top.shape, -np.inf), np.full(oriented.top.shape, np.inf)
            rasterize_by_clipping(vertices, item.faces, CELL, top, bottom)
            there = np.isfinite(bottom)
            np.testing.assert_array_equal(oriented.footprint, there)
            wanted = (np.ceil((top[there] - 1e-12) / HEIGHT_QUANTUM) * HEIGHT_QUANTUM).astype(np.float32)
            np.testing.assert_array_equal(oriented.top[there], wanted)
            wanted = (np.floor((bottom[there] + 1e-12) / HEIGHT_QUANTUM) * HEIGHT_QUANTUM).astype(np.float32)
            np.testing.assert_array_equal(oriented.bottom[there], wanted)
            assert not oriented.top[~there].any()


def test_every_edge_is_listed_once_and_every_face_has_its_own() -> None:
    faces = cup(0.03, 0.05).faces
    edges, of_face = edges_of(faces)
    assert len(np.unique(edges, axis=0)) == len(edges) == len(faces) * 3 // 2
    for face, own in zip(faces, of_face, strict=True):
        pairs = {frozenset(face[[k, (k + 1) % 3]].tolist()) for k in range(3)}
        assert {frozenset(edges[e].tolist()) for e in own} == pairs
