"""A cautious plan with clearance: what fits with room to spare has it, what does not loses nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from packenv.config import GridConfig
from packenv.execution.planning_job import PlanningJob
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import assemble
from packenv.planning.options import PlanOptions
from packenv.planning.packing import Packing
from packenv.planning.planner import Planner
from packenv.planning.search.heuristics import heuristic_named
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.margins import MarginRule
from packenv.planning.tiers import Strategy, Tier
from packenv.types import Container
from tests.planning.stability import piles
from tests.shapes import ball, box
from tests.shelf_samples import shelf_of

GRID = GridConfig(cell_size=0.003, grid_step=0.015, n_poses=3, n_yaws=2)
BOX = Container(0.24, 0.24, 0.15)
ROOM = 0.006
MESHES = {
    item.name: item
    for item in (
        box(0.08, 0.06, 0.04, "brick"),
        box(0.10, 0.08, 0.02, "book"),
        box(0.05, 0.05, 0.01, "tile"),
        box(0.114, 0.117, 0.06, "quarter"),
        ball(0.025, subdivisions=3),
        ball(0.02, subdivisions=3, name="marble"),
    )
}


@pytest.fixture(scope="module")
def shelf() -> ItemShelf:
    return shelf_of(MESHES, GRID)


def packed(shelf: ItemShelf, names: Sequence[str], container: Container = BOX, **words: Any) -> Packing:
    job = PlanningJob(shelf, PlanOptions(grid=GRID, **words))
    job.load(names)
    return job.pack(container, job.sequence(names))


def places(packing: Packing) -> list[tuple[str, bytes, bytes]]:
    return [(p.item, p.rotation.tobytes(), p.position.tobytes()) for p in packing.placements]


@pytest.mark.parametrize("heuristic", ["auto", "hm", "dblf"])
def test_what_fits_with_clearance_has_it(heuristic: str, shelf: ItemShelf) -> None:
    """From the walls and from each other, wherever items stand side by side."""
    packing = packed(shelf, ["brick", "book", "tile", "brick"], heuristic=heuristic, clearance=ROOM)
    assert packing.complete
    assert {p.details["clearance_m"] for p in packing.placements} == {ROOM}
    for k, p in enumerate(packing.placements):
        low, high = p.corner[:2], p.corner[:2] + p.extents[:2]
        assert low.min() >= ROOM - 1e-9
        assert (np.array(BOX.size[:2]) - high).min() >= ROOM - 1e-9
        for q in packing.placements[:k]:
            if (
                q.corner[2] + q.extents[2] <= p.corner[2] + 0.01
            ):  # where it lies on it, or is released above it
                continue
            gaps = np.maximum(q.corner[:2] - high, low - (q.corner + q.extents)[:2])
            assert gaps.max() >= ROOM - 1e-9


@pytest.mark.parametrize("heuristic", ["auto", "hm"])
def test_what_does_not_fit_with_clearance_is_planned_as_without(heuristic: str, shelf: ItemShelf) -> None:
    """Four of them fill the floor to 6 mm, and the box is too low for two layers."""
    low, names = Container(0.234, 0.234, 0.065), ["quarter"] * 4
    without = packed(shelf, names, low, heuristic=heuristic, clearance=0.0)
    packing = packed(shelf, names, low, heuristic=heuristic, clearance=ROOM)
    assert packing.complete
    assert places(packing) == places(without)
    assert all("clearance_m" not in p.details for p in packing.placements)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([1.0, 0.6]))
def test_clearance_costs_no_item(seed: int, size: float) -> None:
    shelf = shelf_of(MESHES, GRID)
    rng = np.random.default_rng(seed)
    names = [str(name) for name in rng.choice(sorted(MESHES), rng.integers(3, 8))]
    small = Container(0.24 * size, 0.24 * size, 0.10)
    counts = [len(packed(shelf, names, small, clearance=c).placements) for c in (ROOM, 0.012, 0.0)]
    assert min(counts) == counts[-1]


def test_a_full_box_is_not_tried_with_room(shelf: ItemShelf, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the items' boxes take more than a share of it; without clearance no planner knows of room at all."""
    planner = assemble(PlanOptions("hm", grid=GRID, constraints="stability", clearance=ROOM), shelf, BOX)
    names = ["brick", "book", "brick"]
    taken = sum(shelf.prepared[name].box_volume for name in names) / BOX.volume
    for share in (0.9 * taken, 1.1 * taken):
        monkeypatch.setattr("packenv.planning.packing_pass._SPACIOUS", share)
        found = planner.with_room(names, shelf.prepared, BOX)
        assert (found is None) == (share < taken)
    assert planner.without_room.with_room(names, shelf.prepared, BOX) is None
    bare = assemble(PlanOptions("hm", grid=GRID, constraints="stability"), shelf, BOX)
    assert bare.with_room(names, shelf.prepared, BOX) is None


def test_what_may_not_stay_comes_last(shelf: ItemShelf) -> None:
    """Balls have no margin: nothing that has one comes after them."""
    names = ["ball", "marble", "brick", "book", "tile"]
    planner = assemble(PlanOptions("hm", grid=GRID, constraints="stability", clearance=ROOM), shelf, BOX)
    assert planner.strategy.roomy is not None
    packing = replace(planner, strategy=planner.strategy.roomy).pack(names, shelf.prepared, BOX)
    assert packing.complete
    assert packing.risk > 0.0
    assert {p.item for p in packing.placements[-2:]} == {"ball", "marble"}
    assert all(p.route == "first-pass" for p in packing.placements[:-2])


@pytest.mark.parametrize("heuristic", ["hm", "dblf", "first-fit"])
def test_what_may_not_stay_is_kept_aside_from_its_like(heuristic: str, shelf: ItemShelf) -> None:
    """Without constraints, in a box of two layers: from all others by so much, and nothing lies on anything."""
    away = 0.03
    strategy = Strategy((Tier(shaky=True, apart=away),))
    planner = Planner(heuristic_named(heuristic), GRID, strategy=strategy)
    packing = planner.pack(["tile"] * 20, shelf.prepared, BOX)
    assert 4 <= len(packing.placements) < 20
    for k, p in enumerate(packing.placements):
        for q in packing.placements[:k]:
            gaps = np.maximum(p.corner - q.corner - q.extents, q.corner - p.corner - p.extents)[:2]
            assert gaps.max() >= away - 1e-9
    free = Planner(heuristic_named(heuristic), GRID).pack(["tile"] * 20, shelf.prepared, BOX)
    assert len(free.placements) == 20


@pytest.mark.parametrize("tilt", [0.0, 8.0])
@pytest.mark.parametrize("height", [0.02, 0.06])
def test_the_margin_counts_how_far_an_item_is_off(height: float, tilt: float) -> None:
    """A block tips over its edge where the way to it is shorter than the offset and what the tilt adds."""
    half = 0.02
    corners = [[x, y, 0.0] for x in (-half, half) for y in (-half, half)]
    p = piles.pile(corners, [[0, 0, 1.0]] * 4, [0] * 4, [1] * 4, [1.0], [[0.0, 0.0, height / 2.0]])
    limit = half - height / 2.0 * math.tan(math.radians(tilt))
    for aside, stands in ((0.0, True), (limit - 1e-4, True), (limit + 1e-4, False)):
        rule = MarginRule(max(tilt, 1e-6), 0.25, aside)
        solutions = rule.alone(StabilityChecker(), *p.args)
        assert all(found.status == "stable" for found in solutions) == stands


def test_an_offset_of_a_margin_is_a_length() -> None:
    for wrong in (-0.001, math.nan, math.inf):
        with pytest.raises(ValueError, match="offset"):
            MarginRule(aside=wrong)
