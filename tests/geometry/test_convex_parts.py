"""Convex parts and the envelope: laws on solids of every kind, exact answers where there are some."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from packenv.geometry.ball_fit import fit_ball
from packenv.geometry.convex_parts import (
    MAX_VERTICES,
    SLIVER,
    VERTEX_BUDGET,
    ConvexParts,
    convex_parts,
    envelope,
)
from packenv.geometry.convex_split import LOOSE, MAX_PARTS
from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.meshes import mesh_hash
from packenv.geometry.part_hulls import fewer_vertices, hull_of, surface_points
from packenv.geometry.topology import compact
from packenv.items.catalogue import open_catalogue
from packenv.types import FloatArray, Item
from tests.shapes import as_item, ball, box, cup, cylinder


def _extruded(corners: list[tuple[float, float]], height: float, name: str) -> Item:
    """A prism, of integer-like coordinates, over a simple polygon that is a union of boxes."""
    import manifold3d

    solid = manifold3d.Manifold.extrude(manifold3d.CrossSection([corners]), height)
    mesh = solid.to_mesh64()
    return as_item(trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts, process=False), name)


def _tube(outer: float, inner: float, height: float) -> Item:
    return as_item(trimesh.creation.annulus(r_min=inner, r_max=outer, height=height, sections=48), "tube")


def _two_boxes() -> Item:
    a, b = trimesh.creation.box((0.04, 0.04, 0.04)), trimesh.creation.box((0.04, 0.04, 0.04))
    b.apply_translation((0.08, 0.0, 0.0))
    return as_item(trimesh.util.concatenate(a, b), "pair")


L_SHAPE = _extruded([(0, 0), (0.12, 0), (0.12, 0.03), (0.03, 0.03), (0.03, 0.09), (0, 0.09)], 0.05, "L")
SOLIDS = {
    "box": box(0.1, 0.07, 0.05),
    "ball": ball(0.04, subdivisions=4),
    "can": cylinder(0.035, 0.1),
    "L": L_SHAPE,
    "cup": cup(0.04, 0.09),
    "tube": _tube(0.04, 0.034, 0.08),
    "pair": _two_boxes(),
}


@pytest.fixture(scope="module")
def parts() -> dict[str, ConvexParts]:
    return {name: convex_parts(item) for name, item in SOLIDS.items()}


def _outside(point: FloatArray, hulls: list[FloatArray]) -> FloatArray:
    """Distance of points (k, 3) from the nearest hull by its farthest plane: by qhull, none of our code."""
    planes = [ConvexHull(h).equations for h in hulls]
    return np.min([(point @ p[:, :3].T + p[:, 3]).max(axis=1) for p in planes], axis=0)


def _surface(item: Item, count: int = 4000) -> FloatArray:
    mesh = trimesh.Trimesh(item.vertices, item.faces, process=False)
    return np.array(trimesh.sample.sample_surface(mesh, count, seed=1)[0])


@pytest.mark.parametrize("name", SOLIDS)
def test_the_parts_contain_the_mesh_up_to_the_dent(name: str, parts: dict[str, ConvexParts]) -> None:
    found = parts[name]
    outside = _outside(_surface(SOLIDS[name]), list(found.parts))
    assert outside.max() <= found.dent + 2e-5
    assert 0.0 <= found.dent < 0.001


@pytest.mark.parametrize("name", SOLIDS)
def test_every_vertex_is_a_corner_of_its_part(name: str, parts: dict[str, ConvexParts]) -> None:
    for part in parts[name].parts:
        assert len(ConvexHull(part).vertices) == len(part)


@pytest.mark.parametrize("name", SOLIDS)
def test_parts_and_vertices_stay_within_their_limits(name: str, parts: dict[str, ConvexParts]) -> None:
    found = parts[name]
    assert 1 <= len(found.parts) <= MAX_PARTS
    if found.ball is None:
        limit = max(MAX_VERTICES, VERTEX_BUDGET // len(found.parts))
        assert max(len(p) for p in found.parts) <= limit


@pytest.mark.parametrize("name", SOLIDS)
def test_no_part_reaches_out_farther_than_the_bulge(name: str, parts: dict[str, ConvexParts]) -> None:
    item, found = SOLIDS[name], parts[name]
    mesh = trimesh.Trimesh(item.vertices, item.faces, process=False)
    rng = np.random.default_rng(4)
    worst = 0.0
    for part in found.parts:
        hull = trimesh.convex.convex_hull(part)
        points = np.array(trimesh.sample.sample_surface(hull, 300, seed=int(rng.integers(1e6)))[0])
        worst = max(worst, float(-trimesh.proximity.signed_distance(mesh, points).min()))
    # Samples of the measurement are 1 mm apart: what lies between is at most half of that farther out.
    assert worst <= found.bulge + 0.0005
    assert worst >= found.bulge - 0.0015


@pytest.mark.parametrize("name", SOLIDS)
def test_the_envelope_is_closed_and_contains_mesh_and_parts(name: str, parts: dict[str, ConvexParts]) -> None:
    item, found = SOLIDS[name], parts[name]
    whole = envelope(item, found)
    mesh = trimesh.Trimesh(whole.vertices, whole.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    centres = [p.mean(axis=0) + 0.999999 * (p - p.mean(axis=0)) for p in found.parts]
    points = np.concatenate([*centres, _surface(item, 500)])
    assert trimesh.proximity.signed_distance(mesh, points).min() > -SLIVER - 1e-6
    assert mesh.volume >= item.volume * (1 - 1e-9)


@pytest.mark.parametrize("name", ["cup", "tube", "ball"])
def test_contact_search_finds_mesh_and_parts_inside_the_envelope(
    name: str, parts: dict[str, ConvexParts]
) -> None:
    # Slivers with random normals would turn inside into outside, by millimetres.
    item, found = SOLIDS[name], parts[name]
    field = SurfaceField.of_item(envelope(item, found))
    points = np.concatenate([*found.parts, item.vertices, _surface(item, 2000)])
    signed, _, _ = field.closest(points)
    assert signed[np.isfinite(signed)].max() < 1e-4


@pytest.mark.parametrize("name", ["can", "cup", "L"])
def test_the_envelope_keeps_the_mass_properties_and_has_a_hash_of_its_own(
    name: str, parts: dict[str, ConvexParts]
) -> None:
    item = SOLIDS[name]
    whole = envelope(item, parts[name])
    for key in ("name", "file", "volume", "mass", "mass_estimated"):
        assert getattr(whole, key) == getattr(item, key)
    np.testing.assert_array_equal(whole.com, item.com)
    np.testing.assert_array_equal(whole.inertia, item.inertia)
    if whole is not item:
        assert whole.sha256 == mesh_hash(whole.vertices, whole.faces)


@pytest.mark.parametrize("name", ["tube", "L"])
def test_the_same_item_gives_the_same_bytes(name: str, parts: dict[str, ConvexParts]) -> None:
    again = convex_parts(SOLIDS[name])
    assert [p.tobytes() for p in again.parts] == [p.tobytes() for p in parts[name].parts]
    assert (again.bulge, again.dent) == (parts[name].bulge, parts[name].dent)
    assert envelope(SOLIDS[name], again).sha256 == envelope(SOLIDS[name], parts[name]).sha256


@pytest.mark.parametrize("name", ["tube", "L", "can"])
def test_a_rigid_motion_changes_the_bulge_little(name: str, parts: dict[str, ConvexParts]) -> None:
    item = SOLIDS[name]
    turn = Rotation.from_euler("xyz", (0.4, -0.9, 1.3)).as_matrix()
    moved = dataclasses.replace(item, vertices=item.vertices @ turn.T + (0.3, -0.2, 0.1))
    found = convex_parts(moved)
    assert abs(found.bulge - parts[name].bulge) < 0.0015
    assert abs(len(found.parts) - len(parts[name].parts)) <= len(parts[name].parts) // 2


def test_a_box_is_one_exact_part(parts: dict[str, ConvexParts]) -> None:
    found, item = parts["box"], SOLIDS["box"]
    assert len(found.parts) == 1
    assert found.bulge < 1e-9
    assert found.dent < 1e-9
    assert {tuple(np.round(v, 9)) for v in found.parts[0]} == {tuple(np.round(v, 9)) for v in item.vertices}
    assert envelope(item, found) is item


def test_a_can_is_one_part(parts: dict[str, ConvexParts]) -> None:
    assert len(parts["can"].parts) == 1
    assert parts["can"].bulge < 1e-6


def test_an_l_is_two_exact_boxes(parts: dict[str, ConvexParts]) -> None:
    found = parts["L"]
    assert len(found.parts) == 2
    assert found.bulge < 1e-6
    volume = sum(ConvexHull(p).volume for p in found.parts)
    assert volume == pytest.approx(L_SHAPE.volume, rel=1e-6)


def test_separate_bodies_are_separate_parts(parts: dict[str, ConvexParts]) -> None:
    assert len(parts["pair"].parts) == 2
    assert parts["pair"].bulge < 1e-6


def test_a_cup_stays_hollow(parts: dict[str, ConvexParts]) -> None:
    item = SOLIDS["cup"]
    # The cup of the sample has an inner radius of 29 mm at the bottom and 37 mm at the rim.
    height = np.linspace(0.012, 0.089, 20)
    turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    radius = 0.029 + 0.008 * height / 0.09 - parts["cup"].bulge - 0.0005
    inside = np.stack(
        [np.outer(radius, np.cos(turns)), np.outer(radius, np.sin(turns)), np.repeat(height[:, None], 24, 1)],
        -1,
    ).reshape(-1, 3)
    assert parts["cup"].bulge <= LOOSE + 0.0005
    assert _outside(inside, list(parts["cup"].parts)).min() > 0.0
    whole = envelope(item, parts["cup"])
    mesh = trimesh.Trimesh(whole.vertices, whole.faces, process=False)
    assert trimesh.proximity.signed_distance(mesh, inside).max() < 0.0


def test_a_closed_cavity_is_filled_by_one_part() -> None:
    outer, inner = trimesh.creation.box((0.08, 0.08, 0.08)), trimesh.creation.box((0.06, 0.06, 0.06))
    inner.invert()
    found = convex_parts(as_item(trimesh.util.concatenate(outer, inner), "hollow"))
    assert len(found.parts) == 1
    assert found.bulge < 1e-6


def test_a_ball_is_a_sphere_in_a_close_polyhedron(parts: dict[str, ConvexParts]) -> None:
    found = parts["ball"]
    assert found.ball is not None
    assert found.ball.radius == pytest.approx(0.04, abs=1e-4)
    np.testing.assert_allclose(found.ball.centre, 0.0, atol=1e-6)
    planes = ConvexHull(found.parts[0]).equations
    assert -planes[:, 3].max() >= found.ball.radius - 1e-9  # the sphere is inside
    assert np.linalg.norm(found.parts[0], axis=1).max() <= found.ball.radius + 1e-4


@pytest.mark.parametrize("squash", [1.0, 1.02])
def test_a_noisy_or_slightly_flat_ball_is_a_ball(squash: float) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.03)
    noise = np.random.default_rng(1).uniform(-0.0003, 0.0003, (len(mesh.vertices), 1))
    points = np.array(mesh.vertices) * (1 + noise / 0.03) * (1, 1, squash) + (0.5, 0.2, -0.1)
    fitted = fit_ball(points, np.array(mesh.faces))
    assert fitted is not None
    np.testing.assert_allclose(fitted.centre, (0.5, 0.2, -0.1), atol=1e-4)
    assert fitted.radius == pytest.approx(0.03 * (1 + (squash - 1) / 3), abs=1e-4)


@pytest.mark.parametrize("name", ["box", "can", "cup"])
def test_other_solids_are_no_balls(name: str) -> None:
    item = SOLIDS[name]
    assert fit_ball(item.vertices, item.faces) is None


def test_neither_a_cube_nor_a_half_nor_an_egg_is_a_ball() -> None:
    cube = box(0.05, 0.05, 0.05)
    assert fit_ball(cube.vertices, cube.faces) is None
    sphere = ball(0.04, subdivisions=4)
    egg = sphere.vertices * (1.0, 1.0, 1.12)
    assert fit_ball(egg, sphere.faces) is None
    upper = sphere.faces[(sphere.vertices[sphere.faces][:, :, 2] >= 0).all(axis=1)]
    assert fit_ball(*compact(sphere.vertices, upper)) is None


@pytest.mark.parametrize("error", [0.0002, 0.001])
def test_thinned_hulls_stay_inside_and_within_the_error(error: float) -> None:
    points = np.random.default_rng(3).normal(size=(400, 3)) * (0.03, 0.02, 0.01)
    kept = fewer_vertices(points, 10_000, error)
    outer = ConvexHull(points)
    assert (kept @ outer.equations[:, :3].T + outer.equations[:, 3]).max() < 1e-12
    assert _outside(points, [kept]).max() <= error
    assert len(kept) <= len(outer.vertices)


def test_a_limit_on_vertices_is_kept() -> None:
    points = trimesh.creation.icosphere(subdivisions=3, radius=0.05).vertices
    errors = []
    for limit in (16, 32, 64, 128):
        kept = fewer_vertices(np.array(points), limit, 1e-5)
        assert len(kept) <= limit
        errors.append(_outside(np.array(points), [kept]).max())
    assert errors == sorted(errors, reverse=True)


def test_samples_of_a_hull_are_on_it_and_dense() -> None:
    hull = hull_of(box(0.03, 0.02, 0.01).vertices)
    points = surface_points(hull, 0.001)
    away = np.abs((points @ hull.planes[:, :3].T + hull.planes[:, 3]).max(axis=1))
    assert away.max() < 1e-12
    rng = np.random.default_rng(0)
    probe = np.column_stack([rng.uniform(0, 0.03, 200), rng.uniform(0, 0.02, 200), np.zeros(200)])
    gaps = np.linalg.norm(probe[:, None] - points[None], axis=2).min(axis=1)
    assert gaps.max() <= 0.001


@pytest.mark.objects
@pytest.mark.slow
@pytest.mark.parametrize("name", ["024_bowl", "044_flat_screwdriver", "003_cracker_box", "056_tennis_ball"])
def test_scanned_items(name: str, objects_dir: Path) -> None:
    item = open_catalogue(objects_dir).item(name)
    found = convex_parts(item)
    assert (found.ball is not None) == (name == "056_tennis_ball")
    assert found.bulge < 0.006
    assert found.dent < 0.0015
    assert _outside(_surface(item), list(found.parts)).max() <= found.dent + 1e-4
    whole = envelope(item, found)
    mesh = trimesh.Trimesh(whole.vertices, whole.faces, process=False)
    assert mesh.is_watertight
