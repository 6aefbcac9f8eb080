"""The law that everything stands on: grid-aligned placements at the lowest Z never overlap.

Heightmaps sampled at cell centres fail this on most placements; conservative ones must never.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.reference import ray_cast_maps
from packenv.config import GridConfig
from packenv.geometry.heightmaps import orient_item
from packenv.geometry.prepare import PreparedItem, prepare_item
from packenv.geometry.transforms import yaw_rotation
from packenv.items.catalogue import open_catalogue
from packenv.planning.planner import Planner
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import HEURISTICS
from packenv.types import Container, Item, OrientedItem, Placement, Plan
from packenv.verification.exact_meshes import audit_plan

GRID = GridConfig()
BOX = Container(0.32, 0.32, 0.30)


def _place_anywhere(
    meshes: list[Item], rng: np.random.Generator, orient: Callable[..., OrientedItem] = orient_item
) -> Plan:
    """Items at random orientations (not only stable ones) and random whole cells, each at its lowest Z."""
    surface = ContainerMap.empty(BOX, GRID.cell_size)
    placements = []
    for k in rng.permutation(len(meshes)):
        item = meshes[k]
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        rotation = yaw_rotation(rng.uniform(0, 6.28)) @ (turn * np.sign(np.linalg.det(turn)))
        oriented = orient(item, rotation, cell_size=GRID.cell_size)
        room = [n - m for n, m in zip(surface.heights.shape, oriented.top.shape, strict=True)]
        if min(room) < 0:
            continue
        ix, iy = (int(rng.integers(0, r + 1)) for r in room)
        w, h = oriented.top.shape
        gap = surface.heights[ix : ix + w, iy : iy + h] - oriented.bottom
        z = float(gap[oriented.footprint].max())
        if z + oriented.extents[2] > BOX.height:
            continue
        corner = np.array([ix * GRID.cell_size, iy * GRID.cell_size, z])
        placements.append(
            Placement(
                item.name, 1, rotation, oriented.offset + corner, corner, oriented.extents, 0, 0.0, 0.0, 1
            )
        )
        surface = surface.with_item(oriented, ix, iy, z)
    return Plan(BOX, tuple(placements), ())


def _check_random_placements(meshes: list[Item], rounds: int, seed: int) -> int:
    placed = 0
    for k in range(rounds):
        rng = np.random.default_rng([seed, k])
        some = [meshes[i] for i in rng.choice(len(meshes), min(12, len(meshes)), replace=False)]
        plan = _place_anywhere(some, rng)
        report = audit_plan(plan, {item.name: item for item in some})
        assert report.ok, (k, report)
        placed += len(plan.placements)
    return placed


@pytest.fixture(scope="module")
def own() -> list[Item]:
    catalogue = open_catalogue("builtin")
    return [catalogue.item(name) for name in catalogue.names]


def test_our_own_items_never_overlap(own: list[Item]) -> None:
    assert _check_random_placements(own, 25, seed=1) > 100


@pytest.mark.objects
def test_scanned_items_never_overlap(objects_dir: Path) -> None:
    catalogue = open_catalogue(objects_dir)
    meshes = [catalogue.item(name) for name in catalogue.names]
    assert _check_random_placements(meshes, 15, seed=2) > 60


@pytest.mark.slow
@pytest.mark.objects
def test_thousands_of_placements_never_overlap(objects_dir: Path, own: list[Item]) -> None:
    catalogue = open_catalogue(objects_dir)
    meshes = [catalogue.item(name) for name in catalogue.names]
    assert _check_random_placements(meshes + own, 500, seed=3) > 3000


@pytest.fixture(scope="module")
def prepared(own: list[Item]) -> dict[str, PreparedItem]:
    return {item.name: prepare_item(item, GRID) for item in own[::5]}


@pytest.mark.parametrize("heuristic", sorted(HEURISTICS))
def test_plans_of_every_heuristic_pass_the_audit(
    heuristic: str, own: list[Item], prepared: dict[str, PreparedItem]
) -> None:
    rng = np.random.default_rng(7)
    order = [str(name) for name in rng.choice(sorted(prepared), 12)]
    packing = Planner(HEURISTICS[heuristic], GRID, seed=1).pack(order, prepared, BOX)
    assert len(packing.placements) > 6
    report = audit_plan(Plan(BOX, packing.placements, ()), {item.name: item for item in own})
    assert report.ok, report


def _sampled(item: Item, rotation: np.ndarray, *, cell_size: float) -> OrientedItem:
    """The paper's maps: one ray through each cell centre."""
    top, bottom = ray_cast_maps(item, rotation, cell_size)
    exact = orient_item(item, rotation, cell_size=cell_size)
    return dataclasses.replace(exact, top=top.astype(np.float32), bottom=bottom.astype(np.float32))


def test_maps_sampled_at_cell_centres_do_overlap(own: list[Item]) -> None:
    """The audit can fail, and why the maps are built as they are: one ray a cell is not enough."""
    by_name = {item.name: item for item in own}
    reports = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        some = [own[i] for i in rng.choice(len(own), 12, replace=False)]
        reports.append(audit_plan(_place_anywhere(some, rng, _sampled), by_name))
    assert sum(len(report.overlaps) for report in reports) > 8
    assert sum(report.ok for report in reports) <= 2
