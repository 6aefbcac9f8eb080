"""Plans that are carried out in simulation before they are given out."""

from __future__ import annotations

from dataclasses import replace

import pytest

from packenv.physics_planning import make_planner
from packenv.planning.assembly import PlannerChoice, Shelf
from packenv.planning.packer import Planner
from packenv.planning.packing import Packing
from packenv.planning.scores import HEURISTICS
from packenv.rehearsal import ALTERNATIVES, LATER, Rehearsal, Rehearsed, pack_rehearsed
from packenv.sim.physics_items import PhysicsItem
from packenv.types import Leftover
from tests.shapes import box
from tests.sim.bodies import URDF, convex
from tests.test_physics_planning import BOX, GRID, ITEMS, NAMES, shelf_of, where

PLANK, POLE = box(0.25, 0.06, 0.02, "plank"), box(0.04, 0.04, 0.15, "pole")
ALL = {**ITEMS, "plank": PLANK, "pole": POLE}


@pytest.fixture(scope="module")
def shelf() -> Shelf:
    return shelf_of(ALL)


@pytest.fixture(scope="module")
def physics() -> dict[str, PhysicsItem]:
    return {name: convex(item) for name, item in ALL.items()}


def rehearsed(
    planner: Planner, shelf: Shelf, physics: dict[str, PhysicsItem], worlds: int = 2, **more: Packing
) -> Rehearsed:
    return pack_rehearsed(planner, NAMES, shelf.prepared, Rehearsal(BOX, physics, URDF, worlds), **more)


@pytest.fixture(scope="module")
def planner(shelf: Shelf, physics: dict[str, PhysicsItem]) -> Planner:
    return make_planner(PlannerChoice(stability="physics", clearance=0.008), shelf, BOX, GRID, physics)


def test_a_plan_that_survives_is_the_planner_s_own(
    planner: Planner, shelf: Shelf, physics: dict[str, PhysicsItem]
) -> None:
    own = planner.pack(NAMES, shelf.prepared, BOX)
    done = rehearsed(planner, shelf, physics)
    assert (done.survived, done.worlds, done.plans) == (2, 2, 1)
    assert where(done.packing) == where(own)
    known = rehearsed(planner, shelf, physics, first=own)
    assert known.packing is own


def test_a_plan_that_fails_gives_way_to_one_that_does_not(
    shelf: Shelf, physics: dict[str, PhysicsItem]
) -> None:
    """Nothing but overlap is asked for: what DBLF leaves hanging over an edge falls, HM's plan stands."""
    names = ["slab", "pole", "plank", "pole", "brick", "plank"]
    loose = make_planner(PlannerChoice("dblf", constraints="overlap"), shelf, BOX, GRID, physics)
    stage = Rehearsal(BOX, physics, URDF, 1)
    assert not stage.execution(loose.pack(names, shelf.prepared, BOX), 0).success
    done = pack_rehearsed(loose, names, shelf.prepared, stage)
    assert (done.plans, done.survived) == (2, 1)
    assert stage.execution(done.packing, 0).success
    other = replace(loose, heuristic=HEURISTICS["hm"]).pack(names, shelf.prepared, BOX)
    assert where(done.packing) == where(other)


def test_all_alternatives_are_tried_before_it_gives_in(
    planner: Planner, shelf: Shelf, physics: dict[str, PhysicsItem], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of plans that all fail, the first of those that survive in most worlds is kept."""
    seen: list[Packing] = []

    def survived(_: Rehearsal, packing: Packing) -> tuple[int, frozenset[str]]:
        seen.append(packing)
        return int(len(seen) in (2, 3)), frozenset({"slab"} if len(seen) == 2 else {"brick"})

    monkeypatch.setattr(Rehearsal, "survived", survived)
    done = rehearsed(planner, shelf, physics, worlds=3)
    assert (done.plans, done.worlds, done.survived) == (len(ALTERNATIVES) + LATER, 3, 1)
    assert done.packing is seen[1]
    # What went wrong in the best of them, and in the last of them, comes last.
    *_, fourth, fifth = ([p.item for p in packing.placements] for packing in seen)
    assert fourth == ["brick", "block", "cube", "slab"]
    assert fifth == ["block", "cube", "slab", "brick"]


def test_an_incomplete_plan_gives_way_to_a_fuller_one(
    planner: Planner, shelf: Shelf, physics: dict[str, PhysicsItem]
) -> None:
    own = planner.pack(NAMES, shelf.prepared, BOX)
    lost = tuple(Leftover(p.item, p.instance, "no-legal-candidate", "") for p in own.placements[2:])
    half = Packing(BOX, own.placements[:2], lost, own.surfaces[:2], 0.0)
    done = rehearsed(planner, shelf, physics, worlds=1, first=half)
    assert done.plans > 1
    assert done.packing.complete
