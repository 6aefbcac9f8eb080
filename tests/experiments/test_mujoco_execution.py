"""Plans in the second engine: judged by the same rules, and the same as the first where it is simple."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

pytest.importorskip(
    "mujoco", reason="the second engine is not installed (pip install 'robotpack[second-engine]')"
)

from experiments.mujoco_execution import execute_in_mujoco
from experiments.pose_gap import pose_gap
from packenv.robot.files import default_cell
from packenv.sim.descent import PlacementTask
from packenv.sim.plan_tasks import run_tasks
from packenv.sim.session import Execution, ExecutionConfig
from tests.sim.bodies import BOX, ball, brick, by_hand


def in_both(tasks: Sequence[PlacementTask]) -> tuple[Execution, Execution]:
    return run_tasks(tasks, default_cell().with_container(BOX), ExecutionConfig()), execute_in_mujoco(
        tasks, BOX
    )


def test_both_engines_leave_a_simple_pile_where_it_was_planned() -> None:
    tasks = [
        by_hand(brick(name="low"), (0.1, 0.1, 0.0)),
        by_hand(brick(name="beside"), (0.201, 0.1, 0.0)),
        by_hand(brick(name="bridge"), (0.15, 0.1, 0.05)),
        by_hand(ball(), (0.05, 0.05, 0.04)),
    ]
    first, second = in_both(tasks)
    for done in (first, second):
        assert (done.success, done.cause) == (True, None)
        assert all(outcome.at_rest for outcome in done.items)
    for task, a, b in zip(tasks, first.final, second.final, strict=True):
        assert pose_gap(task.item, a, b) < 5e-4
    for a, b in zip(first.items, second.items, strict=True):
        assert b.drop_m == pytest.approx(a.drop_m, abs=5e-4)
        assert b.shift_m == pytest.approx(a.shift_m, abs=5e-4)


def test_both_engines_tell_that_a_plan_overlaps() -> None:
    tasks = [by_hand(brick(name="first"), (0.1, 0.1, 0.0)), by_hand(brick(name="second"), (0.15, 0.1, 0.0))]
    for done in in_both([*tasks, by_hand(brick(name="third"), (0.0, 0.0, 0.0))]):
        assert (done.success, done.cause) == (False, "collision")
        assert "second met first" in done.detail
        assert [outcome.item for outcome in done.items] == ["first", "second"]


def test_an_item_in_the_wall_collides_with_the_container() -> None:
    done = execute_in_mujoco([by_hand(brick(), (-0.003, 0.1, 0.0))], BOX)
    assert (done.cause, done.items[0].met) == ("collision", "container")
    assert done.items[0].deepest_m == pytest.approx(0.003, abs=1e-4)


def test_both_engines_tell_that_an_item_is_out() -> None:
    for done in in_both([by_hand(brick(0.1, 0.1, 0.33), (0.1, 0.1, 0.0))]):
        assert (done.success, done.cause) == (False, "item-out")


def test_both_engines_blame_an_item_that_left_its_place() -> None:
    tasks = [
        by_hand(brick(0.1, 0.3, 0.05, "ledge"), (0.0, 0.0, 0.0)),
        # Two thirds of it have nothing below, so it falls beside the ledge.
        by_hand(brick(0.09, 0.05, 0.03, "faller"), (0.07, 0.1, 0.05)),
        by_hand(brick(0.05, 0.05, 0.05, "next"), (0.12, 0.1, 0.0)),
    ]
    for done in in_both(tasks):
        assert (done.success, done.cause) == (False, "item-displaced")
        assert "next met faller, which had left its place" in done.detail
        assert done.items[1].turned_rad > 0.1


def test_the_same_plan_gives_the_same_bits() -> None:
    tasks = [by_hand(brick(), (0.1, 0.1, 0.0)), by_hand(brick(), (0.13, 0.14, 0.05))]
    first, second = (execute_in_mujoco(tasks, BOX) for _ in range(2))
    for (r0, p0), (r1, p1) in zip(first.final, second.final, strict=True):
        assert np.array_equal(r0, r1)
        assert np.array_equal(p0, p1)
