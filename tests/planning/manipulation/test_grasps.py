"""Grasps: laws on random maps against a plain reference, then solids and both catalogues."""

from __future__ import annotations

import dataclasses
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import trimesh

from packenv.config import GridConfig
from packenv.geometry.heightmaps import orient_item
from packenv.geometry.prepare import prepare_item
from packenv.items.catalogue import open_catalogue
from packenv.planning.manipulation.grasps import (
    FLAT_RELIEF,
    FLAT_SLOPE,
    ROUGH_COVER,
    ROUGH_RELIEF,
    ROUGH_SLOPE,
    generate_grasps,
)
from packenv.types import OrientedItem
from tests.planning.search.random_maps import CELL, quantized
from tests.shapes import as_item, ball, box, cup, cylinder

RADIUS = 0.01


def oriented_of(item, rotation=None) -> OrientedItem:
    return orient_item(item, np.eye(3) if rotation is None else rotation, cell_size=CELL)


def random_top(rng: np.random.Generator) -> OrientedItem:
    """Plateaus, slopes, bumps and holes: every kind of grasp, and none, comes up."""
    w, h = rng.integers(8, 40, 2)
    i, j = np.mgrid[:w, :h]
    top = 0.03 + CELL * (i * rng.normal() * 0.15 + j * rng.normal() * 0.15)
    for _ in range(rng.integers(0, 4)):
        a, b = rng.integers(0, w), rng.integers(0, h)
        top[a : a + rng.integers(2, 20), b : b + rng.integers(2, 20)] += rng.uniform(-0.01, 0.01)
    top += rng.random((w, h)) * rng.choice([0.0, 0.001, 0.003])
    top = quantized(top - top.min() + 0.001)
    footprint = rng.random((w, h)) > rng.choice([0.0, 0.002, 0.02])
    footprint[w // 2, h // 2] = True
    return OrientedItem(
        "thing",
        0,
        0.0,
        np.eye(3),
        np.zeros(3),
        np.array([w * CELL, h * CELL, float(top[footprint].max())]),
        np.array([w * CELL * rng.uniform(0.3, 0.7), h * CELL * rng.uniform(0.3, 0.7), 0.01]),
        np.where(footprint, top, np.float32(0)).astype(np.float32),
        np.where(footprint, np.float32(0), np.float32(np.inf)).astype(np.float32),
        CELL,
    )


def under(oriented: OrientedItem, x: float, y: float, radius: float = RADIUS):
    """By the definition: cover, highest, slope and relief of the cells that a disc overlaps."""
    i = np.arange(-12, oriented.top.shape[0] + 12)[:, None]
    j = np.arange(-12, oriented.top.shape[1] + 12)[None, :]
    dx = np.maximum(np.abs((i + 0.5) * CELL - x) - CELL / 2, 0)
    dy = np.maximum(np.abs((j + 0.5) * CELL - y) - CELL / 2, 0)
    disc = np.hypot(dx, dy) < radius - 1e-6
    ii, jj = np.nonzero(disc)
    ii, jj = ii - 12, jj - 12
    there = (ii >= 0) & (jj >= 0) & (ii < oriented.top.shape[0]) & (jj < oriented.top.shape[1])
    there[there] = oriented.footprint[ii[there], jj[there]]
    z = oriented.top[ii[there], jj[there]].astype(float)
    if len(z) < 3:
        return there.mean(), z.max(initial=0.0), np.inf, np.inf
    a = np.column_stack([(ii[there] + 0.5) * CELL, (jj[there] + 0.5) * CELL, np.ones(len(z))])
    plane = np.linalg.lstsq(a, z, rcond=None)[0]
    return there.mean(), z.max(), np.hypot(*plane[:2]), np.ptp(z - a @ plane)


@pytest.mark.parametrize("seed", range(60))
def test_every_grasp_is_what_it_says(seed: int) -> None:
    oriented = random_top(np.random.default_rng(seed))
    grasps = generate_grasps(oriented)
    for grasp in grasps:
        cover, highest, slope, relief = under(oriented, *grasp.point[:2])
        assert grasp.point[2] == highest
        assert np.tan(grasp.tilt) == pytest.approx(slope, abs=1e-6)
        assert grasp.relief == pytest.approx(relief, abs=1e-7)
        flat = cover == 1.0 and slope <= FLAT_SLOPE + 1e-9 and relief <= FLAT_RELIEF + 1e-9
        assert flat == (grasp.kind != "rough")
        assert cover >= ROUGH_COVER
        assert slope <= ROUGH_SLOPE + 1e-9
        assert relief <= ROUGH_RELIEF + 1e-9
    for one, other in combinations(grasps, 2):
        assert np.hypot(*(one.point - other.point)[:2]) >= RADIUS


def test_the_random_maps_bring_up_every_kind() -> None:
    kinds = set()
    for seed in range(60):
        grasps = generate_grasps(random_top(np.random.default_rng(seed)))
        kinds.update([g.kind for g in grasps] or ["none"])
    assert kinds == {"centre", "flat", "rough", "none"}


@pytest.mark.parametrize("seed", range(12))
def test_no_flat_spot_is_overlooked(seed: int) -> None:
    """Where the answer is none or rough, no cell's centre is flat by the definition."""
    oriented = random_top(np.random.default_rng([1, seed]))
    flat = generate_grasps(oriented, rule="flat", limit=500)
    w, h = oriented.top.shape
    for i in range(w):
        for j in range(h):
            x, y = (i + 0.5) * CELL, (j + 0.5) * CELL
            cover, _, slope, relief = under(oriented, x, y)
            if cover == 1.0 and slope < FLAT_SLOPE - 1e-6 and relief < FLAT_RELIEF - 1e-6:
                assert min(np.hypot(*(g.point[:2] - (x, y))) for g in flat) < RADIUS + 1e-9


@pytest.mark.parametrize("seed", range(20))
def test_flat_spots_come_nearest_to_the_centre_of_mass_first(seed: int) -> None:
    oriented = random_top(np.random.default_rng([2, seed]))
    flat = [g for g in generate_grasps(oriented, rule="flat", limit=30) if g.kind == "flat"]
    apart = [np.hypot(*(g.point - oriented.com)[:2]) for g in flat]
    assert np.all(np.diff(apart) > -CELL)


@pytest.mark.parametrize("seed", range(20))
def test_a_larger_limit_only_adds(seed: int) -> None:
    oriented = random_top(np.random.default_rng([3, seed]))
    for rule in ("seal", "flat"):
        few, many = (generate_grasps(oriented, rule=rule, limit=n) for n in (2, 6))
        assert [g.point.tolist() for g in few] == [g.point.tolist() for g in many[:2]]


@pytest.mark.parametrize("seed", range(20))
def test_raising_the_item_raises_the_grasps(seed: int) -> None:
    """A higher bottom half changes nothing but the height."""
    oriented = random_top(np.random.default_rng([4, seed]))
    lift = np.float32(2.0**-6)
    raised = dataclasses.replace(
        oriented, top=np.where(oriented.footprint, oriented.top + lift, np.float32(0)).astype(np.float32)
    )
    before, after = generate_grasps(oriented), generate_grasps(raised)
    assert [g.kind for g in before] == [g.kind for g in after]
    for one, other in zip(before, after, strict=True):
        np.testing.assert_allclose(other.point - one.point, [0, 0, lift], atol=1e-9)


def test_a_box_is_taken_at_its_centre() -> None:
    grasps = generate_grasps(oriented_of(box(0.08, 0.05, 0.03)))
    assert grasps[0].kind == "centre"
    np.testing.assert_allclose(grasps[0].point, [0.04, 0.025, 0.03], atol=1e-6)
    assert grasps[0].tilt == pytest.approx(0.0, abs=1e-4)
    assert len(grasps) == 8


def test_the_smallest_box_that_can_be_taken() -> None:
    assert generate_grasps(oriented_of(box(0.02, 0.02, 0.05)))[0].kind == "centre"
    assert generate_grasps(oriented_of(box(0.012, 0.012, 0.05))) == ()
    assert generate_grasps(oriented_of(box(0.012, 0.012, 0.05)), radius=0.005) != ()


def test_a_wedge_is_taken_up_to_ten_degrees() -> None:
    def wedge(degrees: float) -> OrientedItem:
        rise = 0.1 * np.tan(np.radians(degrees))
        points = [(x, y, z) for y in (0, 0.06) for x, z in ((0, 0), (0.1, 0), (0, 0.02), (0.1, 0.02 + rise))]
        return oriented_of(as_item(trimesh.convex.convex_hull(np.array(points))))

    assert generate_grasps(wedge(9), rule="flat")[0].tilt == pytest.approx(np.radians(9), abs=1e-3)
    assert generate_grasps(wedge(11), rule="flat") == ()
    assert {g.kind for g in generate_grasps(wedge(11))} == {"rough"}
    assert generate_grasps(wedge(22)) == ()


def test_a_ball_is_as_rough_as_its_cap_is_high() -> None:
    large, small = (generate_grasps(oriented_of(ball(r, subdivisions=4))) for r in (0.06, 0.02))
    assert large[0].kind == "centre"
    # The disc's farthest cell corner is at most a cell and a half beyond the lip; the cap is r² / 2R high.
    assert 0.5 * RADIUS**2 / 0.12 < large[0].relief < 0.013**2 / 0.12
    assert {g.kind for g in small} <= {"rough"}
    np.testing.assert_allclose(small[0].point[:2], [0.02, 0.02], atol=CELL)


def test_a_cup_is_taken_inside_or_by_its_bottom() -> None:
    upright = oriented_of(cup(0.04, 0.09))
    inside = generate_grasps(upright)[0]
    assert inside.kind == "centre"
    assert inside.point[2] == pytest.approx(0.003, abs=1e-5)
    upside_down = oriented_of(cup(0.04, 0.09), np.diag([1.0, -1.0, -1.0]))
    assert generate_grasps(upside_down)[0].point[2] == pytest.approx(0.09, abs=1e-5)


def test_a_thin_ring_says_that_it_cannot_be_taken() -> None:
    ring = oriented_of(as_item(trimesh.creation.annulus(0.05, 0.055, 0.02, sections=64)))
    assert generate_grasps(ring) == ()
    # The paper's assumption takes it all the same, in the air over the hole.
    (assumed,) = generate_grasps(ring, rule="paper")
    np.testing.assert_allclose(assumed.point, [0.055, 0.055, 0.02], atol=1e-5)
    assert np.isnan(assumed.relief)


def test_the_papers_rule_is_the_centre_whatever_is_there() -> None:
    standing = oriented_of(cylinder(0.005, 0.1))
    (only,) = generate_grasps(standing, rule="paper")
    np.testing.assert_allclose(only.point, [0.005, 0.005, 0.1], atol=1e-4)
    assert generate_grasps(standing) == ()


def test_settings_that_make_no_sense_are_refused() -> None:
    oriented = oriented_of(box(0.05, 0.05, 0.05))
    with pytest.raises(ValueError, match="'seal', 'flat' or 'paper'"):
        generate_grasps(oriented, rule="best")
    with pytest.raises(ValueError, match="limit 0"):
        generate_grasps(oriented, limit=0)
    with pytest.raises(ValueError, match="radius is -1"):
        generate_grasps(oriented, radius=-1)


def test_every_item_of_ours_can_be_taken_in_some_pose() -> None:
    catalogue = open_catalogue("builtin")
    grid = GridConfig(n_yaws=1)
    for name in catalogue.names[::8]:
        poses = prepare_item(catalogue.item(name), grid).orientations
        assert any(generate_grasps(o) for o in poses), name


@pytest.mark.objects
def test_scanned_items_that_no_cup_takes(objects_dir: Path) -> None:
    catalogue = open_catalogue(objects_dir)
    grid = GridConfig(n_yaws=1)
    for name, taken in (("059_chain", False), ("063-a_marbles", False), ("003_cracker_box", True)):
        poses = prepare_item(catalogue.item(name), grid).orientations
        assert any(generate_grasps(o) for o in poses) == taken, name
