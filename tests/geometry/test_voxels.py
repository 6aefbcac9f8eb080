"""Voxels hold all of an item and nothing that it does not touch; what shares none does not overlap."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st

from packenv.geometry.collision import Posed, overlap_depth, solid_of, winding_number
from packenv.geometry.run_kernels import shared
from packenv.geometry.run_table import RunTable
from packenv.geometry.voxels import Voxels, voxelize
from packenv.items.catalogue import open_catalogue
from packenv.types import Item, Pose
from tests.geometry_samples import random_rotation, surface_samples
from tests.shapes import as_item, ball, box, cup, cylinder

PITCH = 0.004
SHAPES = [
    box(0.05, 0.03, 0.02),
    ball(0.02),
    cylinder(0.015, 0.05),
    cup(0.03, 0.05),
    as_item(trimesh.creation.annulus(r_min=0.015, r_max=0.03, height=0.012), "ring"),
    *(open_catalogue(None).item(name) for name in ("bowl", "mug")),
]


def settled(item: Item, rotation: np.ndarray) -> np.ndarray:
    points = item.vertices @ rotation.T
    return points - points.min(axis=0)


def posed(item: Item, rotation: np.ndarray, at: np.ndarray) -> Posed:
    low = (item.vertices @ rotation.T).min(axis=0)
    return Posed(solid_of(item), Pose(rotation, at * PITCH - low))


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(SHAPES), st.sampled_from(SHAPES), st.integers(0, 10_000))
def test_what_shares_no_voxel_does_not_overlap(a: Item, b: Item, seed: int) -> None:
    rotations = random_rotation(seed), random_rotation(seed + 1)
    first, second = (voxelize(*pair, PITCH) for pair in zip((a, b), rotations, strict=True))
    rng = np.random.default_rng(seed)
    zero, table = np.zeros(3, dtype=np.int64), RunTable()
    own, other = table.of(first), table.of(second)
    for _ in range(6):
        # Around first contact, where the answer is in doubt.
        direction = rng.normal(size=3)
        direction *= 0.4 / np.linalg.norm(direction) / PITCH
        steps = np.rint(np.linspace(0.0, 1.0, 120)[:, None] * direction).astype(np.int64)
        at = next(step for step in steps if not shared(*table.arrays, own, 0, 0, 0, other, step))
        assert overlap_depth(posed(a, rotations[0], zero), posed(b, rotations[1], at)) == 0.0


@pytest.mark.parametrize("item", SHAPES, ids=lambda item: item.name)
@pytest.mark.parametrize("seed", range(3))
def test_voxels_hold_surface_and_inside(item: Item, seed: int) -> None:
    rotation = random_rotation(seed)
    found = voxelize(item, rotation, PITCH)
    rng = np.random.default_rng(seed)
    low = (item.vertices @ rotation.T).min(axis=0)
    inside = surface_samples(item, 2000, rng) @ rotation.T - low
    cells = np.clip(np.floor(inside / PITCH).astype(int), 0, np.array(found.grid.shape) - 1)
    assert found.grid[tuple(cells.T)].all()
    vertices = settled(item, rotation)
    for point in rng.random((150, 3)) * found.extents:
        if winding_number(vertices, item.faces, point) > 0.5:
            assert found.grid[tuple(np.floor(point / PITCH).astype(int))]


def test_no_voxel_is_set_that_a_ball_does_not_touch() -> None:
    radius, item = 0.03, ball(0.03, subdivisions=4)
    found = voxelize(item, np.eye(3), PITCH)
    centre = found.extents / 2
    corners = np.stack(np.indices(found.grid.shape), axis=-1) * PITCH
    nearest = np.clip(centre, corners, corners + PITCH)
    distance = np.linalg.norm(nearest - centre, axis=-1)
    assert not found.grid[distance > radius + 1e-9].any()
    assert found.grid[distance < radius * 0.995].all()  # what the facets cut off the ball is less


def test_a_box_of_whole_voxels_has_no_further_one() -> None:
    found = voxelize(box(0.04, 0.02, 0.012), np.eye(3), PITCH)
    assert found.grid.shape == (10, 5, 3)
    assert found.grid.all()
    assert found.places((0.08, 0.02, 0.011)) == (11, 1, 0)


def test_a_cup_stays_open_and_a_hollow_ball_is_full() -> None:
    open_cup = voxelize(cup(0.03, 0.05), np.eye(3), PITCH)
    middle = open_cup.grid[open_cup.grid.shape[0] // 2, open_cup.grid.shape[1] // 2]
    assert middle[0]
    assert not middle[2:].any()
    shell = trimesh.util.concatenate(
        [trimesh.creation.icosphere(radius=0.03), trimesh.creation.icosphere(radius=0.02)]
    )
    shell.faces[len(shell.faces) // 2 :] = shell.faces[len(shell.faces) // 2 :, ::-1]
    hollow = voxelize(as_item(trimesh.Trimesh(shell.vertices, shell.faces, process=False)), np.eye(3), PITCH)
    assert hollow.grid[tuple(n // 2 for n in hollow.grid.shape)]


def test_count_is_the_number_of_voxels() -> None:
    grid = np.zeros((2, 2, 2), dtype=np.bool_)
    grid[0, 1, 1] = True
    assert Voxels(grid, np.full(3, 0.008), PITCH).count == 1
