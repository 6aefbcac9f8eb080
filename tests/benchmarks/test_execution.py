"""Where the time of an execution goes."""

from __future__ import annotations

import time

import pytest

from benchmarks import execution
from benchmarks.execution import Clock
from packenv.execution.physics_planner import CAREFUL
from packenv.sim.session import ExecutionConfig
from tests.sim.bodies import BOX, brick, by_robot

CONFIG = ExecutionConfig()


class Hands:
    """Work that takes as long as it says on a clock of its own."""

    now = 0.0

    def saw(self) -> None:
        Hands.now += 2.0
        self.sand()
        self.sand()

    def sand(self) -> None:
        Hands.now += 0.5

    def hurt(self) -> None:
        Hands.now += 1.0
        raise ValueError("ouch")


PARTS = ((Hands, "saw", "sawing"), (Hands, "sand", "sanding"), (Hands, "hurt", "sawing"))


@pytest.fixture(autouse=True)
def _own_clock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "real" not in request.node.name:
        monkeypatch.setattr(time, "process_time", lambda: Hands.now)


def test_what_a_part_calls_counts_for_that_one_alone() -> None:
    clock, hands = Clock(), Hands()
    before = Hands.now
    with clock.around(PARTS):
        hands.saw()
        hands.sand()
    assert clock.spent == {"sawing": 2.0, "sanding": 1.5}
    assert clock.calls == {"sawing": 1, "sanding": 3}
    assert sum(clock.spent.values()) == Hands.now - before


def test_an_error_is_timed_and_passed_on_and_the_methods_come_back() -> None:
    methods = [getattr(owner, name) for owner, name, _ in PARTS]
    clock, hands = Clock(), Hands()
    with pytest.raises(ValueError, match="ouch"), clock.around(PARTS):
        hands.hurt()
    assert clock.spent["sawing"] == 1.0
    assert [getattr(owner, name) for owner, name, _ in PARTS] == methods


def test_real_executions_are_split_into_parts() -> None:
    size = (0.10, 0.08, 0.05)
    plan = [by_robot(brick(), size, (0.1, 0.1, 0.0)), by_robot(brick(), size, (0.12, 0.1, 0.05))]
    collides = [plan[0], by_robot(brick(), size, (0.12, 0.1, 0.0)), plan[1]]
    found = execution.executions([plan, collides], BOX, 2, CONFIG)
    assert found["n"] == 1
    assert sum(found["time_shares"].values()) == pytest.approx(1.0)
    assert {part for _, _, part in execution.PARTS} | {"other", execution.STEPS} == set(found["time_shares"])
    assert all(share > 0.0 for share in found["time_shares"].values())
    # Engine steps are only made while an item falls, and while the robot goes back up.
    assert 0.0 < found["steps_median"] * CONFIG.world.time_step < found["simulated_s_median"]
    assert found["cpu_s_median"] == pytest.approx(2 * found["cpu_s_an_item"])


def test_real_drops_are_timed_as_far_as_items_stay() -> None:
    size = (0.10, 0.08, 0.05)
    plan = [by_robot(brick(), size, (0.1, 0.1, 0.0)), by_robot(brick(), size, (0.18, 0.1, 0.05))]
    found = execution.drop_tests([[*plan, plan[0]]], BOX, CONFIG)
    # So many drops an item; the second one tips over, so the third has no pile to fall on.
    assert found["n"] == 2 * len(CAREFUL)
    assert 0.0 < found["median"] <= found["max"]
