"""Exact overlap and straight-down insertion of two posed solids.

Laws first, then closed forms; manifold3d is the second engine.
"""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Sequence
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st

from packenv.geometry.collision import (
    DEFAULT_CLEARANCE,
    IDENTITY,
    BoundedCache,
    Pose,
    Posed,
    Solid,
    Surface,
    overlap_depth,
    solid_of,
    surfaces_meet,
    unit,
    winding_number,
)
from packenv.geometry.sweep import Insertion, Obstacle, Sweep, localise
from packenv.types import FloatArray, Item

C = DEFAULT_CLEARANCE
SIDES = [(axis, sign) for axis in range(3) for sign in (-1.0, 1.0)]


def item_of(mesh: trimesh.Trimesh) -> Item:
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    digest = hashlib.sha256(vertices.tobytes() + faces.tobytes()).hexdigest()
    zero = np.zeros(3)
    return Item("test", vertices, faces, 1.0, 1.0, False, zero, np.eye(3), digest, "test.ply")


def box(*size: float) -> trimesh.Trimesh:
    return trimesh.creation.box(size)


def at(
    mesh: trimesh.Trimesh, position: Sequence[float] = (0, 0, 0), rotation: FloatArray | None = None
) -> Posed:
    turn = np.eye(3) if rotation is None else rotation
    return Posed(solid_of(item_of(mesh)), Pose(turn, np.asarray(position, dtype=float)))


def random_rotation(rng: np.random.Generator) -> FloatArray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def carried(posed: Posed, rotation: FloatArray, shift: FloatArray) -> Posed:
    """The solid after the whole scene has been turned and moved."""
    pose = posed.pose
    return Posed(posed.solid, Pose(rotation @ pose.rotation, rotation @ pose.position + shift))


def blocked(lowered: Posed, there: Posed) -> bool:
    return Insertion(lowered).meets(Obstacle(there))


def manifold_of(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    made = manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=np.array(mesh.vertices, np.float64, order="C"),
            tri_verts=np.array(mesh.faces, np.uint64, order="C"),
        )
    )
    assert made.status() == manifold3d.Error.NoError
    return made


def manifold_at(mesh: trimesh.Trimesh, pose: Pose) -> manifold3d.Manifold:
    return manifold_of(mesh).transform(np.column_stack([pose.rotation, pose.position]))


def as_mesh(manifold: manifold3d.Manifold) -> trimesh.Trimesh:
    made = manifold.to_mesh64()
    return trimesh.Trimesh(made.vert_properties[:, :3], made.tri_verts.astype(np.int64), process=False)


def with_hole(size: Sequence[float], hole: Sequence[float]) -> trimesh.Trimesh:
    """A block with an upright hole right through it; their faces are at exact coordinates."""
    return as_mesh(manifold_of(box(*size)) - manifold_of(box(*hole, size[2] * 3)))


def shell(outer: float, inner: float) -> trimesh.Trimesh:
    """A closed cube with a cubic cavity: two surfaces, one of them facing inwards."""
    return as_mesh(manifold_of(box(outer, outer, outer)) - manifold_of(box(inner, inner, inner)))


def l_parts() -> list[trimesh.Trimesh]:
    return [box(0.06, 0.02, 0.02), box(0.02, 0.02, 0.08).apply_translation([0.02, 0, 0.05])]


def table_parts() -> list[trimesh.Trimesh]:
    legs = [
        box(0.01, 0.01, 0.05).apply_translation([x, y, -0.03]) for x in (-0.03, 0.03) for y in (-0.03, 0.03)
    ]
    return [box(0.08, 0.08, 0.012), *legs]


def cross_parts() -> list[trimesh.Trimesh]:
    return [box(0.09, 0.015, 0.015), box(0.015, 0.09, 0.016), trimesh.creation.icosphere(2, 0.02)]


def union(parts: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    return as_mesh(manifold3d.Manifold.batch_boolean([manifold_of(p) for p in parts], manifold3d.OpType.Add))


PARTS = {
    "l": l_parts(),
    "table": table_parts(),
    "cross": cross_parts(),
    "box": [box(0.05, 0.07, 0.03)],
    "ball": [trimesh.creation.icosphere(2, 0.03)],
}
SHAPES = {name: union(parts) for name, parts in PARTS.items()} | {
    "ring": trimesh.creation.annulus(0.025, 0.045, 0.02, sections=24),
    "torus": trimesh.creation.torus(0.035, 0.01, major_sections=24, minor_sections=10),
    "shell": shell(0.08, 0.07),
    "pair": trimesh.util.concatenate(
        [box(0.02, 0.02, 0.02), box(0.02, 0.02, 0.02).apply_translation([0.06, 0, 0])]
    ),
}
seeds = st.integers(0, 2**32 - 1)
law = settings(max_examples=30, deadline=None, derandomize=True, database=None)


def random_pair(name_a: str, name_b: str, seed: int, reach: float = 0.06) -> tuple[Posed, Posed]:
    """Two shapes turned at random, their origins at most ``reach`` apart."""
    rng = np.random.default_rng(seed)
    centre = rng.normal(size=3) * 0.1
    offset = unit(rng.normal(size=(1, 3)))[0] * rng.uniform(0.0, reach)
    a = at(SHAPES[name_a], centre, random_rotation(rng))
    return a, at(SHAPES[name_b], centre + offset, random_rotation(rng))


def check_depth(depth: float, common: manifold3d.Manifold) -> None:
    """What a depth says of the shared volume, by a second engine.

    A translation by t that separates two solids leaves no chord longer than |t| in what they shared; and
    where drawing both surfaces in by C / 2 separates them, all that they shared is that close to a surface.
    Either way the volume is at most half the area of the shared region times the depth.
    """
    if depth > 0.0:
        assert common.volume() > 0.0
    assert common.volume() <= max(depth, C) * common.surface_area() / 2 * 1.01


# ---------------------------------------------------------------------------------------------------- laws


@law
@given(st.sampled_from(sorted(SHAPES)), st.sampled_from(sorted(SHAPES)), seeds)
def test_overlap_is_symmetric_and_moves_with_the_scene(name_a: str, name_b: str, seed: int) -> None:
    a, b = random_pair(name_a, name_b, seed)
    rng = np.random.default_rng(seed + 1)
    turn, shift = random_rotation(rng), rng.normal(size=3)
    depth = overlap_depth(a, b)
    swapped = overlap_depth(b, a)
    elsewhere = overlap_depth(carried(a, turn, shift), carried(b, turn, shift))
    assert (depth > 0) == (swapped > 0) == (elsewhere > 0)


@law
@given(st.sampled_from(sorted(SHAPES)), st.sampled_from(sorted(SHAPES)), seeds)
def test_overlap_agrees_with_the_volume_of_the_boolean_intersection(
    name_a: str, name_b: str, seed: int
) -> None:
    a, b = random_pair(name_a, name_b, seed)
    check_depth(
        overlap_depth(a, b), manifold_at(SHAPES[name_a], a.pose) ^ manifold_at(SHAPES[name_b], b.pose)
    )


@law
@given(st.sampled_from(sorted(SHAPES)), st.sampled_from(sorted(SHAPES)), seeds)
def test_verdicts_are_sound_a_few_micrometres_from_contact(name_a: str, name_b: str, seed: int) -> None:
    a, b = random_pair(name_a, name_b, seed)
    rng = np.random.default_rng(seed + 1)
    away = unit(rng.normal(size=(1, 3)))[0]
    near, far = 0.0, 0.3
    while far - near > C / 20:
        middle = (near + far) / 2
        if overlap_depth(a.moved(middle * away), b) > 0.0:
            near = middle
        else:
            far = middle
    a = a.moved((far + rng.uniform(-3 * C, 0.0)) * away)
    depth = overlap_depth(a, b)
    check_depth(depth, manifold_at(SHAPES[name_a], a.pose) ^ manifold_at(SHAPES[name_b], b.pose))
    assert depth < 0.01


@law
@given(st.sampled_from(sorted(PARTS)), st.sampled_from(sorted(SHAPES)), seeds)
def test_insertion_agrees_with_a_sweep_made_of_convex_hulls(lowered: str, there: str, seed: int) -> None:
    """The sweep of a union of convex parts is the union of the hulls of each part and its copy far above."""
    a, b = random_pair(lowered, there, seed, reach=0.09)
    far = a.pose.moved(np.array([0.0, 0.0, 1.0]))
    low_and_high = [manifold_at(part, a.pose) + manifold_at(part, far) for part in PARTS[lowered]]
    sweep = manifold3d.Manifold.batch_boolean([both.hull() for both in low_and_high], manifold3d.OpType.Add)
    common = sweep ^ manifold_at(SHAPES[there], b.pose)
    if blocked(a, b):
        assert common.volume() > 0.0
    else:
        assert common.volume() <= C * SHAPES[there].area


def unpruned(a: Posed, b: Posed) -> bool:
    """Whether the sweep of the shrunk ``a`` meets ``b``: all triangles, and a lid that makes it a solid."""
    sweep = Sweep(a, shrunk=True)
    n = len(sweep.vertices)
    quads = [[j, i, i + n] for i, j in sweep.rim] + [[j, i + n, j + n] for i, j in sweep.rim]
    faces = np.concatenate([sweep.floor, np.array(quads).reshape(-1, 3), sweep.floor[:, ::-1] + n])
    vertices = np.concatenate([sweep.vertices, sweep.vertices + np.array([0.0, 0.0, 1.0])])
    placed = b.pose.apply(b.solid.vertices)
    if surfaces_meet(Surface(vertices, faces), IDENTITY, Surface(placed, b.solid.faces), IDENTITY):
        return True
    return any(winding_number(vertices, faces, placed[body[0]]) > 0.5 for body in b.solid.bodies)


@law
@given(st.sampled_from(sorted(SHAPES)), st.sampled_from(sorted(SHAPES)), seeds)
def test_pruning_changes_no_verdict(lowered: str, there: str, seed: int) -> None:
    a, b = random_pair(lowered, there, seed, reach=0.09)
    assert blocked(a, b) == unpruned(a, b)
    # Where contact only just begins a single pair of triangles decides, so a lost one shows.
    rng = np.random.default_rng(seed + 1)
    away = unit(rng.normal(size=(1, 3)))[0]
    near, far = 0.0, 0.4
    while far - near > 1e-7:
        middle = (near + far) / 2
        near, far = (middle, far) if unpruned(a.moved(middle * away), b) else (near, middle)
    for shift in (near, far, near - 1e-5, far + 1e-5):
        moved = a.moved(shift * away)
        local = localise(Sweep(moved, shrunk=True), Obstacle(b), shrunk=False, margin=2 * C)
        assert (local is not None and local.meets()) == unpruned(moved, b)


@law
@given(st.sampled_from(sorted(SHAPES)), st.sampled_from(sorted(SHAPES)), seeds)
def test_what_overlaps_is_blocked_from_above(lowered: str, there: str, seed: int) -> None:
    a, b = random_pair(lowered, there, seed)
    if overlap_depth(a, b) > 0.0:
        assert blocked(a, b)
        assert blocked(b, a)


@law
@given(st.sampled_from(sorted(SHAPES)), st.sampled_from(sorted(SHAPES)), seeds)
def test_raising_an_item_never_blocks_it(lowered: str, there: str, seed: int) -> None:
    a, b = random_pair(lowered, there, seed, reach=0.09)
    if not blocked(a, b):
        assert not blocked(a.moved(np.array([0.0, 0.0, 0.007])), b)


@law
@given(st.sampled_from(sorted(SHAPES)), st.sampled_from(sorted(SHAPES)), seeds)
def test_insertion_does_not_depend_on_yaw_and_place_of_the_scene(lowered: str, there: str, seed: int) -> None:
    a, b = random_pair(lowered, there, seed, reach=0.09)
    rng = np.random.default_rng(seed + 1)
    angle = rng.uniform(0, 2 * np.pi)
    yaw = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    shift = rng.normal(size=3)
    assert blocked(a, b) == blocked(carried(a, yaw, shift), carried(b, yaw, shift))


# ------------------------------------------------------------------------------------------- closed forms


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("depth", [-1e-3, 0.0, 0.2 * C, 0.7 * C, 0.95 * C, 1.05 * C, 3 * C, 1e-3, 0.012])
def test_boxes_overlap_if_and_only_if_deeper_than_the_clearance(depth: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.eye(3) if seed == 0 else random_rotation(rng)
    shift = rng.normal(size=3) if seed else np.zeros(3)
    for axis, sign in SIDES:
        apart = np.array([0.004, -0.003, 0.005])  # off centre, so that no edges coincide
        apart[axis] = sign * (0.05 - depth)
        a = carried(at(box(0.06, 0.06, 0.06)), turn, shift)
        b = carried(at(box(0.04, 0.04, 0.04), apart), turn, shift)
        found = overlap_depth(a, b)
        if depth <= C:
            assert found == 0.0
        else:
            assert depth * (1 - 1e-6) <= found <= depth * 1.006


def test_touching_in_every_way_is_not_overlap() -> None:
    cube = box(0.1, 0.1, 0.1)
    for offset in np.array(np.meshgrid(*[[-0.1, 0.0, 0.1]] * 3)).reshape(3, -1).T:
        if np.any(offset):
            assert overlap_depth(at(cube), at(cube, offset)) == 0.0
    on_edge = trimesh.transformations.rotation_matrix(np.pi / 4, [1, 0, 0])[:3, :3]
    assert overlap_depth(at(cube), at(cube, [0, 0, 0.05 + 0.05 * np.sqrt(2)], on_edge)) == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_a_peg_fills_a_hole_of_its_exact_size(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.eye(3) if seed == 0 else random_rotation(rng)
    block, peg = with_hole([0.1, 0.1, 0.04], [0.03, 0.05]), box(0.03, 0.05, 0.04)
    a, b = carried(at(block), turn, np.zeros(3)), carried(at(peg), turn, np.zeros(3))
    assert overlap_depth(a, b) == 0.0
    tight = carried(at(box(0.031, 0.05, 0.04)), turn, np.zeros(3))
    assert overlap_depth(a, tight) > 0.0
    if seed == 0:
        assert not blocked(a, b)
        assert not blocked(b, a)
        assert blocked(tight, a)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("distance", [0.02, 0.05, 0.058, 0.0597, 0.06001, 0.08])
def test_balls_at_closed_form_distances(distance: float, seed: int) -> None:
    ball = trimesh.creation.icosphere(4, 0.03)
    inner = float(np.linalg.norm(ball.triangles_center, axis=1).min())
    rng = np.random.default_rng(seed)
    apart = unit(rng.normal(size=(1, 3)))[0] * distance
    found = overlap_depth(at(ball), at(ball, apart, random_rotation(rng)))
    if distance >= 0.06:
        assert found == 0.0
    else:
        assert 2 * inner - distance <= found <= (0.06 - distance) * 1.006


def test_a_body_inside_another_solid_is_overlap_but_not_inside_its_cavity() -> None:
    small, big, hollow = box(0.01, 0.01, 0.01), box(0.1, 0.1, 0.1), shell(0.1, 0.06)
    assert overlap_depth(at(big), at(small, [0.01, 0.0, 0.02])) > 0.0
    assert overlap_depth(at(small), at(big, [0.01, 0.0, 0.02])) > 0.0
    assert overlap_depth(at(hollow), at(small, [0.01, 0.0, 0.02])) == 0.0
    assert overlap_depth(at(hollow), at(small, [0.04, 0.0, 0.0])) > 0.0  # within the wall
    assert blocked(at(small, [0.01, 0.0, 0.02]), at(hollow))  # apart, but there is no way in
    pair = SHAPES["pair"]
    assert overlap_depth(at(big, [0.1, 0, 0]), at(pair, [0.04, 0, 0])) > 0.0  # only its second body is inside
    assert overlap_depth(at(big, [0.15, 0, 0]), at(pair)) == 0.0


def test_depth_of_a_contained_cube_is_its_way_out() -> None:
    found = overlap_depth(at(box(0.1, 0.1, 0.1)), at(box(0.02, 0.02, 0.02), [0.03, 0.0, 0.0]))
    assert found == pytest.approx(0.03, rel=0.006)


def test_winding_number_counts_bodies_and_forgives_overlapping_ones() -> None:
    hollow = shell(0.1, 0.06)
    for point, expected in (([0.04, 0.01, 0.0], 1), ([0.0, 0.0, 0.0], 0), ([0.2, 0.0, 0.0], 0)):
        assert winding_number(hollow.vertices, hollow.faces, np.array(point)) == pytest.approx(
            expected, abs=1e-9
        )
    twice = trimesh.util.concatenate([box(0.1, 0.1, 0.1), box(0.06, 0.06, 0.06)])
    assert winding_number(twice.vertices, twice.faces, np.array([0.01, 0.0, 0.0])) == pytest.approx(
        2, abs=1e-9
    )


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_shrinking_moves_no_point_further_than_half_the_clearance(name: str) -> None:
    solid = solid_of(item_of(SHAPES[name]))
    moved = np.linalg.norm(solid.shrunk - solid.vertices, axis=1)
    assert moved.max() <= C / 2 * (1 + 1e-9)
    assert moved.min() >= C / 2 * (1 - 1e-9)
    shrunk = trimesh.Trimesh(solid.shrunk, solid.faces, process=False)
    exact = trimesh.Trimesh(solid.vertices, solid.faces, process=False)
    assert 0.0 < exact.volume - shrunk.volume <= exact.area * C / 2


# --------------------------------------------------------------------------------------- way down: examples


def test_a_ring_goes_over_a_peg_and_not_over_a_knob() -> None:
    ring = SHAPES["ring"]
    peg = trimesh.creation.cylinder(0.02, 0.2)
    knob = union([peg, trimesh.creation.icosphere(2, 0.035).apply_translation([0, 0, 0.1])])
    assert not blocked(at(ring), at(peg))
    assert overlap_depth(at(ring), at(knob)) == 0.0
    assert blocked(at(ring), at(knob))
    assert blocked(at(peg), at(ring)) is False


def test_a_hook_under_a_ledge_is_blocked() -> None:
    hook = union([box(0.02, 0.02, 0.1), box(0.06, 0.02, 0.02).apply_translation([0.02, 0, -0.04])])
    ledge = box(0.04, 0.1, 0.02)
    below = at(ledge, [0.034, 0, 0.0])
    assert overlap_depth(at(hook), below) == 0.0
    assert blocked(at(hook), below)
    assert not blocked(below, at(hook))


def test_nested_bowls_go_in_with_a_hair_between_them() -> None:
    ball, half = trimesh.creation.icosphere(4, 1.0), box(4, 4, 4).apply_translation([0, 0, 2])

    def bowl(outer: float, inner: float) -> trimesh.Trimesh:
        made = manifold_of(ball).scale([outer] * 3) - manifold_of(ball).scale([inner] * 3) - manifold_of(half)
        return as_mesh(made)

    big, small = bowl(0.08, 0.07), bowl(0.0698, 0.06)
    assert overlap_depth(at(big), at(small)) == 0.0
    assert not blocked(at(small), at(big))
    assert blocked(at(big), at(small))
    upside_down = np.diag([1.0, -1.0, -1.0])
    assert not blocked(at(big, rotation=upside_down), at(small, rotation=upside_down))


@pytest.mark.parametrize("depth", [0.0, 0.7 * C, 0.95 * C, 1.05 * C, 1e-3])
def test_sliding_down_along_a_wall_is_judged_by_the_same_clearance(depth: float) -> None:
    lowered, wall = (
        at(box(0.04, 0.04, 0.04), [0.05 - depth, 0.003, -0.01]),
        at(with_hole([0.06, 0.06, 0.1], [0.01, 0.01])),
    )
    assert blocked(lowered, wall) == (depth > C)


# ----------------------------------------------------------------------------------------------- machinery


def test_equal_vertices_are_one_and_seams_do_not_open() -> None:
    cube = box(0.1, 0.1, 0.1)
    soup = trimesh.Trimesh(cube.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    solid = Solid(item_of(soup), C)
    assert len(solid.vertices) == 8
    assert len(solid.bodies) == 1
    assert (solid.neighbours >= 0).all()


def test_neighbours_agree_with_trimesh() -> None:
    for name in ("torus", "l", "pair"):
        solid = solid_of(item_of(SHAPES[name]))
        mesh = trimesh.Trimesh(solid.vertices, solid.faces, process=False)
        expected = {tuple(sorted(pair)) for pair in mesh.face_adjacency.tolist()}
        found = {tuple(sorted((f, int(g)))) for f, row in enumerate(solid.neighbours) for g in row}
        assert found == expected


def test_cache_is_bounded_keeps_the_latest_and_does_not_trust_a_digest() -> None:
    cache: BoundedCache[int] = BoundedCache(2)
    made: list[int] = []

    def make(value: int) -> int:
        made.append(value)
        return value

    for key in (1, 2, 1, 3, 1, 2):
        assert cache.get(key, lambda key=key: make(key), lambda v: True) == key  # type: ignore[misc]
    assert made == [1, 2, 3, 2]
    a, b = item_of(box(0.1, 0.1, 0.1)), item_of(box(0.2, 0.1, 0.1))
    forged = Item("forged", b.vertices, b.faces, 1.0, 1.0, False, b.com, b.inertia, a.sha256, "f.ply")
    assert np.ptp(solid_of(a).vertices[:, 0]) == pytest.approx(0.1)
    assert np.ptp(solid_of(forged).vertices[:, 0]) == pytest.approx(0.2)


# ------------------------------------------------------------------------------------------- scanned items


@pytest.mark.objects
def test_scanned_items_agree_with_the_boolean_intersection(objects_dir: Path) -> None:
    with (objects_dir / "objects.csv").open() as lines:
        files = [row["file"] for row in csv.DictReader(lines)]
    rng = np.random.default_rng(5)
    chosen = [files[i] for i in rng.choice(len(files), 10, replace=False)]
    meshes = [trimesh.load_mesh(objects_dir / file) for file in chosen]
    verdicts = []
    for _ in range(18):
        i, j = rng.choice(len(meshes), 2, replace=False)
        reach = (meshes[i].scale + meshes[j].scale) / 4
        middles = [meshes[n].bounds.mean(axis=0) for n in (i, j)]
        turns = [random_rotation(rng) for _ in range(2)]
        a = at(meshes[i], -turns[0] @ middles[0], turns[0])
        away = unit(rng.normal(size=(1, 3)))[0] * reach * rng.uniform(0.6, 1.6)
        b = at(meshes[j], away - turns[1] @ middles[1], turns[1])
        depth = overlap_depth(a, b)
        check_depth(depth, manifold_at(meshes[i], a.pose) ^ manifold_at(meshes[j], b.pose))
        verdicts.append(depth > 0.0)
    assert 3 < sum(verdicts) < 15  # both answers came up
