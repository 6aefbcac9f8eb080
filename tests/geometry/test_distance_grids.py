"""Laws of surface fields: exact distances against brute force, signs against winding numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from packenv.geometry.collision import winding_number
from packenv.geometry.distance_grids import BAND, REACH, SAMPLE_SPACING, SurfaceField
from packenv.items.catalogue import open_catalogue
from packenv.types import FloatArray, IntArray, Item
from tests.shapes import ball, box, cup, cylinder

SHAPES = {
    "box": box(0.05, 0.03, 0.02),
    "ball": ball(0.02),
    "can": cylinder(0.02, 0.05),
    "thin cup": cup(0.03, 0.05, wall=0.001),
}
OWN = ("fork", "nesting_cup_3", "strawberry")
SCANNED = ("072-c_toy_airplane", "050_medium_clamp", "059_chain", "002_master_chef_can")


def closest_by_brute_force(vertices: FloatArray, faces: IntArray, points: FloatArray) -> FloatArray:
    """(k,) distance to the nearest of all triangles: inside by planes, else the nearest of all edges."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    solid = length > 1e-18
    a, b, c, normal = a[solid], b[solid], c[solid], normal[solid] / length[solid, None]
    result = np.empty(len(points))
    for s, p in enumerate(points):
        height = np.einsum("ij,ij->i", p - a, normal)
        inside = np.ones(len(a), bool)
        least = np.full(len(a), np.inf)
        for u, v in ((a, b), (b, c), (c, a)):
            edge, way = v - u, p - u
            inside &= np.einsum("ij,ij->i", np.cross(edge, way), normal) >= 0
            t = np.clip(np.einsum("ij,ij->i", way, edge) / np.einsum("ij,ij->i", edge, edge), 0, 1)
            least = np.minimum(least, np.linalg.norm(way - t[:, None] * edge, axis=1))
        result[s] = np.where(inside, np.abs(height), least).min()
    return result


def check_against_brute_force(item: Item, count: int, seed: int = 0) -> None:
    field = SurfaceField.of_item(item)
    rng = np.random.default_rng(seed)
    points = field.samples[rng.integers(0, len(field.samples), count)] + rng.normal(size=(count, 3)) * 0.0015
    exact = closest_by_brute_force(item.vertices, item.faces, points)
    inside = np.array([winding_number(item.vertices, item.faces, p) > 0.5 for p in points])
    signed = np.where(inside, -exact, exact)
    found, feet, faces = field.closest(points)
    assert np.array_equal(np.isfinite(found), exact <= REACH)
    near = np.isfinite(found)
    assert np.abs(np.abs(found[near]) - exact[near]).max() < 1e-7
    assert np.abs(np.linalg.norm(points[near] - feet[near], axis=1) - exact[near]).max() < 1e-7
    clear = near & (exact > 1e-6)
    assert np.array_equal(found[clear] < 0, inside[clear])
    # The foot lies in the plane of the face that is named.
    corner = field.vertices[field.faces[faces[near], 0]]
    off = np.einsum("ij,ij->i", feet[near] - corner, field.normals[faces[near]])
    assert np.abs(off).max() < 1e-7
    # Interpolation cannot see edges and walls between nodes: mostly within 0.2 mm, never off by a cell.
    quick = np.abs(field.distances(points) - np.clip(signed, -BAND, BAND))
    assert quick.max() < 2e-3
    assert np.median(quick) < 2e-4


@pytest.mark.parametrize("name", SHAPES)
def test_distances_equal_brute_force(name: str) -> None:
    check_against_brute_force(SHAPES[name], 300)


@pytest.mark.parametrize("name", OWN)
def test_distances_of_own_items_equal_brute_force(name: str) -> None:
    check_against_brute_force(open_catalogue("builtin").item(name), 200)


@pytest.mark.objects
@pytest.mark.parametrize("name", SCANNED)
def test_distances_of_scanned_items_equal_brute_force(name: str, objects_dir: Path) -> None:
    check_against_brute_force(open_catalogue(str(objects_dir)).item(name), 120)


def test_grid_nodes_hold_exact_signed_distances() -> None:
    item = SHAPES["thin cup"]
    field = SurfaceField.of_item(item)
    rng = np.random.default_rng(1)
    index = np.stack([rng.integers(0, n, 400) for n in field.distance.shape], axis=1)
    points = field.origin + index * 0.002
    exact = closest_by_brute_force(item.vertices, item.faces, points)
    inside = np.array([winding_number(item.vertices, item.faces, p) > 0.5 for p in points])
    expected = np.minimum(exact, BAND) * np.where(inside, -1, 1)
    assert np.abs(field.distance[tuple(index.T)] - expected).max() < 1e-7


def test_distance_to_a_plane_is_interpolated_exactly() -> None:
    field = SurfaceField.of_item(box(0.06, 0.06, 0.06))
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(0.015, 0.045, (500, 2)), rng.uniform(0.058, 0.063, 500)])
    assert field.distances(points) == pytest.approx(points[:, 2] - 0.06, abs=1e-7)


def test_bodies_apart_and_cavities_are_signed() -> None:
    shell = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    hollow = trimesh.creation.icosphere(subdivisions=3, radius=0.02)
    beside = trimesh.creation.box(extents=(0.02, 0.02, 0.02))
    beside.apply_translation((0.06, 0, 0))
    hollow.invert()
    mesh = trimesh.util.concatenate([shell, hollow, beside])
    field = SurfaceField.of_mesh(np.array(mesh.vertices), np.array(mesh.faces))
    points = np.array([[0.0, 0, 0], [0.0251, 0, 0], [0.0, 0.032, 0], [0.06, 0, 0], [0.045, 0, 0]])
    assert list(np.sign(field.distances(points))) == [1, -1, 1, -1, 1]


def test_points_out_of_the_grid_are_far() -> None:
    field = SurfaceField.of_item(SHAPES["box"])
    points = np.array([[1.0, 1.0, 1.0], [-0.5, 0.0, 0.0]])
    assert list(field.distances(points)) == [BAND, BAND]
    signed, feet, faces = field.closest(points)
    assert np.all(np.isinf(signed))
    assert np.all(np.isnan(feet))
    assert list(faces) == [-1, -1]


@pytest.mark.parametrize("name", SHAPES)
def test_samples_lie_on_the_surface_and_leave_no_gap(name: str) -> None:
    item = SHAPES[name]
    field = SurfaceField.of_item(item)
    pick = np.random.default_rng(3).integers(0, len(field.samples), 300)
    assert closest_by_brute_force(item.vertices, item.faces, field.samples[pick]).max() < 1e-7
    mesh = trimesh.Trimesh(item.vertices, item.faces, process=False)
    anywhere, of = trimesh.sample.sample_surface(mesh, 2000, seed=4)
    for point, normal in zip(anywhere, mesh.face_normals[of], strict=True):
        away = np.linalg.norm(field.samples - point, axis=1)
        same_side = field.records[:, 3:6] @ normal > 0.5
        # Thinning keeps one sample a cube, so two may be a cube's diagonal and a bit apart.
        assert away[same_side].min() < 2.0 * SAMPLE_SPACING


def test_corners_and_edges_of_a_box_are_samples() -> None:
    field = SurfaceField.of_item(box(0.05, 0.03, 0.02))
    for corner in np.stack(np.meshgrid([0, 0.05], [0, 0.03], [0, 0.02]), axis=-1).reshape(-1, 3):
        assert np.linalg.norm(field.samples - corner, axis=1).min() < 1e-8
    on_edge = field.samples[(np.abs(field.samples[:, 1:]) < 1e-9).all(axis=1)]
    assert np.diff(np.sort(np.unique(on_edge[:, 0]))).max() <= SAMPLE_SPACING * 1.001


def test_build_is_repeatable_and_arrays_round_trip() -> None:
    item = SHAPES["thin cup"]
    field, again = SurfaceField.of_item(item), SurfaceField.of_item(item)
    back = SurfaceField.from_arrays(field.to_arrays())
    for name, array in field.to_arrays().items():
        assert np.array_equal(array, again.to_arrays()[name]), name
        assert np.array_equal(array, back.to_arrays()[name]), name
    points = np.random.default_rng(5).uniform(-0.03, 0.05, (100, 3))
    assert np.array_equal(field.distances(points), back.distances(points))


def test_foreign_arrays_are_refused() -> None:
    arrays = SurfaceField.of_item(SHAPES["box"]).to_arrays()
    with pytest.raises(KeyError):
        SurfaceField.from_arrays({k: v for k, v in arrays.items() if k != "boxes"})
    with pytest.raises(ValueError, match="faces points outside the mesh"):
        SurfaceField.from_arrays({**arrays, "faces": arrays["faces"] + 1})
    with pytest.raises(ValueError, match="do not fit together"):
        SurfaceField.from_arrays({**arrays, "kinds": arrays["kinds"][1:]})
    with pytest.raises(ValueError, match="distance is float64"):
        SurfaceField.from_arrays({**arrays, "distance": arrays["distance"].astype(float)})
