"""Forward and inverse kinematics: laws, the published DH table, singularities, another solver."""

import itertools

import numpy as np
import pytest

from packenv.robot.kinematics import LIMIT_TOLERANCE
from tests.robot.sampling import LOWER, TX90, UPPER, random_joints, rotation_angle, turn_free

# The maker's convention (a m, alpha °, d m, theta offset °), published with the ROS-Industrial model.
DH = (
    (0.05, -90, 0.478, 0),
    (0.425, 0, 0.05, -90),
    (0.0, 90, 0.0, 90),
    (0.0, -90, 0.425, 0),
    (0.0, 90, 0.0, 0),
    (0.0, 0, 0.1, 0),
)


def by_dh(q):
    pose = np.eye(4)
    for angle, (a, alpha, d, offset) in zip(q, DH, strict=True):
        t, al = angle + np.deg2rad(offset), np.deg2rad(alpha)
        ct, st, ca, sa = np.cos(t), np.sin(t), np.cos(al), np.sin(al)
        pose = pose @ np.array(
            [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    return pose


def pose_errors(q, poses):
    reached = TX90.forward(q)
    metres = np.linalg.norm(reached[..., :3, 3] - poses[..., :3, 3], axis=-1)
    return metres, rotation_angle(reached[..., :3, :3], poses[..., :3, :3])


def test_forward_agrees_with_the_dh_table():
    for q in random_joints(50, 1):
        np.testing.assert_allclose(TX90.forward(q), by_dh(q), atol=1e-12)


def test_all_joints_at_zero_is_the_arm_upright():
    pose = TX90.forward(np.zeros(6))
    np.testing.assert_allclose(pose[:3, :3], np.eye(3), atol=1e-15)
    np.testing.assert_allclose(pose[:3, 3], [0.05, 0.05, 0.478 + 0.425 + 0.425 + 0.1], atol=1e-15)


def test_forward_is_vectorized_over_any_shape():
    q = random_joints(6, 2).reshape(2, 3, 6)
    frames = TX90.link_frames(q)
    assert frames.shape == (2, 3, 7, 4, 4)
    np.testing.assert_array_equal(frames[1, 2, 6], TX90.forward(q[1, 2]))
    np.testing.assert_array_equal(frames[0, 0, 0], np.eye(4))


def test_forward_of_inverse_is_identity_on_ten_thousand_poses():
    q = random_joints(10_000, 3)
    poses = TX90.forward(q)
    found = TX90.inverse(poses)
    metres, radians = pose_errors(found.q, poses[:, None])
    assert found.exists.any(axis=1).all()
    assert np.nanmax(metres) < 1e-9
    assert np.nanmax(radians) < 1e-9


def test_the_angles_that_made_a_pose_are_among_its_branches():
    q = random_joints(10_000, 4)
    found = TX90.inverse(TX90.forward(q))
    misfit = np.abs(turn_free(found.q - q[:, None])).max(axis=-1)
    misfit[~found.valid] = np.inf
    assert misfit.min(axis=1).max() < 1e-8


def test_a_slot_is_one_configuration():
    q = TX90.inverse(TX90.forward(random_joints(2_000, 5))).q
    slot = np.arange(8)
    raw = turn_free(q)
    with np.errstate(invalid="ignore"):
        assert not np.any((raw[..., 4] < 0) & (slot // 4 == 0))
        assert not np.any((raw[..., 4] > 0) & (slot // 4 == 1))
        assert not np.any((raw[..., 2] < 0) & (slot % 2 == 0))
        assert not np.any((raw[..., 2] > 0) & (slot % 2 == 1))
    # Shoulder 0 has the wrist centre in front of joint 1, shoulder 1 behind it.
    exists = ~np.isnan(q[..., 0])
    ahead = TX90.link_frames(q[exists])
    x = np.einsum("ni,ni->n", ahead[:, 1, :3, 0], ahead[:, 5, :3, 3])
    back = np.broadcast_to(slot // 2 % 2 == 1, exists.shape)[exists]
    assert (x[back] < 1e-12).all()
    assert (x[~back] > -1e-12).all()


def test_turning_the_pose_about_the_base_turns_joint_1_alone():
    poses = TX90.forward(random_joints(500, 6))
    angle = 1.234
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    before, after = TX90.inverse(poses), TX90.inverse(turn @ poses)
    change = turn_free(after.q - before.q)
    np.testing.assert_array_equal(before.exists, after.exists)
    np.testing.assert_allclose(change[before.exists][:, 1:], 0, atol=1e-8)
    np.testing.assert_allclose(turn_free(change[before.exists][:, 0] - angle), 0, atol=1e-8)


def test_valid_means_some_turn_is_within_the_limits():
    found = TX90.inverse(TX90.forward(random_joints(300, 7)))
    for q, valid in zip(found.q[found.exists], found.valid[found.exists], strict=True):
        turns = TX90.all_turns(q)
        assert bool(len(turns)) == bool(valid)
        if valid:
            assert (q >= LOWER - LIMIT_TOLERANCE).all()
            assert (q <= UPPER + LIMIT_TOLERANCE).all()


def test_all_turns_lists_every_one():
    for q in random_joints(40, 8):
        expected = [
            q + 2 * np.pi * np.array([a, 0, 0, b, 0, c])
            for a, b, c in itertools.product(range(-2, 3), repeat=3)
        ]
        inside = [t for t in expected if TX90.limit_margin(t) >= 0]
        listed = TX90.all_turns(q)
        assert len(listed) == len(inside)
        for turn in inside:
            assert np.abs(listed - turn).max(axis=1).min() < 1e-12


def test_joint_6_has_a_second_turn_beyond_90_degrees_only():
    assert len(TX90.all_turns(np.array([0.5, 0, 0, 0, 0.5, np.deg2rad(80)]))) == 1
    assert len(TX90.all_turns(np.array([0.5, 0, 0, 0, 0.5, np.deg2rad(100)]))) == 2


@pytest.mark.parametrize("small", [0.0, 1e-15, 1e-12, 1e-10, 1e-9, 1e-8, 1e-6, 1e-4])
def test_the_wrist_singularity_keeps_its_solutions(small):
    q = random_joints(200, 9, margin=0.1)
    q[:, 4] = small
    poses = TX90.forward(q)
    found = TX90.inverse(poses)
    metres, radians = pose_errors(found.q, poses[:, None])
    assert found.valid.any(axis=1).all()
    # Below WRIST_TOLERANCE joint 4 is not resolved, at the price of that much in orientation at most.
    assert np.nanmax(metres) < 1e-9
    assert np.nanmax(radians) < 2.1e-9
    assert np.nanmin(np.abs(turn_free(found.q - q[:, None]))[..., :3].max(axis=-1), axis=1).max() < 1e-8


@pytest.mark.parametrize("small", [0.0, 1e-12, 1e-9, 1e-6])
def test_the_stretched_elbow_keeps_its_solutions(small):
    q = random_joints(200, 10, margin=0.1)
    q[:, 2] = small
    poses = TX90.forward(q)
    found = TX90.inverse(poses)
    metres, radians = pose_errors(found.q, poses[:, None])
    assert found.valid.any(axis=1).all()
    assert np.nanmax(metres) < 1e-9
    assert np.nanmax(radians) < 1e-9


def test_the_shoulder_singularity_keeps_its_solutions():
    # Wrist centre at LATERAL_OFFSET from joint 1's axis: u = 0.05 + 0.425 (sin q2 + sin(q2 + q3)) = 0.
    q = random_joints(200, 11, margin=0.3)
    q[:, 1] = -0.6
    q[:, 2] = np.arcsin(np.sin(0.6) - 0.05 / 0.425) + 0.6
    poses = TX90.forward(q)
    centre = poses[:, :2, 3] - 0.1 * poses[:, :2, 2]
    np.testing.assert_allclose(np.linalg.norm(centre, axis=1), 0.05, atol=1e-12)
    found = TX90.inverse(poses)
    metres, radians = pose_errors(found.q, poses[:, None])
    assert found.valid.any(axis=1).all()
    assert np.nanmax(metres) < 1e-9
    assert np.nanmax(radians) < 1e-9


def test_out_of_reach_is_an_answer():
    pose = TX90.forward(np.zeros(6))
    for metres, there in ((0.0, True), (1e-3, False)):
        moved = pose.copy()
        moved[2, 3] += metres
        assert TX90.inverse(moved[None]).exists.any() == there


def test_too_near_to_joint_1_is_out_of_reach():
    pose = TX90.forward(np.array([0.0, 0.5, 1.0, 0.0, 0.5, 0.0]))
    pose[:2, 3] = 0.1 * pose[:2, 2]
    assert not TX90.inverse(pose[None]).exists.any()


def test_a_bad_shape_is_named():
    with pytest.raises(ValueError, match=r"\(4, 4\)"):
        TX90.inverse(np.eye(4))
    with pytest.raises(ValueError, match="six joint angles"):
        TX90.forward(np.zeros(5))


def test_every_branch_of_another_solver_is_found():
    opw = pytest.importorskip("py_opw_kinematics", reason="py-opw-kinematics is not installed")
    from scipy.spatial.transform import RigidTransform

    model = opw.KinematicModel(a1=0.05, a2=0.0, b=0.05, c1=0.478, c2=0.425, c3=0.425, c4=0.1)
    robot = opw.Robot(model, degrees=False)
    poses = TX90.forward(random_joints(10_000, 12))
    theirs = robot.reach(RigidTransform.from_matrix(poses), joint_limits=np.stack([LOWER, UPPER], axis=1))
    ours = TX90.inverse(poses)
    # Near the border of the workspace rounding decides; no random pose is that near.
    np.testing.assert_array_equal(~np.isnan(theirs.joints[..., 0]), ours.exists)
    misfit = np.abs(turn_free(theirs.joints - ours.q))[ours.exists]
    assert misfit.max() < 1e-8
