"""The search after the first plan: never worse, the same for the same number of plans, and stopped at any time."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import packenv as rp
from packenv.config import GridConfig
from packenv.io.plans import plan_to_json
from packenv.planning.anytime import Anytime, Budget
from packenv.planning.assembly import assemble, packer
from packenv.planning.chain_workers import Processes
from packenv.planning.deadline import Deadline
from packenv.planning.options import Goal, PlanOptions
from packenv.planning.packing import Packing
from packenv.planning.planner import by_box_volume
from packenv.planning.portfolio import Portfolio, least_margin
from packenv.planning.sequence import Piece
from packenv.planning.trails import SEVERAL, Trail, Trails, Turn, single_passes
from packenv.types import Container
from packenv.watcher import Watcher
from tests.shapes import box, cup
from tests.shelf_samples import shelf_of

GRID = GridConfig(cell_size=0.004, grid_step=0.02, n_poses=2, n_yaws=2)
BOX = Container(0.16, 0.14, 0.12)
_SIZES = np.random.default_rng(3).integers(3, 9, (14, 3)) * 0.01
ITEMS = {f"b{k:02}": box(*size, f"b{k:02}") for k, size in enumerate(_SIZES.tolist())} | {
    "cup": cup(0.04, 0.08)
}
NAMES = sorted(ITEMS)
"""More than the box takes."""
WORDS: dict[str, Any] = {"grid": GRID, "restarts": 0, "method": "search"}


def trails_of(options: PlanOptions) -> tuple[Trails, list[str]]:
    shelf = shelf_of(ITEMS, GRID)
    search = packer(options, assemble(options, shelf, BOX), shelf.shapes)
    assert isinstance(search, Anytime)
    rules = list(single_passes(search.first.members, margins=options.goal == "robust"))
    return Trails(rules, shelf.prepared, BOX, None), by_box_volume(NAMES, shelf.prepared)


def turns(sequence: Sequence[str], rule: int) -> tuple[Turn, ...]:
    return tuple(Turn(name, rule) for name in sequence)


def places(trail: Trail) -> list[tuple[str, bytes, bytes] | None]:
    return [
        None if step.leftover else (p.item, p.rotation.tobytes(), p.position.tobytes())
        for step in trail.steps
        for p in (step.run.placements or [None])  # type: ignore[list-item]
    ]


@pytest.mark.parametrize("constraints", ["overlap", "stability"])
def test_a_shared_beginning_changes_nothing(constraints: str) -> None:
    trails, sequence = trails_of(PlanOptions(constraints=constraints, plans=10**6, **WORDS))
    rng = np.random.default_rng(0)
    parent = trails.trail(turns(sequence, 1))
    for rule in range(6):
        changed = list(parent.turns)
        i, j, k = rng.integers(0, len(changed), 3).tolist()
        changed.insert(j, changed.pop(i))
        changed[k] = replace(changed[k], rule=rule % len(trails.rules))
        shared, alone = trails.trail(tuple(changed), parent), trails.trail(tuple(changed))
        assert places(shared) == places(alone)
        parent = shared


def test_the_latest_step_with_a_place_is_that_of_a_scan() -> None:
    trails, sequence = trails_of(
        PlanOptions(constraints="overlap", heuristic="hm", plans=10**6, places="grid", **WORDS)
    )
    trail = trails.trail(turns(sequence, 0))
    assert trail.lost
    for lost in trail.lost:
        piles = [None, *(step.pile for step in trail.steps[:lost])]
        fits = [trails.step(Piece(trail.turns[lost].item, 1), 0, pile).leftover is None for pile in piles]
        assert fits == sorted(fits, reverse=True)  # heights only grow
        assert trails.latest(trail, lost) == (
            max(k for k, fit in enumerate(fits) if fit) if fits[0] else None
        )


@pytest.mark.parametrize("goal", ["items", "height", "robust"])
def test_no_further_step_makes_up_for_a_cost(goal: Goal) -> None:
    constraints = "stability" if goal == "robust" else "overlap"
    trails, sequence = trails_of(PlanOptions(constraints=constraints, goal=goal, plans=10**6, **WORDS))
    trail = trails.trail(turns(sequence, 0))
    costs = [trails.cost(Trail(trail.turns, trail.steps[:k])) for k in range(len(sequence) + 1)]
    assert costs == sorted(costs)
    # So a plan that is given up as soon as its cost passes a limit is one whose whole cost does.
    for limit in costs[1:]:
        ended = trails.trail(trail.turns, give_up=lambda cost, limit=limit: cost > limit)  # type: ignore[misc]
        passed = next((k for k, cost in enumerate(costs) if cost > limit), len(sequence))
        assert len(ended.steps) == passed


@pytest.mark.parametrize("constraints", ["overlap", "stability"])
def test_a_beginning_below_a_ceiling_is_the_same_as_one_made_under_it(constraints: str) -> None:
    trails, sequence = trails_of(PlanOptions(constraints=constraints, goal="height", plans=10**6, **WORDS))
    for rule in range(4):
        trail = trails.trail(turns(sequence, rule))
        for ceiling in np.linspace(0.03, BOX.height, 5).tolist():
            lower = trails.under(ceiling)
            made = lower.trail(trail.turns)
            assert all(float(p.corner[2] + p.extents[2]) <= ceiling for p in made.placements)
            kept = trails.kept(trail, ceiling)
            assert places(kept) == places(made)[: len(kept.steps)]
            assert places(lower.trail(trail.turns, kept)) == places(made)


def test_who_made_a_plan() -> None:
    trails, sequence = trails_of(PlanOptions(constraints="overlap", plans=10**6, **WORDS))
    alone = trails.trail(turns(sequence[:4], 0))
    assert trails.packing(alone).made_by == "minz"
    mixed = trails.trail((*alone.turns[:3], Turn(sequence[3], len(trails.rules) - 1)), alone)
    assert trails.packing(mixed).made_by == SEVERAL


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
def test_a_search_is_never_worse_and_verifies(constraints: str) -> None:
    order = rp.Order.of(*NAMES)
    plain = rp.plan(order, BOX, ITEMS, constraints=constraints, **WORDS)
    found = rp.plan(order, BOX, ITEMS, constraints=constraints, plans=12, **WORDS)
    assert len(found.placements) >= len(plain.placements)
    assert rp.verify(found, ITEMS).ok
    assert len(found.placements) + len(found.leftovers) == len(NAMES)
    if constraints != "overlap":
        assert all("margin_deg" in p.details["stability"] for p in found.placements)  # type: ignore[operator]


def test_more_plans_pack_more() -> None:
    order = rp.Order.of(*NAMES)
    words = {"constraints": "overlap", "heuristic": "hm", "places": "grid", **WORDS}
    counts = [len(rp.plan(order, BOX, ITEMS, plans=n, **words).placements) for n in (0, 10, 80)]
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_the_same_number_of_plans_gives_the_same_plan() -> None:
    order = rp.Order.of(*NAMES)
    made = [rp.plan(order, BOX, ITEMS, constraints="overlap", plans=25, seed=4, **WORDS) for _ in range(2)]
    assert plan_to_json(made[0]) == plan_to_json(made[1])


def test_a_height_goal_lowers_the_pile() -> None:
    order = rp.Order.of(*NAMES[:6])
    words = {"constraints": "overlap", "heuristic": "mta", **WORDS}
    plain = rp.plan(order, BOX, ITEMS, **words)
    lower = rp.plan(order, BOX, ITEMS, plans=60, goal="height", **words)
    assert plain.complete
    assert lower.complete
    assert lower.metrics["height"] < plain.metrics["height"]
    # With the goal of all items there is nothing to search for.
    same = rp.plan(order, BOX, ITEMS, plans=60, **words)
    assert same.metrics["height"] == plain.metrics["height"]


def test_ctrl_c_gives_the_best_plan_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = 0
    trail = Trails.trail

    def stopped(self: Trails, *given: Any) -> Trail:
        nonlocal calls
        calls += 1
        if calls == 11:
            raise KeyboardInterrupt
        return trail(self, *given)

    monkeypatch.setattr(Trails, "trail", stopped)
    told: list[str] = []
    watcher = Watcher()
    monkeypatch.setattr(watcher, "remark", told.append)
    order = rp.Order.of(*NAMES)
    plan = rp.plan(order, BOX, ITEMS, constraints="overlap", budget=1e5, watcher=watcher, **WORDS)
    assert plan.placements
    assert rp.verify(plan, ITEMS).ok
    assert told[-1].startswith("stopped")


@pytest.mark.parametrize("constraints", ["overlap", "robot"])
def test_workers_change_nothing(constraints: str) -> None:
    order = rp.Order.of(*NAMES)
    words = {"constraints": constraints, "plans": 30, "seed": 4, **WORDS}
    made = [rp.plan(order, BOX, ITEMS, workers=n, **words) for n in (1, 2, 3)]
    assert len({json.dumps(plan_to_json(plan)) for plan in made}) == 1


def test_a_worker_that_dies_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[Processes] = []
    begin = Processes.advance

    def dying(self: Processes, tasks: Any) -> Any:
        if not started:
            started.append(self)
            yield from begin(self, tasks)
        else:
            self._processes[1].kill()
            yield from begin(self, tasks)

    monkeypatch.setattr(Processes, "advance", dying)
    order = rp.Order.of(*NAMES)
    plan = rp.plan(order, BOX, ITEMS, constraints="overlap", plans=500, workers=2, **WORDS)
    assert rp.verify(plan, ITEMS).ok


def test_what_cannot_be_copied_stays_in_this_process() -> None:
    told: list[str] = []
    watcher = Watcher()
    watcher.remark = told.append  # type: ignore[method-assign]
    words = {"heuristic": lambda candidates, rng: candidates.z, "constraints": "overlap", "plans": 3, **WORDS}
    plan = rp.plan(rp.Order.of(*NAMES), BOX, ITEMS, workers=2, watcher=watcher, **words)
    assert plan.placements
    assert any("one worker instead of 2" in line for line in told)


@pytest.mark.parametrize("workers", [0, -1, 1.5, True, "2"])
def test_workers_are_a_number(workers: Any) -> None:
    with pytest.raises(rp.InputError, match="workers"):
        rp.plan(rp.Order.of(*NAMES), BOX, ITEMS, workers=workers)


def test_a_robust_goal_raises_the_least_margin() -> None:
    order = rp.Order.of(*NAMES[:6])
    words = {"constraints": "stability", "stability": "paper", "heuristic": "mta", **WORDS}
    plain = rp.plan(order, BOX, ITEMS, **words)
    robust = rp.plan(order, BOX, ITEMS, plans=40, goal="robust", **words)
    assert len(robust.placements) >= len(plain.placements)
    assert least_margin(robust.placements) > least_margin(plain.placements)
    with pytest.raises(rp.InputError, match="goal robust"):
        PlanOptions(goal="robust", constraints="overlap")


def test_a_search_takes_a_smaller_box() -> None:
    boxes = [Container(0.16, 0.14, z / 100) for z in range(6, 26)]
    order = rp.Order.of(*NAMES[:8])
    words = {"constraints": "overlap", "heuristic": "mta", "places": "grid", **WORDS}
    greedy = rp.plan(order, boxes, ITEMS, **words)
    found = rp.plan(order, boxes, ITEMS, plans=2000, goal="box", **words)
    assert greedy.complete
    assert found.complete
    assert found.container.volume < greedy.container.volume
    assert rp.verify(found, ITEMS).ok
    again = rp.plan(order, boxes, ITEMS, plans=2000, goal="box", **words)
    assert plan_to_json(again) == plan_to_json(found)


def test_a_budget_of_seconds_ends() -> None:
    began = time.monotonic()
    rp.plan(rp.Order.of(*NAMES), BOX, ITEMS, constraints="overlap", budget=1.0, **WORDS)
    assert time.monotonic() - began < 60.0
    assert not Budget().given
    assert Budget(seconds=1.0).given


def test_after_the_deadline_one_plan_is_made_and_no_restart() -> None:
    shelf = shelf_of(ITEMS, GRID)
    options = PlanOptions(constraints="overlap", grid=GRID, restarts=3)
    planner = assemble(options, shelf, BOX)
    alone = packer(options, planner, shelf.shapes)
    assert isinstance(alone, Portfolio)
    sequence = by_box_volume(NAMES, shelf.prepared)
    once = replace(planner, strategy=replace(planner.strategy, restarts=0)).pack(
        sequence, shelf.prepared, BOX
    )
    over = replace(planner, until=Deadline(1.0, lambda: 2.0)).pack(sequence, shelf.prepared, BOX)
    assert once.lost
    assert [p.item for p in over.placements] == [p.item for p in once.placements]
    made: list[Packing] = []
    replace(alone, until=Deadline(1.0, lambda: 2.0), found=made.append).pack(sequence, shelf.prepared, BOX)
    assert len(made) == 1
    made.clear()
    replace(alone, until=Deadline(1.0, lambda: 0.5), found=made.append).pack(sequence, shelf.prepared, BOX)
    assert len(made) > len(alone.members)


def test_physics_takes_seconds_and_no_number_of_plans() -> None:
    assert PlanOptions(stability="physics", budget=10.0).budget == 10.0
    with pytest.raises(rp.InputError, match="stability physics makes one plan"):
        PlanOptions(stability="physics", plans=10)
