"""Planning with physics, and executing in closed loop."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from packenv.config import GridConfig
from packenv.execution.closed_loop import _still_good, run_closed_loop
from packenv.execution.physics_planner import EXACT, INSIDE, PhysicsConstraint, Scratch, make_planner
from packenv.execution.rehearsal import Rehearsal
from packenv.geometry.heightmaps import orient_item
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import assemble
from packenv.planning.constraints import Trial, Verdict
from packenv.planning.options import PlanOptions, StabilityRule
from packenv.planning.packing import Packing
from packenv.planning.search.measured import Resting, measured_map
from packenv.robot.files import default_cell
from packenv.sim.disturbance import Disturbance
from packenv.sim.drop_test import Lying
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.plan_tasks import run_tasks, task_of
from packenv.sim.session import Execution, ExecutionConfig, Session
from packenv.sim.world import WorldConfig
from packenv.types import Container, Pose
from tests.shapes import box
from tests.shelf_samples import FOUR_BOXES, shelf_of
from tests.sim.bodies import convex

GRID = GridConfig(cell_size=0.004, grid_step=0.02, n_poses=2, n_yaws=2)
BOX = Container(0.3, 0.3, 0.2)
CELL = default_cell().with_container(BOX)
NAMES = list(FOUR_BOXES)


@pytest.fixture(scope="module")
def shelf() -> ItemShelf:
    return shelf_of(FOUR_BOXES, GRID)


@pytest.fixture(scope="module")
def physics() -> dict[str, PhysicsItem]:
    return {name: convex(item) for name, item in FOUR_BOXES.items()}


def options_of(**given: Any) -> PlanOptions:
    return PlanOptions(**given, grid=GRID)


def planned(options: PlanOptions, shelf: ItemShelf, physics: dict[str, PhysicsItem]) -> Packing:
    with make_planner(options, shelf, BOX, physics) as planner:
        return planner.pack(NAMES, shelf.prepared, BOX)


def where(packing: Packing) -> list[tuple[str, list[float]]]:
    return [(p.item, p.position.tolist()) for p in packing.placements]


def test_without_physics_it_is_the_planner_that_was_asked_for(
    shelf: ItemShelf, physics: dict[str, PhysicsItem]
) -> None:
    options = options_of(grasp="paper")
    plain = assemble(options, shelf, BOX).pack(NAMES, shelf.prepared, BOX)
    assert where(planned(options, shelf, physics)) == where(plain)
    with pytest.raises(ValueError, match="physics_planner"):
        assemble(replace(options, stability="physics"), shelf, BOX)


def test_a_plan_checked_by_physics_stays_where_it_is_in_physics(
    shelf: ItemShelf, physics: dict[str, PhysicsItem]
) -> None:
    packing = planned(options_of(stability="physics", clearance=0.008), shelf, physics)
    assert packing.complete
    assert all("physics" in p.details for p in packing.placements)
    tasks = [task_of(p, physics[p.item], CELL) for p in packing.placements]
    done = run_tasks(tasks, CELL, ExecutionConfig())
    assert done.success
    assert max(outcome.shift_m for outcome in done.items) < 0.002


def test_the_same_plan_twice(shelf: ItemShelf, physics: dict[str, PhysicsItem]) -> None:
    options = options_of(stability="physics", clearance=0.008)
    assert where(planned(options, shelf, physics)) == where(planned(options, shelf, physics))


def looped(shelf: ItemShelf, physics: dict[str, PhysicsItem], disturbance: Disturbance | None):  # type: ignore[no-untyped-def]
    planner = make_planner(options_of(grasp="paper", clearance=0.012), shelf, BOX, physics)
    packing = planner.pack(NAMES, shelf.prepared, BOX)
    config = ExecutionConfig() if disturbance is None else disturbance.config(ExecutionConfig())
    with Session(CELL, config) as session:
        return packing, run_closed_loop(
            planner,
            packing,
            session,
            shelf.shapes,
            shelf.prepared,
            Rehearsal(CELL, physics, 2),
            disturbance,
        )


def test_closed_loop_keeps_a_plan_that_holds(shelf: ItemShelf, physics: dict[str, PhysicsItem]) -> None:
    packing, result = looped(shelf, physics, None)
    assert result.success
    assert result.plans == 1
    assert [p.item for p in result.placements] == [p.item for p in packing.placements]


def test_what_goes_well_in_rehearsal_is_gone_on_with(
    shelf: ItemShelf, physics: dict[str, PhysicsItem], monkeypatch: pytest.MonkeyPatch
) -> None:
    """However doubtful the next placement looks."""
    monkeypatch.setattr("packenv.execution.closed_loop._still_good", lambda *_: False)
    packing, result = looped(shelf, physics, None)
    assert result.success
    assert result.plans == 1
    assert [p.position.tolist() for p in result.placements] == [
        p.position.tolist() for p in packing.placements
    ]


def test_planning_anew_after_every_item_packs_them_all_too(
    shelf: ItemShelf, physics: dict[str, PhysicsItem], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every plan that is under way fails in rehearsal, every new one does not."""
    asked: list[Rehearsal] = []

    really = Rehearsal.execution

    def execution(rehearsal: Rehearsal, packing: Packing, world: int) -> Execution:
        done = really(rehearsal, packing, world)
        new = bool(asked) and asked[-1] is rehearsal
        asked.append(rehearsal)
        return done if new else replace(done, success=False)

    monkeypatch.setattr("packenv.execution.closed_loop._still_good", lambda *_: False)
    monkeypatch.setattr(Rehearsal, "execution", execution)
    _, result = looped(shelf, physics, None)
    assert result.success
    # A new plan that is the one under way is not carried out again, so more are looked at.
    assert result.plans >= len(NAMES)
    assert sorted(p.item for p in result.placements) == sorted(NAMES)
    assert sorted({len(r.lying) for r in asked}) == [1, 2, 3]


def test_a_rehearsal_goes_on_from_where_things_lie(shelf: ItemShelf, physics: dict[str, PhysicsItem]) -> None:
    """With nothing disturbed, halfway through, it is the rest of the whole execution."""
    packing = planned(options_of(grasp="paper", clearance=0.012), shelf, physics)
    tasks = [task_of(p, physics[p.item], CELL) for p in packing.placements]
    whole = run_tasks(tasks, CELL, ExecutionConfig())
    half = run_tasks(tasks[:2], CELL, ExecutionConfig())
    lying = [Lying(task.item, pose) for task, pose in zip(tasks[:2], half.final, strict=True)]
    rest = run_tasks(tasks[2:], CELL, ExecutionConfig(), lying=lying)
    assert rest.success
    assert [outcome.item for outcome in rest.items] == [task.item.name for task in tasks[2:]]
    assert len(rest.final) == len(whole.final)
    for (_, here), (_, there) in zip(rest.final, whole.final, strict=True):
        assert np.abs(here - there).max() < 1e-3
    # Elsewhere, what lies there is in the way: nothing is where the plan knows of it.
    aside = [Lying(lying[0].item, Pose(tasks[2].rotation, tasks[2].position)), lying[1]]
    assert run_tasks(tasks[2:], CELL, ExecutionConfig(), lying=aside).cause == "collision"


def test_a_placement_is_still_good_until_something_stands_in_its_way(
    shelf: ItemShelf, physics: dict[str, PhysicsItem]
) -> None:
    packing = planned(options_of(grasp="paper", clearance=0.012), shelf, physics)
    first, last = packing.placements[0], packing.placements[-1]
    assert last.corner[2] == 0.0
    believed = packing.surfaces[-2]

    def good(corner: np.ndarray) -> bool:
        """With the first item at a corner on the floor."""
        lying = Resting(FOUR_BOXES[first.item], first.rotation, first.position + corner - first.corner)
        measured = measured_map(BOX, GRID.cell_size, [lying])
        return _still_good(last, FOUR_BOXES[last.item], believed, measured, 0.01)

    assert good(first.corner)
    assert not good(last.corner)


def test_disturbances_depend_on_seed_and_step_alone(
    physics: dict[str, PhysicsItem], shelf: ItemShelf
) -> None:
    packing = planned(options_of(constraints="overlap"), shelf, physics)
    tasks = [task_of(p, physics[p.item], CELL) for p in packing.placements]
    one, other = Disturbance(5), Disturbance(5)
    assert one.config(ExecutionConfig()) == other.config(ExecutionConfig())
    slips = [d.task(tasks[0], 2).slip for d in (one, other)]
    assert slips[0] is not None
    assert np.array_equal(slips[0], slips[1])
    assert not np.array_equal(slips[0], Disturbance(6).task(tasks[0], 2).slip)
    assert not np.array_equal(slips[0], one.task(tasks[0], 3).slip)
    assert 0.5 <= one.config(ExecutionConfig()).world.mu <= 0.9
    factor = one.task(tasks[0], 1).item.mass / tasks[0].item.mass
    assert 0.9 <= factor <= 1.1


def test_what_a_drop_moved_is_in_the_heightmap_where_it_lies_now() -> None:
    items = {item.name: item for item in (box(0.03, 0.03, 0.15, "tower"), box(0.12, 0.10, 0.05, "slab"))}
    bodies = {name: convex(item) for name, item in items.items()}
    scratch = Scratch(BOX, WorldConfig())
    constraint = PhysicsConstraint(bodies, scratch, items, INSIDE, EXACT)
    tower = Resting(items["tower"], np.eye(3), np.array([0.1, 0.1, 0.0]))
    before = measured_map(BOX, GRID.cell_size, [tower])
    slab = orient_item(items["slab"], np.eye(3), cell_size=GRID.cell_size)
    # Half of the slab is above nothing, the other half pushes the tower away.
    verdict = constraint.check(Trial(slab, 28, 20, 0.0), before, constraint.start([tower]))
    scratch.close()
    assert verdict.ok
    lying = verdict.state[0]
    assert np.linalg.norm(lying.pose[1] - tower.position) > 0.005
    now = measured_map(BOX, GRID.cell_size, [Resting(items["tower"], *lying.pose)])
    assert verdict.surface is not None
    assert (verdict.surface.heights >= now.heights).all()


@pytest.mark.parametrize("stability", ["cautious", "physics"])
def test_clearance_costs_no_item(stability: StabilityRule) -> None:
    """Where one of two plates keeps off the walls, there is no room for the other."""
    items = {item.name: item for item in (box(0.198, 0.198, 0.1, "wide"), box(0.098, 0.198, 0.1, "narrow"))}
    flat, physics = Container(0.31, 0.31, 0.15), {name: convex(item) for name, item in items.items()}
    shelf = shelf_of(items, GRID)

    def packed(**given: Any) -> Packing:
        with make_planner(options_of(**given), shelf, flat, physics) as planner:
            return planner.pack(list(items), shelf.prepared, flat)

    assert packed(stability="paper").complete
    if stability == "physics":
        assert not packed(stability=stability, clearance=0.01, restarts=0).complete
    assert packed(stability=stability, clearance=0.01).complete


def test_physics_costs_no_item(shelf: ItemShelf, physics: dict[str, PhysicsItem]) -> None:
    """Where every drop fails, an order is planned as without physics."""

    class Never(PhysicsConstraint):
        def check(self, *_: object) -> Verdict:
            return Verdict(False, "physics-shifts")

    plain = planned(options_of(stability="paper"), shelf, physics)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("packenv.execution.physics_planner.PhysicsConstraint", Never)
        packing = planned(options_of(stability="physics"), shelf, physics)
        alone = planned(options_of(stability="physics", restarts=0), shelf, physics)
    assert packing.complete
    assert where(packing) == where(plain)
    assert {p.details["physics"]["rule"] for p in packing.placements} == {"no-drop"}  # type: ignore[index]
    assert not alone.placements
