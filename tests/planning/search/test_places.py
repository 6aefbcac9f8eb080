"""Exact places: what lies flush begins within a cell, and meshes, not maps, tell it from what it lies against."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from packenv.config import CLEARANCE
from packenv.geometry.heightmaps import at_phase, orient_item
from packenv.geometry.transforms import yaw_rotation
from packenv.planning.search.candidates import Candidates, grid_search
from packenv.planning.search.contact_height import ExactPile
from packenv.planning.search.container_map import ContainerMap, PolyphaseMap
from packenv.planning.search.heuristics import HEURISTICS, Heuristic
from packenv.planning.search.places import ExactPlaces, PlaceList, listed
from packenv.types import Container, FloatArray, Item, OrientedItem, Placement, Plan
from packenv.verification.exact_meshes import audit_plan
from tests.shapes import ball, box, cup, cylinder

CELL = 0.002
STEP = 5
SHAPES: dict[str, Item] = {
    "box": box(0.0413, 0.0327, 0.0251),
    "cup": cup(0.03, 0.05),
    "ball": ball(0.021),
    "can": cylinder(0.023, 0.04),
}
"""None of them a whole number of cells wide."""
TIGHT = Container(0.1171, 0.1045, 0.11)
"""Neither is this."""
RANKING = ["hm", "dblf", "mta", "minz"]


def turned(name: str, rng: np.random.Generator) -> OrientedItem:
    return orient_item(SHAPES[name], yaw_rotation(float(rng.uniform(0, np.pi))), cell_size=CELL)


def exact(
    surface: ContainerMap, orientations: Sequence[OrientedItem], heuristic: Heuristic, most: int = 1
) -> tuple[Candidates, FloatArray, FloatArray]:
    """Candidates with their scores, and the scores of the grid alone."""
    rng = np.random.default_rng(0)
    grid = grid_search(surface, orientations, STEP)
    scores = heuristic(grid, rng) if len(grid) else np.empty(0)
    return *ExactPlaces(heuristic, rng).add(grid, scores, surface, orientations, STEP, most), scores


def heap(seed: int, heuristic: Heuristic, most: int = 1) -> tuple[ContainerMap, list[Placement]]:
    """Items put one after another where the heuristic wants them."""
    rng = np.random.default_rng(seed)
    surface, placements = ContainerMap.empty(TIGHT, CELL, ExactPile(SHAPES)), []
    for k in range(9):
        name = str(rng.choice(list(SHAPES)))
        found, scores, before = exact(surface, [turned(name, rng), turned(name, rng)], heuristic, most)
        if not len(found):
            continue
        assert scores.min() <= before.min(initial=np.inf) + 1e-6
        trial = found.trial(int(np.argmin(scores)))
        o = trial.oriented
        placements.append(
            Placement(name, k + 1, o.rotation, trial.position, trial.corner, o.extents, 0, 0.0, 0.0, 1)
        )
        surface = surface.with_item(o, trial.ix, trial.iy, trial.z)
    return surface, placements


@pytest.mark.parametrize("name", SHAPES)
def test_maps_at_a_phase_bound_the_moved_mesh(name: str) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        oriented = turned(name, rng)
        phase = (float(rng.uniform(0, CELL)), float(rng.choice([0.0, rng.uniform(0, CELL)])))
        moved = at_phase(oriented, phase)
        points = SHAPES[name].vertices @ oriented.rotation.T + oriented.offset
        last = np.array(moved.top.shape) - 1
        cells = np.minimum(np.floor((points[:, :2] + phase) / CELL).astype(int), last)
        assert (moved.top[cells[:, 0], cells[:, 1]] >= points[:, 2] - 1e-9).all()
        assert (moved.bottom[cells[:, 0], cells[:, 1]] <= points[:, 2] + 1e-9).all()
        assert moved.whole is oriented
        wide = [np.ceil((e + p - 1e-6) / CELL) for e, p in zip(oriented.extents, phase, strict=False)]
        assert moved.top.shape == tuple(wide)


@pytest.mark.parametrize("heuristic", RANKING)
@pytest.mark.parametrize("most", [1, 100])
def test_heaps_of_exact_places_pass_the_audit_and_none_has_room_below(heuristic: str, most: int) -> None:
    for seed in range(4):
        _, placements = heap(seed, HEURISTICS[heuristic], most)
        assert len(placements) > 3
        plan = Plan(TIGHT, tuple(placements), ())
        assert audit_plan(plan, SHAPES).ok
        last = placements[-1]
        if last.corner[2] > 2e-4:
            down = np.array([0.0, 0.0, 2e-4])
            sunk = Placement(
                last.item,
                last.instance,
                last.rotation,
                last.position - down,
                last.corner - down,
                last.extents,
                0,
                0.0,
                0.0,
                1,
            )
            assert not audit_plan(Plan(TIGHT, (*placements[:-1], sunk), ()), SHAPES).ok


def test_every_place_off_the_grid_is_flush_or_centred() -> None:
    rng = np.random.default_rng(1)
    surface, _ = heap(1, HEURISTICS["hm"])
    assert surface.exact is not None
    sides = surface.exact.sides
    found, _, _ = exact(surface, [turned("can", rng), turned("ball", rng)], HEURISTICS["minz"], 100)
    off = np.abs(found.places / CELL - np.rint(found.places / CELL)).max(axis=1) > 1e-3
    assert off.any()
    for place, extents in zip(found.places[off], found.extents[off], strict=True):
        for axis in (0, 1):
            wide = extents[axis]
            stops = [0.0, TIGHT.size[axis] - wide, *sides[:, 2 + axis], *(sides[:, axis] - wide)]
            centred = (sides[:, axis] + sides[:, 2 + axis] - wide) / 2
            assert np.abs(np.array([*stops, *centred]) - place[axis]).min() < 1e-9
            assert place[axis] + wide < TIGHT.size[axis] + CLEARANCE


def test_at_places_of_the_grid_a_list_scores_as_the_grid_does() -> None:
    rng = np.random.default_rng(2)
    surface, _ = heap(2, HEURISTICS["dblf"])
    orientations = [turned(name, rng) for name in SHAPES for _ in range(2)]
    grid = grid_search(surface, orientations, 1)
    assert len(grid) > 50
    polyphase = PolyphaseMap(surface, 1)
    lists = []
    for k in np.unique(grid.grid_index):
        own = grid.grid_index == k
        lists.append(PlaceList(grid.grids[k].oriented, polyphase, grid.places[own], grid.corners[own, 2]))
    same = listed(lists, "any", CELL)
    for name in RANKING:
        by_grid, by_list = (HEURISTICS[name](c, rng) for c in (grid, same))
        np.testing.assert_allclose(by_list, by_grid, rtol=0, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("most", [1, 100])
def test_no_candidate_comes_twice(most: int) -> None:
    rng = np.random.default_rng(3)
    surface, _ = heap(3, HEURISTICS["hm"])
    found, scores, _ = exact(surface, [turned("box", rng), turned("can", rng)], HEURISTICS["hm"], most)
    assert len(found) == len(scores)
    if most > 1:
        keys = [
            (found.grids[g].oriented.rotation.tobytes(), *np.rint(place * 1e6))
            for g, place in zip(found.grid_index, found.places, strict=True)
        ]
        assert len(set(keys)) == len(keys)


def test_what_the_maps_would_leave_standing_out_fits_where_meshes_nest() -> None:
    first = orient_item(SHAPES["cup"], np.eye(3), cell_size=CELL)
    # Inside, 21 mm at 3 mm of height and 27 at 50: the outside of the foot, 24 mm, stops half way, at 26.5.
    for height, fits in ((0.0766, True), (0.0764, False)):
        container = Container(0.0605, 0.0605, height)
        surface = ContainerMap.empty(container, CELL, ExactPile(SHAPES)).with_item(first, 0, 0, 0.0)
        assert not len(grid_search(surface, [first], 1))
        found, _, _ = exact(surface, [first], HEURISTICS["hm"])
        assert bool(len(found)) == fits


def test_only_what_is_as_large_as_the_container_reaches_over_its_wall() -> None:
    """A grid of 2 mm cells has a place at which a box of 58.04 mm is 20 µm over the wall: the audit's limit."""
    container = Container(0.10002, 0.10002, 0.1)
    surface = ContainerMap.empty(container, CELL, ExactPile(SHAPES))
    for wide in (0.058, 0.05804, 0.098, 0.10003):
        oriented = orient_item(box(wide, wide, 0.02), np.eye(3), cell_size=CELL)
        for heuristic in RANKING:
            found, _, _ = exact(surface, [oriented], HEURISTICS[heuristic], 100)
            assert len(found)
            beyond = (found.places + wide).max() - container.length
            assert beyond <= max(wide - container.length, 0.0) + 1e-9
