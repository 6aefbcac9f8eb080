"""The way down: the robot that feels a contact gets beside it, and is the same robot where it feels none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from packenv.robot.files import default_cell
from packenv.sim.descent import PlacementTask, Profile, Way, ways_out
from packenv.sim.session import ExecutionConfig, feeling
from packenv.sim.world import Touch
from tests.robot.sampling import TX90
from tests.sim.bodies import BOX, brick, by_hand, by_robot, carried_out, slipped

SIZE = (0.10, 0.08, 0.05)


@pytest.mark.parametrize("slip", [(-0.005, 0.0), (0.0, -0.004), (-0.004, -0.004)])
def test_a_robot_that_feels_gets_past_the_rim_that_a_blind_one_hits(slip: tuple[float, float]) -> None:
    task = by_hand(brick(), (0.001, 0.001, 0.0), slipped(*slip))
    blind = carried_out([task], ExecutionConfig())
    assert (blind.success, blind.cause) == (False, "collision")
    felt = carried_out([task], feeling(ExecutionConfig()))
    assert felt.success
    (outcome,) = felt.items
    assert outcome.deepest_m is not None
    assert outcome.deepest_m <= ExecutionConfig().motion.tolerance
    assert outcome.shift_m < 0.01
    assert outcome.turned_rad < 0.01


def test_the_robot_s_own_joints_follow_it_aside() -> None:
    low = by_robot(brick(), SIZE, (0.001, 0.1, 0.0))
    task = PlacementTask(low.item, low.rotation, low.position, low.joints, low.heights, slipped(-0.004, 0.0))
    assert carried_out([task], ExecutionConfig()).cause == "collision"
    felt = carried_out([task], feeling(ExecutionConfig()))
    assert felt.success
    assert felt.items[0].measured[1][0] > -1e-4


def test_where_nothing_is_met_feeling_changes_no_bit() -> None:
    tasks = [by_robot(brick(), SIZE, (0.1, 0.1, 0.0)), by_robot(brick(name="on"), SIZE, (0.1, 0.1, 0.05))]
    plain, felt = (carried_out(tasks, c) for c in (ExecutionConfig(), feeling(ExecutionConfig())))
    for (r0, p0), (r1, p1) in zip(plain.final, felt.final, strict=True):
        assert (r0.tobytes(), p0.tobytes()) == (r1.tobytes(), p1.tobytes())


def test_what_lies_in_the_way_altogether_is_still_a_collision() -> None:
    under = by_hand(brick(name="under"), (0.1, 0.1, 0.0))
    done = carried_out([under, by_hand(brick(name="in"), (0.12, 0.1, 0.0))], feeling(ExecutionConfig()))
    assert (done.success, done.cause) == (False, "collision")


def test_a_robot_feels_the_wall_on_its_way_aside() -> None:
    """Between wall and neighbour there is no room: it pushes into the neighbour below, not the wall."""
    neighbour = by_hand(brick(name="neighbour"), (0.099, 0.1, 0.0))
    done = carried_out([neighbour, by_hand(brick(), (0.003, 0.1, 0.0))], feeling(ExecutionConfig()))
    assert (done.success, done.cause) == (False, "collision")
    assert "neighbour" in done.detail


@given(x=st.floats(-0.006, 0.006), y=st.floats(-0.006, 0.006))
def test_a_way_moved_aside_is_the_same_way_there(x: float, y: float) -> None:
    task, cell = by_robot(brick(), SIZE, (0.1, 0.1, 0.0)), default_cell().with_container(BOX)
    way = Way.of_task(task, cell, Profile(), 0.05)
    moved = way.moved(np.array([x, y]), cell)
    assert moved is not None
    tips = [TX90.tool(w.joints)[:, :3, 3] for w in (way, moved)]
    np.testing.assert_allclose(tips[1] - tips[0], np.tile([x, y, 0.0], (len(way), 1)), atol=1e-9)
    np.testing.assert_allclose(moved.poses[:, :3, 3] - way.poses[:, :3, 3], tips[1] - tips[0], atol=1e-9)
    np.testing.assert_array_equal(moved.poses[:, :3, :3], way.poses[:, :3, :3])


def test_a_way_that_the_arm_cannot_follow_is_none() -> None:
    cell = default_cell().with_container(BOX)
    way = Way.of_task(by_robot(brick(), SIZE, (0.1, 0.1, 0.0)), cell, Profile(), 0.05)
    assert way.moved(np.array([5.0, 0.0]), cell) is None


@given(angle=st.floats(0.0, 6.28), rise=st.floats(-0.9, 0.9), depth=st.floats(0.0, 0.002))
def test_the_first_way_out_is_along_the_normal_and_farther_than_the_contact_is_deep(
    angle: float, rise: float, depth: float
) -> None:
    flat = np.array([np.cos(angle), np.sin(angle), 0.0])
    normal = np.sqrt(1.0 - rise**2) * flat + [0.0, 0.0, rise]
    out = next(ways_out(Touch(1, 2, depth, np.zeros(3), normal), np.array([0.0, 0.1, 0.0])))
    assert np.hypot(*out) > depth
    np.testing.assert_allclose(out / np.hypot(*out), flat[:2], atol=1e-9)


def test_some_way_out_leads_close_to_anywhere_near() -> None:
    below = Touch(1, 2, 0.001, np.array([0.02, 0.0, 0.1]), np.array([0.0, 0.0, 1.0]))
    ways = np.array(list(ways_out(below, np.array([0.05, 0.0, 0.13]))))
    assert ways[0][0] > 0.001
    assert ways[0][1] == pytest.approx(0.0)
    for wanted in np.random.default_rng(0).uniform(-0.004, 0.004, (200, 2)):
        assert np.hypot(*(ways - wanted).T).min() < 0.0022


def test_above_is_the_last_place_high_enough() -> None:
    way = Way.of_task(by_hand(brick(), (0.1, 0.1, 0.0)), default_cell().with_container(BOX), Profile(), 0.01)
    k = way.above(way.release, 0.03)
    heights = way.poses[:, 2, 3]
    assert heights[k] >= heights[way.release] + 0.03 > heights[k + 1]
    assert way.above(way.release, 9.0) == 0
