"""Plans that are carried out in simulation before they are given out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from packenv.execution.physics_planner import make_planner, make_spares
from packenv.execution.rehearsal import ALTERNATIVES, Rehearsal, Rehearsed, pack_rehearsed
from packenv.items.shelf import ItemShelf
from packenv.planning.packing import Packing
from packenv.planning.planner import Planner
from packenv.robot.files import default_cell
from packenv.sim.descent import PlacementTask
from packenv.sim.drop_test import Lying
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.plan_tasks import run_tasks
from packenv.sim.session import Execution, ExecutionConfig
from packenv.types import Leftover
from tests.execution.test_physics_planner import BOX, CELL, GRID, NAMES, options_of, where
from tests.shapes import box
from tests.shelf_samples import FOUR_BOXES, shelf_of
from tests.sim.bodies import BOX as HAND_BOX, brick, by_hand, convex, slipped

pytestmark = pytest.mark.usefixtures("auto")

PLANK, POLE = box(0.25, 0.06, 0.02, "plank"), box(0.04, 0.04, 0.15, "pole")
ALL = {**FOUR_BOXES, "plank": PLANK, "pole": POLE}


@pytest.fixture(scope="module")
def shelf() -> ItemShelf:
    return shelf_of(ALL, GRID)


@pytest.fixture(scope="module")
def physics() -> dict[str, PhysicsItem]:
    return {name: convex(item) for name, item in ALL.items()}


def rehearsed(
    planner: Planner, shelf: ItemShelf, physics: dict[str, PhysicsItem], worlds: int = 2, **more: Packing
) -> Rehearsed:
    return pack_rehearsed(planner, NAMES, shelf.prepared, Rehearsal(CELL, physics, worlds), **more)


@pytest.fixture(scope="module")
def planner(shelf: ItemShelf, physics: dict[str, PhysicsItem]) -> Planner:
    return make_planner(options_of(stability="physics", clearance=0.008), shelf, BOX, physics)


def test_a_plan_that_survives_is_the_planner_s_own(
    planner: Planner, shelf: ItemShelf, physics: dict[str, PhysicsItem]
) -> None:
    own = planner.pack(NAMES, shelf.prepared, BOX)
    done = rehearsed(planner, shelf, physics)
    assert (done.survived, done.worlds, done.plans, done.how) == (2, 2, 1, "hm")
    assert where(done.packing) == where(own)
    known = rehearsed(planner, shelf, physics, first=own)
    assert known.packing is own
    assert known.how == "first"


def test_a_plan_that_fails_gives_way_to_one_that_does_not(
    shelf: ItemShelf, physics: dict[str, PhysicsItem]
) -> None:
    """Nothing but overlap is asked for: of DBLF's plan (the paper's c) an item falls and sticks out, HM's stands."""
    names = ["brick", "brick", "plank", "plank", "block", "plank", "pole"]
    loose = make_planner(
        options_of(heuristic="dblf", tie_break=1.0, constraints="overlap"), shelf, BOX, physics
    )
    stage = Rehearsal(CELL, physics, 1)
    assert not stage.execution(loose.pack(names, shelf.prepared, BOX), 0).success
    done = pack_rehearsed(loose, names, shelf.prepared, stage)
    assert done.survived == 1
    assert done.plans > 1
    assert stage.execution(done.packing, 0).success
    assert done.chosen.made_by == done.how in ("dblf late", "minz", "hm")


def test_all_alternatives_are_tried_before_it_gives_in(
    planner: Planner, shelf: ItemShelf, physics: dict[str, PhysicsItem], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of plans that all fail, the first of those that survive in most worlds is kept."""
    seen: list[Packing] = []
    last = ["slab", "brick", "cube", "cube", "brick", "brick"]

    def execution(_: Rehearsal, packing: Packing, world: int) -> Execution:
        if not any(packing is known for known in seen):
            seen.append(packing)
        number = [packing is known for known in seen].index(True)
        success = world == 0 or (world == 1 and number in (2, 4))
        return Execution(success, None, last[number], (), (), 0.0)

    monkeypatch.setattr(Rehearsal, "execution", execution)
    monkeypatch.setattr(Rehearsal, "blamed_items", lambda _, execution: frozenset({execution.detail}))
    done = rehearsed(planner, shelf, physics, worlds=3)
    # Its own, one by each other heuristic, and two with what went wrong at the end.
    assert (done.plans, done.worlds, done.survived) == (len(ALTERNATIVES) + 2, 3, 2)
    assert done.packing is seen[2]
    _, second, *_, last_but_one, _ = ([p.item for p in packing.placements] for packing in seen)
    assert second[-1] == "slab"
    assert set(last_but_one[-3:]) == {"slab", "brick", "cube"}


def test_what_is_under_way_is_given_up_for_what_does_as_well(
    planner: Planner, shelf: ItemShelf, physics: dict[str, PhysicsItem], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Rehearsal, "execution", lambda *_: Execution(False, None, "", (), (), 0.0))
    running = planner.pack(NAMES, shelf.prepared, BOX)
    first = planner.pack(NAMES, shelf.prepared, BOX)
    assert rehearsed(planner, shelf, physics, running=running, first=first).packing is first


def test_spares_are_asked_when_the_planner_s_own_plan_fails(
    planner: Planner, shelf: ItemShelf, physics: dict[str, PhysicsItem], monkeypatch: pytest.MonkeyPatch
) -> None:
    (spare,) = make_spares(options_of(stability="physics"), shelf, BOX)
    other = spare.pack(NAMES, shelf.prepared, BOX)
    assert where(other) != where(planner.pack(NAMES, shelf.prepared, BOX))

    def execution(_: Rehearsal, packing: Packing, world: int) -> Execution:
        return Execution(where(packing) == where(other), None, "", (), (), 0.0)

    monkeypatch.setattr(Rehearsal, "execution", execution)
    stage = Rehearsal(CELL, physics, 2)
    done = pack_rehearsed(planner, NAMES, shelf.prepared, stage, spares=[spare])
    assert where(done.packing) == where(other)
    assert (done.survived, done.plans, done.how) == (2, 2, "spare 1 hm")
    assert make_spares(options_of(stability="paper"), shelf, BOX) == ()
    (roomy,) = make_spares(options_of(stability="cautious"), shelf, BOX)
    assert roomy.strategy.roomy is not None


def test_the_last_spare_asks_for_no_clearance(shelf: ItemShelf) -> None:
    """What fits only without would else be packed by the last resort, which is as bold as the paper."""
    for clearance, widths in ((0.0, [0]), (0.01, [3, 0])):
        spares = make_spares(options_of(stability="physics", clearance=clearance), shelf, BOX)
        assert [(spare.strategy.roomy or spare.strategy).clearance for spare in spares] == widths


def test_who_waits_is_spared_the_planner_s_other_heuristics(
    planner: Planner, shelf: ItemShelf, physics: dict[str, PhysicsItem], monkeypatch: pytest.MonkeyPatch
) -> None:
    (spare,) = make_spares(options_of(stability="physics"), shelf, BOX)
    running = planner.pack(NAMES, shelf.prepared, BOX)
    asked: list[Planner] = []
    really = Planner.pack

    def pack(self: Planner, *arguments: Any) -> Packing:
        asked.append(self)
        return really(self, *arguments)

    monkeypatch.setattr(Planner, "pack", pack)
    monkeypatch.setattr(Rehearsal, "execution", lambda *_: Execution(False, None, "", (), (), 0.0))
    stage = Rehearsal(CELL, physics, 1)
    for known, own in ({"running": running}, 1), ({"first": running}, len(ALTERNATIVES) - 1):
        asked.clear()
        pack_rehearsed(planner, NAMES, shelf.prepared, stage, spares=[spare], **known)
        assert sum(p.constraints is planner.constraints for p in asked) == own
        assert len(asked) - own == len(ALTERNATIVES)


def test_what_can_never_fit_is_not_planned_again(
    planner: Planner, shelf: ItemShelf, physics: dict[str, PhysicsItem]
) -> None:
    own = planner.pack(NAMES, shelf.prepared, BOX)
    for reason, again in (("larger-than-container", False), ("no-legal-candidate", True)):
        partial = replace(own, leftovers=(Leftover("slab", 2, reason, ""),))
        assert (rehearsed(planner, shelf, physics, worlds=1, first=partial).plans > 1) == again


def test_who_is_to_blame() -> None:
    """The one that collides; what it meets away from its place; what sticks out; what pushed that."""
    bricks = {name: brick(name=name) for name in ("first", "second")}
    stage = Rehearsal(default_cell().with_container(HAND_BOX), bricks, 1)

    def failed(*tasks: PlacementTask, lying: tuple[Lying, ...] = ()) -> Execution:
        execution = run_tasks(tasks, default_cell().with_container(HAND_BOX), ExecutionConfig(), None, lying)
        assert not execution.success
        return execution

    first = by_hand(bricks["first"], (0.1, 0.1, 0.0))
    assert stage.blamed_items(failed(first, by_hand(bricks["second"], (0.15, 0.1, 0.0)))) == {"second"}
    away = by_hand(bricks["first"], (0.02, 0.1, 0.0), slipped(0.03, 0.0))
    assert stage.blamed_items(failed(away, by_hand(bricks["second"], (0.13, 0.1, 0.0)))) == {"first"}
    high = brick(0.1, 0.1, 0.33, "first")
    execution = failed(by_hand(high, (0.1, 0.1, 0.0)))
    assert replace(stage, physics={"first": high}).blamed_items(execution) == {"first"}
    lying = (Lying(high, execution.final[0]),)
    beside = failed(by_hand(bricks["second"], (0.0, 0.0, 0.0)), lying=lying)
    known = replace(stage, lying=lying)
    assert known.blamed_items(beside) == set()
    pushed = replace(beside, items=(replace(beside.items[0], moved=(0,)),))
    assert known.blamed_items(pushed) == {"second"}


def test_an_incomplete_plan_gives_way_to_a_fuller_one(
    planner: Planner, shelf: ItemShelf, physics: dict[str, PhysicsItem]
) -> None:
    own = planner.pack(NAMES, shelf.prepared, BOX)
    lost = tuple(Leftover(p.item, p.instance, "no-legal-candidate", "") for p in own.placements[2:])
    half = Packing(BOX, own.placements[:2], lost, own.surfaces[:2], 0.0)
    done = rehearsed(planner, shelf, physics, worlds=1, first=half)
    assert done.plans > 1
    assert done.packing.complete
