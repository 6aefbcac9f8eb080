"""The layout, the gripper and the reachability map."""

from typing import Any

import numpy as np
import pytest

from packenv.io.containers import read_boxes
from packenv.robot.cell import Cell, CellSetup, Place
from packenv.robot.files import default_cell
from packenv.robot.gripper import top_down
from packenv.robot.protocol import Robot
from packenv.robot.reachability import corner_distances, reach_map, share, share_of_cell
from packenv.types import Container
from tests.robot.sampling import ROBOTS, TX90, random_joints

PAPER = Container(0.32, 0.32, 0.30)


def test_tool_and_flange_are_inverse_to_each_other():
    poses = TX90.forward(random_joints(20, 1))
    np.testing.assert_allclose(
        TX90.gripper.tool_to_flange(TX90.gripper.flange_to_tool(poses)), poses, atol=1e-15
    )
    tool = TX90.gripper.flange_to_tool(poses)
    np.testing.assert_allclose(np.linalg.norm(tool[:, :3, 3] - poses[:, :3, 3], axis=1), TX90.gripper.length)


def test_top_down_points_down_at_any_yaw():
    points = np.random.default_rng(2).uniform(size=(3, 4, 3))
    for yaw in (0.0, 0.7, -2.0):
        poses = top_down(points, yaw)
        np.testing.assert_allclose(poses[..., :3, 2], np.broadcast_to([0, 0, -1], points.shape))
        np.testing.assert_allclose(np.linalg.det(poses[..., :3, :3]), 1.0)
        np.testing.assert_array_equal(poses[..., :3, 3], points)


def test_base_and_container_frame_are_inverse_to_each_other():
    cell = default_cell().with_container(PAPER)
    points = np.random.default_rng(3).uniform(size=(5, 3))
    np.testing.assert_allclose(cell.to_container(cell.to_base(points)), points, atol=1e-15)
    np.testing.assert_allclose(cell.to_base(np.zeros(3)), cell.position)
    pose = top_down(points)
    np.testing.assert_allclose(cell.poses_to_base(pose)[:, :3, 3], cell.to_base(points))


def test_a_cell_is_a_value():
    assert default_cell().with_container(PAPER) == default_cell().with_container(Container(0.32, 0.32, 0.30))
    assert hash(default_cell().with_container(PAPER)) == hash(default_cell().with_container(PAPER))


def test_the_path_goes_straight_down_to_the_point():
    cell = default_cell().with_container(PAPER)
    path = cell.top_down_path(np.array([0.1, 0.2, 0.05]), 0.33, spacing=0.02)
    cup = cell.to_container(TX90.gripper.flange_to_tool(path)[:, :3, 3])
    np.testing.assert_allclose(cup[-1], [0.1, 0.2, 0.05], atol=1e-12)
    np.testing.assert_allclose(cup[0], [0.1, 0.2, 0.38], atol=1e-12)
    assert np.diff(cup[:, 2]).min() >= -0.02 - 1e-12
    assert np.diff(cup[:, 2]).max() < 0
    assert len(cell.top_down_path(np.zeros(3), 0.0)) == 1
    with pytest.raises(ValueError, match="lift"):
        cell.top_down_path(np.zeros(3), -0.1)


def test_yaw_costs_joint_6_alone():
    """The promise of gripper.py: whatever the yaw, the arm stands the same."""
    points = default_cell().with_container(PAPER).to_base(np.random.default_rng(4).uniform(0, 0.3, (20, 3)))
    first = TX90.inverse(TX90.gripper.tool_to_flange(top_down(points)))
    for yaw in np.linspace(-np.pi, np.pi, 9):
        other = TX90.inverse(TX90.gripper.tool_to_flange(top_down(points, yaw)))
        np.testing.assert_array_equal(first.valid, other.valid)
        np.testing.assert_allclose(other.q[first.valid][:, :3], first.q[first.valid][:, :3], atol=1e-9)
        np.testing.assert_allclose(
            np.cos(other.q[first.valid][:, 3:5]), np.cos(first.q[first.valid][:, 3:5]), atol=1e-9
        )


def test_reach_is_the_same_all_around_the_base():
    """The promise of reachability.py: distance and height decide."""
    rng = np.random.default_rng(5)
    for r in rng.uniform(0.2, 0.85, 25):
        counts = set()
        for angle in (0.0, 1.0, -2.5):
            # A container no larger than a cup, put at that azimuth; its rim is what counts.
            cell = Cell(default_cell(), Container(0.1, 0.1, 0.3), (r * np.cos(angle), r * np.sin(angle), 0.0))
            counts.add(len(cell.clear_branches(cell.top_down_path(np.array([0, 0, 0.1]), 0.35))))
        assert len(counts) == 1


def test_every_box_is_served_whole():
    boxes = {box.label: box for box in [*read_boxes(), PAPER]}
    assert len(boxes) >= 6
    radii = np.arange(0.25, 0.88, 0.02)
    for box in boxes.values():
        corner = default_cell().with_container(box).position[:2]
        nearest, farthest = corner_distances(box, corner)
        assert nearest >= TX90.shapes.column_radius + 0.05
        inside = radii[(radii > nearest - 0.03) & (radii < farthest + 0.03)]
        assert share(reach_map(default_cell().robot, box.height, inside, levels=4), box, corner) == 1.0


def test_out_of_reach_lowers_the_share():
    reach = reach_map(default_cell().robot, 0.3, np.arange(0.25, 1.2, 0.05), levels=4)
    shares = [share(reach, PAPER, (x, -0.16)) for x in (0.3, 0.5, 0.7, 0.85)]
    assert shares[0] > shares[1] > shares[2] > shares[3] == 0.0


@pytest.mark.parametrize("size", [(0.32, 0.32, 0.3), (0.6, 0.4, 0.32), (0.6, 0.4, 0.2), (0.495, 0.33, 0.159)])
def test_the_rough_share_of_a_cell_is_near_that_of_a_fine_map(size):
    cell = default_cell().with_container(Container(*size))
    fine = reach_map(cell.robot, cell.rim, np.arange(0.2, 1.1, 0.02), levels=10)
    assert share_of_cell(cell) == pytest.approx(share(fine, cell.container, cell.position[:2]), abs=0.12)


def test_clear_branches_keep_above_the_rim():
    cell = default_cell().with_container(PAPER)
    path = cell.top_down_path(np.array([0.16, 0.16, 0.02]), 0.32)
    found = cell.clear_branches(path)
    assert len(found) > 0
    for q in found.q:
        assert TX90.arm_lowest(q).min() >= cell.rim
        np.testing.assert_allclose(TX90.forward(q), path, atol=1e-9)


def test_a_container_deeper_than_the_gripper_is_not_served_at_its_floor():
    cell = default_cell().with_container(Container(0.32, 0.32, 0.35))
    assert len(cell.clear_branches(cell.top_down_path(np.array([0.16, 0.16, 0.01]), 0.36))) == 0
    assert len(cell.clear_branches(cell.top_down_path(np.array([0.16, 0.16, 0.10]), 0.36))) > 0


def test_the_container_stands_in_front_of_the_robot():
    cell = default_cell().with_container(PAPER)
    assert cell.position == (0.30, -0.16, 0.0)
    assert cell.rim == 0.30


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_no_posture_is_above_the_highest_rim_or_beyond_reach(robot: Robot) -> None:
    q = random_joints(200_000, seed=5, robot=robot)
    assert robot.arm_lowest(q).max() <= robot.highest_rim
    flanges = robot.forward(q[:20_000])
    down = flanges[flanges[:, 2, 2] < -0.999]
    assert np.hypot(down[:, 0, 3], down[:, 1, 3]).max() <= robot.reach + 0.1 * 0.05  # 2.6° off the vertical
    assert robot.arm_lowest(q).max() > robot.highest_rim - 0.01  # so it is not only safe


def test_a_container_that_cannot_be_served_is_told_with_both_lengths() -> None:
    def said(box: Container, tallest: float, **place: Any) -> str | None:
        setup = CellSetup(TX90, **place)
        return setup.with_container(box).barrier(tallest)

    assert said(Container(0.32, 0.32, 0.30), 0.05) is None
    assert "0.8 m above" in str(said(Container(1.2, 0.8, 0.8), 0.4))
    deep = said(Container(0.3, 0.3, 0.36), 0.05)
    assert "0.36 m deep" in str(deep)
    assert "0.3 m" in str(deep)
    assert said(Container(0.3, 0.3, 0.36), 0.07) is None
    far = said(Container(0.3, 0.3, 0.3), 0.1, container=Place((1.2, -0.15, 0.0)))
    assert "1.2 m away" in str(far)
    assert "reaches" in str(far)
