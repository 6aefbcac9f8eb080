"""The search after the first plan: never worse, the same for the same number of plans, and stopped at any time."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest

import packenv as rp
from packenv.config import GridConfig
from packenv.io.plans import plan_to_json
from packenv.planning.anytime import Anytime, Budget, Trail, _Walk
from packenv.planning.assembly import assemble, packer
from packenv.planning.options import PlanOptions
from packenv.planning.planner import by_box_volume
from packenv.planning.sequence import Piece
from packenv.types import Container
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
WORDS: dict[str, Any] = {"grid": GRID, "restarts": 0}


def walk_of(options: PlanOptions) -> tuple[_Walk, list[str]]:
    shelf = shelf_of(ITEMS, GRID)
    search = packer(options, assemble(options, shelf, BOX), shelf.shapes)
    assert isinstance(search, Anytime)
    sequence = by_box_volume(NAMES, shelf.prepared)
    first = search.first.pack(sequence, shelf.prepared, BOX)
    walk = _Walk(search, shelf.prepared, BOX, None, first, time.monotonic(), math.inf)
    return walk, sequence


def places(trail: Trail) -> list[tuple[str, bytes, bytes] | None]:
    return [
        None if step.leftover else (p.item, p.rotation.tobytes(), p.position.tobytes())
        for step in trail.steps
        for p in (step.run.placements or [None])  # type: ignore[list-item]
    ]


@pytest.mark.parametrize("constraints", ["overlap", "stability"])
def test_a_shared_beginning_changes_nothing(constraints: str) -> None:
    walk, sequence = walk_of(PlanOptions(constraints=constraints, plans=10**6, **WORDS))
    rng = np.random.default_rng(0)
    parent = walk.trail(tuple(sequence), 1, None)
    for _ in range(6):
        names = list(parent.sequence)
        i, j = rng.integers(0, len(names), 2).tolist()
        names.insert(j, names.pop(i))
        shared, alone = walk.trail(tuple(names), 1, parent), walk.trail(tuple(names), 1, None)
        assert places(shared) == places(alone)
        parent = shared


def test_the_latest_step_with_a_place_is_that_of_a_scan() -> None:
    walk, sequence = walk_of(
        PlanOptions(constraints="overlap", heuristic="hm", plans=10**6, places="grid", **WORDS)
    )
    trail = walk.trail(tuple(sequence), 0, None)
    assert trail.lost
    for lost in trail.lost:
        piles = [None, *(step.pile for step in trail.steps[:lost])]
        fits = [walk.step(Piece(trail.sequence[lost], 1), 0, pile).leftover is None for pile in piles]
        assert fits == sorted(fits, reverse=True)  # heights only grow
        assert walk.latest(trail, lost) == (max(k for k, fit in enumerate(fits) if fit) if fits[0] else None)


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
    trail = _Walk.trail

    def stopped(self: _Walk, *given: Any) -> Trail:
        nonlocal calls
        calls += 1
        if calls > 10:
            raise KeyboardInterrupt
        return trail(self, *given)

    monkeypatch.setattr(_Walk, "trail", stopped)
    plan = rp.plan(rp.Order.of(*NAMES), BOX, ITEMS, constraints="overlap", budget=1e5, **WORDS)
    assert plan.placements
    assert rp.verify(plan, ITEMS).ok


def test_a_budget_of_seconds_ends() -> None:
    began = time.monotonic()
    rp.plan(rp.Order.of(*NAMES), BOX, ITEMS, constraints="overlap", budget=1.0, **WORDS)
    assert time.monotonic() - began < 60.0
    assert not Budget().given
    assert Budget(seconds=1.0).given


def test_physics_takes_no_budget() -> None:
    with pytest.raises(rp.InputError, match="budget and plans"):
        PlanOptions(stability="physics", budget=10.0)
