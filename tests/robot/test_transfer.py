"""Paths of the cup: height, uprightness and posture, for both robots."""

import numpy as np
import pytest

from packenv.robot.gripper import top_down
from packenv.robot.protocol import Robot
from packenv.robot.transfer import SPACING, arcs, branches, joined, same_posture, straight, vertical
from tests.robot.sampling import ROBOTS

TURN = 2.0 * np.pi


@pytest.fixture(params=ROBOTS, ids=lambda r: r.name)
def robot(request) -> Robot:
    return request.param


def tool(distance: float, angle: float, height: float, yaw: float) -> np.ndarray:
    return top_down(np.array([distance * np.cos(angle), distance * np.sin(angle), height]), yaw)


def test_vertical_goes_straight_up():
    start = tool(0.5, 0.3, 0.1, 1.0)
    path = vertical(start, 0.207)
    np.testing.assert_allclose(path[0], start)
    np.testing.assert_allclose(path[:, :3, :3], np.broadcast_to(start[:3, :3], (len(path), 3, 3)))
    np.testing.assert_allclose(path[:, :2, 3], np.broadcast_to(start[:2, 3], (len(path), 2)))
    rise = np.diff(path[:, 2, 3])
    assert rise.min() > 0.0
    assert rise.max() <= SPACING + 1e-12
    assert path[-1, 2, 3] == pytest.approx(0.307)


def test_arcs_go_all_ways_round_with_the_cup_down():
    start, end = tool(0.5, -1.5, 0.3, 0.4), tool(0.7, 0.2, 0.35, -2.0)
    swept = set()
    for path in arcs(start, end):
        np.testing.assert_allclose(path[0], start, atol=1e-12)
        np.testing.assert_allclose(path[-1], end, atol=1e-12)
        np.testing.assert_allclose(path[:, :3, 2], [[0.0, 0.0, -1.0]] * len(path))
        np.testing.assert_allclose(np.linalg.det(path[:, :3, :3]), 1.0)
        distance = np.hypot(path[:, 0, 3], path[:, 1, 3])
        assert (np.diff(distance) > 0.0).all()
        assert (np.diff(path[:, 2, 3]) > 0.0).all()
        angles = np.unwrap(np.arctan2(path[:, 1, 3], path[:, 0, 3]))
        yaws = np.unwrap(np.arctan2(path[:, 1, 0], path[:, 0, 0]))
        swept.add((round(angles[-1] - angles[0], 9), round(yaws[-1] - yaws[0], 9)))
    assert {angle for angle, _ in swept} == {1.7, round(1.7 - TURN, 9)}
    assert len(swept) == 4


def test_joined_keeps_posture_height_and_ends(robot: Robot):
    start, end = (tool(0.55, angle, 0.45, yaw) for angle, yaw in ((-1.5, 0.3), (0.1, 1.2)))
    first = branches(robot, vertical(start, 0.01))[:, 0]
    last = branches(robot, vertical(end, 0.01))[:, 0]
    found = 0
    for a in first:
        for b in last:
            for q in joined(robot, a, b):
                found += 1
                np.testing.assert_array_equal(q[[0, -1]], [a, b])
                assert np.abs(np.diff(q, axis=0)).max() < 0.35
                assert robot.limit_margin(q).min() > -1e-6
                tools = robot.tool(q)
                np.testing.assert_allclose(tools[:, 2, 3], 0.45, atol=1e-6)
                np.testing.assert_allclose(tools[:, 2, 2], -1.0, atol=1e-9)
                # One posture: the elbow never stretches and the wrist never turns over.
                assert np.ptp(q[:, 2]) < 0.1
    assert found >= 1


def test_same_posture_is_up_to_whole_turns():
    q = np.array([0.1, -0.2, 0.3, 1.0, 0.5, -3.0])
    assert same_posture(q, q + TURN * np.array([0, 0, 0, 1, 0, -1]))
    assert not same_posture(q, q + 1e-3)


def test_straight_is_evenly_spaced():
    start, end = np.zeros(6), np.array([1.0, -0.5, 0.0, 2.0, 0.1, 0.0])
    line = straight(start, end)
    np.testing.assert_array_equal(line[[0, -1]], [start, end])
    np.testing.assert_allclose(
        np.diff(line, axis=0), np.broadcast_to((end) / (len(line) - 1), (len(line) - 1, 6))
    )
    assert np.abs(np.diff(line, axis=0)).max() <= 0.01 + 1e-12
