"""Other robots and other places of the container: what must not matter does not, what cannot be is answered."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from packenv.planning.manipulation.checker import ManipulationChecker
from packenv.planning.manipulation.grasps import generate_grasps
from packenv.planning.search.container_map import ContainerMap
from packenv.robot.cell import Cell, CellSetup, Place
from packenv.types import Container
from tests.planning.manipulation.test_checker import box, oriented_of
from tests.robot.sampling import KR10, ROBOTS

PAPER = Container(0.32, 0.32, 0.30)
ITEM = oriented_of(box(0.06, 0.08, 0.05))
ROBOT = pytest.mark.parametrize("robot", ROBOTS, ids=lambda r: r.name)


def asked(setup, corner, container=PAPER):
    surface = ContainerMap.empty(container, ITEM.cell_size)
    checker = ManipulationChecker(setup.with_container(container))
    return checker, checker.check(ITEM, np.array(corner), surface, generate_grasps(ITEM))


def holds(cell, corner, found):
    """The joints bring the cup straight down onto the grasp, within the limits, clear of rim and itself."""
    cups = cell.to_container(cell.robot.tool(found.joints)[:, :3, 3])
    at = np.array(corner) + found.grasp.point
    np.testing.assert_allclose(cups[:, :2], np.tile(at[:2], (len(cups), 1)), atol=1e-9)
    np.testing.assert_allclose(cups[:, 2], found.lip_heights, atol=1e-9)
    np.testing.assert_allclose(cell.robot.tool(found.joints)[:, 2, 2], -1.0, atol=1e-9)
    assert cell.robot.limit_margin(found.joints).min() >= -1e-9
    assert cell.arm_clear(found.joints[None])[0]


@ROBOT
@pytest.mark.parametrize("corner", [(0.0, 0.0, 0.0), (0.26, 0.24, 0.0), (0.12, 0.12, 0.2), (0.0, 0.24, 0.1)])
def test_every_robot_serves_the_papers_container(robot, corner):
    checker, found = asked(CellSetup(robot), corner)
    assert found.feasible
    holds(checker.cell, corner, found)


@ROBOT
@settings(deadline=None, max_examples=25)
@given(
    x=st.floats(-3, 3),
    y=st.floats(-3, 3),
    z=st.floats(-1, 1),
    yaw=st.floats(-180, 180),
    turn=st.floats(-20, 20),
)
def test_base_and_container_moved_together_are_the_same_cell(robot, x, y, z, yaw, turn):
    here = CellSetup(robot, container=Place((0.42, -0.12, 0.02), turn))
    c, s = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    there = replace(
        here,
        base=Place((x, y, z), yaw),
        container=Place((x + c * 0.42 + s * 0.12, y + s * 0.42 - c * 0.12, z + 0.02), yaw + turn),
    )
    one, other = here.with_container(PAPER), there.with_container(PAPER)
    np.testing.assert_allclose(one.position, other.position, atol=1e-12)
    assert math.cos(one.yaw - other.yaw) == pytest.approx(1.0, abs=1e-12)
    for corner in ((0.0, 0.0, 0.0), (0.2, 0.1, 0.05)):
        (_, first), (_, second) = asked(here, corner), asked(there, corner)
        assert first.reason == second.reason
        if first.feasible:
            np.testing.assert_allclose(first.joints, second.joints, atol=1e-7)


@ROBOT
@settings(deadline=None, max_examples=20)
@given(azimuth=st.floats(-150, 150))
def test_all_around_the_base_the_container_is_served_the_same(robot, azimuth):
    """The cell turned about joint 1's axis: joint 1 takes the turn, and nothing else changes."""
    setup = CellSetup(robot)
    x, y = setup.with_container(PAPER).position[:2]
    c, s = math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth))
    turned = replace(setup, container=Place((c * x - s * y, s * x + c * y, 0.0), azimuth))
    for corner in ((0.0, 0.1, 0.0), (0.2, 0.2, 0.1)):
        (_, first), (checker, second) = asked(setup, corner), asked(turned, corner)
        assert first.feasible
        assert second.feasible
        holds(checker.cell, corner, second)


@settings(deadline=None, max_examples=30)
@given(
    x=st.floats(-1, 1),
    y=st.floats(-1, 1),
    z=st.floats(-1, 1),
    yaw=st.floats(-180, 180),
    seed=st.integers(0, 99),
)
def test_frames_are_inverse_to_each_other(x, y, z, yaw, seed):
    cell = Cell(CellSetup(KR10), PAPER, (x, y, z), math.radians(yaw))
    points = np.random.default_rng(seed).uniform(-1, 1, (5, 3))
    np.testing.assert_allclose(cell.to_container(cell.to_base(points)), points, atol=1e-12)
    poses = KR10.forward(np.random.default_rng(seed).uniform(-1, 1, (4, 6)))
    np.testing.assert_allclose(cell.poses_to_container(cell.poses_to_base(poses)), poses, atol=1e-12)
    np.testing.assert_allclose(cell.poses_to_base(poses)[:, :3, 3], cell.to_base(poses[:, :3, 3]), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(cell.poses_to_base(poses)[:, :3, :3]), 1.0)


@ROBOT
def test_a_container_out_of_reach_is_an_answer(robot):
    assert (
        asked(CellSetup(robot, container=Place((3.0, 0.0, 0.0))), (0.1, 0.1, 0.0))[1].reason == "unreachable"
    )


@ROBOT
def test_a_container_in_the_robots_base_is_an_answer(robot):
    near = robot.shapes.column_radius - 0.01
    found = asked(CellSetup(robot, container=Place((near, -0.16, 0.0))), (0.2, 0.1, 0.0))[1]
    assert found.reason == "link-collision"
    below = CellSetup(robot, container=Place((near, -0.16, -0.31))).with_container(PAPER)
    assert not below.in_column  # it stands below the base
    beside = CellSetup(robot, container=Place((near + 0.02, -0.16, 0.0))).with_container(PAPER)
    assert not beside.in_column


def test_a_shorter_gripper_serves_less():
    low, high = (0.1, 0.1, 0.0), (0.1, 0.1, 0.2)
    short = KR10.with_gripper(replace(KR10.gripper, length=0.15))
    assert asked(CellSetup(KR10), low)[1].feasible
    assert not asked(CellSetup(short), low)[1].feasible
    assert asked(CellSetup(short), high)[1].feasible


def test_release_and_rim_clearance_are_the_cells():
    setup = CellSetup(KR10, release_height=0.004, rim_clearance=0.05)
    checker, found = asked(setup, (0.1, 0.1, 0.0))
    holds(checker.cell, (0.1, 0.1, 0.0), found)
    lips = found.lip_heights - found.grasp.point[2]
    assert lips[0] == pytest.approx(0.35)
    assert lips[-2] == pytest.approx(0.004)
    assert lips[-1] == pytest.approx(0.0)
