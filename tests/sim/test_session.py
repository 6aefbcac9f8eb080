"""Placing in physics: what is measured, what counts as failure, and that nothing is left to chance."""

from __future__ import annotations

import numpy as np
import pytest

from packenv.sim.camera import Recorder
from packenv.sim.descent import Profile
from packenv.sim.placing import MotionConfig
from packenv.sim.session import ExecutionConfig
from tests.sim.bodies import BOX, ball, brick, by_hand, by_robot, carried_out, slipped

pytestmark = pytest.mark.usefixtures("auto")


def test_a_box_falls_the_centimetre_from_the_release() -> None:
    done = carried_out([by_hand(brick(), (0.1, 0.1, 0.0))])
    (outcome,) = done.items
    assert (done.success, done.cause) == (True, None)
    assert outcome.drop_m == pytest.approx(0.01, abs=3e-4)
    assert outcome.shift_m < 3e-4
    assert outcome.at_rest
    assert not outcome.collided
    assert outcome.moved == ()


def test_gentle_lowering_leaves_nothing_to_fall() -> None:
    config = ExecutionConfig(motion=MotionConfig(profile=Profile(gentle=True)))
    (outcome,) = carried_out([by_hand(brick(), (0.1, 0.1, 0.0))], config).items
    assert abs(outcome.drop_m) < 5e-4
    assert outcome.shift_m < 3e-4


def test_a_grasp_that_slipped_is_measured_as_shift() -> None:
    (outcome,) = carried_out([by_hand(brick(), (0.1, 0.1, 0.0), slipped(0.006, -0.008))]).items
    assert outcome.shift_m == pytest.approx(0.01, abs=3e-4)


def test_ideal_hand_and_robot_put_a_box_at_the_same_place() -> None:
    size, corner = (0.10, 0.08, 0.05), (0.11, 0.12, 0.0)
    by = [carried_out([task]) for task in (by_hand(brick(), corner), by_robot(brick(), size, corner))]
    assert all(done.success for done in by)
    (r0, p0), (r1, p1) = (done.final[0] for done in by)
    assert np.abs(p0 - p1).max() < 1e-3
    assert np.abs(r0 - r1).max() < 0.01


def test_an_item_higher_than_the_container_is_out() -> None:
    done = carried_out([by_hand(brick(0.1, 0.1, 0.33), (0.1, 0.1, 0.0))])
    assert (done.success, done.cause) == (False, "item-out")
    assert "brick sticks 30." in done.detail


def test_an_item_that_is_placed_into_another_collides_with_it() -> None:
    tasks = [by_hand(brick(name="first"), (0.1, 0.1, 0.0)), by_hand(brick(name="second"), (0.15, 0.1, 0.0))]
    done = carried_out([*tasks, by_hand(brick(name="third"), (0.0, 0.0, 0.0))])
    assert (done.success, done.cause) == (False, "collision")
    assert "second met first" in done.detail
    assert [outcome.item for outcome in done.items] == ["first", "second"]
    assert done.items[1].collided
    assert 0.002 < done.items[1].deepest_m < 0.005  # the tolerance, and a step of the way down


def test_an_item_beside_another_does_not_collide() -> None:
    tasks = [by_hand(brick(name="first"), (0.1, 0.1, 0.0)), by_hand(brick(name="second"), (0.201, 0.1, 0.0))]
    assert carried_out(tasks).success


def test_an_item_that_left_its_place_is_to_blame_for_a_collision() -> None:
    away = by_hand(brick(name="first"), (0.02, 0.1, 0.0), slipped(0.03, 0.0))
    done = carried_out([away, by_hand(brick(name="second"), (0.13, 0.1, 0.0))])
    assert (done.success, done.cause) == (False, "item-displaced")
    assert "second met first, which had left its place" in done.detail


def test_the_robot_s_gripper_is_watched_as_well() -> None:
    size, corner = (0.10, 0.08, 0.05), (0.0, 0.1, 0.0)
    tower = by_hand(brick(0.04, 0.04, 0.2, "tower"), (0.06, 0.12, 0.0))
    done = carried_out([tower, by_robot(brick(), size, corner)])
    assert done.cause == "collision"
    assert "met tower" in done.detail


def test_a_ball_without_hollow_rolls_no_farther_than_a_wall() -> None:
    """It falls beside the edge of a ledge, and rolls away from it through the whole box."""
    ledge = by_hand(brick(0.06, 0.30, 0.08, "ledge"), (0.0, 0.01, 0.0))
    done = carried_out([ledge, by_hand(ball(), (0.08, 0.16, 0.12))])
    assert done.final[1][1][0] > 0.08 + 0.05
    low, high = done.final[1][1] - 0.04, done.final[1][1] + 0.04
    assert low.min() > -2e-3
    assert (high < np.array(BOX.size) + 2e-3).all()


def test_rest_is_reported_where_the_robot_s_way_back_takes_longer_than_settling() -> None:
    config = ExecutionConfig(motion=MotionConfig(settle=0.5))
    (outcome,) = carried_out([by_robot(brick(), (0.10, 0.08, 0.05), (0.1, 0.1, 0.0))], config).items
    assert outcome.at_rest
    assert outcome.settle_s < 0.5


def test_the_full_time_tells_whether_anything_still_moves_at_its_end() -> None:
    tasks = [
        by_hand(brick(0.06, 0.30, 0.08, "ledge"), (0.0, 0.01, 0.0)),
        by_hand(ball(), (0.08, 0.16, 0.12)),
    ]
    for settle, calm in ((0.4, [True, False]), (20.0, [True, True])):
        full = ExecutionConfig(motion=MotionConfig(settle=settle, rest=None))
        assert [outcome.at_rest for outcome in carried_out(tasks, full).items] == calm


def test_the_same_tasks_give_the_same_bits_recorded_or_not() -> None:
    size = (0.10, 0.08, 0.05)
    tasks = [
        by_robot(brick(), size, (0.1, 0.1, 0.0)),
        by_robot(brick(name="toppler"), size, (0.16, 0.14, 0.05)),
        by_robot(brick(name="other"), size, (0.01, 0.22, 0.0)),
    ]
    recorder = Recorder()
    first, second, third = (carried_out(tasks, watch=watch) for watch in (None, None, recorder))
    assert first.items[1].turned_rad > 0.3
    for other in (second, third):
        for (r0, p0), (r1, p1) in zip(first.final, other.final, strict=True):
            assert r0.tobytes() == r1.tobytes()
            assert p0.tobytes() == p1.tobytes()
        assert [o.drop_m for o in first.items] == [o.drop_m for o in other.items]
    frames = recorder.frames()
    assert [f.time for f in frames] == sorted(f.time for f in frames)
    assert max(len(f.poses) for f in frames) == 3
    assert all(f.joints is not None and f.joints.shape == (6,) for f in frames)


@pytest.mark.parametrize("most", [2, 7, 300])
def test_a_recorder_keeps_no_more_frames_than_asked_for(most: int) -> None:
    recorder = Recorder(rate=60.0, most=most)
    full = ExecutionConfig(motion=MotionConfig(settle=2.0, rest=None))
    carried_out([by_hand(brick(), (0.1, 0.1, 0.0))], full, recorder)
    frames = recorder.frames()
    assert 2 <= len(frames) <= most
    # The box is lowered for most of a second, falls, and then nothing moves for two.
    assert frames[-1].time < 1.8
    assert frames[0].poses[0][1][2] > 0.25
    assert frames[-1].poses[0][1][2] < 0.001
