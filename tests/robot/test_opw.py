"""Arms of any lengths, signs and zeros: laws, the maker's own chain, another solver."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from packenv.robot.opw import Lengths
from tests.robot.sampling import KR10, ROBOTS, TX90, random_joints, rotation_angle, turn_free

LENGTH = st.floats(0.1, 0.8)
OFFSET = st.floats(-0.2, 0.2)
LENGTHS = st.builds(Lengths, a1=OFFSET, a2=OFFSET, b=OFFSET, c1=LENGTH, c2=LENGTH, c3=LENGTH, c4=OFFSET)
TURN = st.floats(-np.pi, np.pi)
SIX = 6 * [TURN]


def arm(lengths, signs=6 * [1], offsets=6 * [0.0], low=-np.pi, high=np.pi):
    """An arm of these figures; every joint may go from ``low`` to ``high``."""
    joints = tuple(
        replace(joint, sign=sign, offset=offset, lower=low, upper=high)
        for joint, sign, offset in zip(TX90.joints, signs, offsets, strict=True)
    )
    return replace(TX90, lengths=lengths, joints=joints)


ARMS = st.builds(
    arm, LENGTHS, st.lists(st.sampled_from([1, -1]), min_size=6, max_size=6), st.tuples(*SIX).map(list)
)


def errors(robot, q, poses):
    reached = robot.forward(q)
    metres = np.linalg.norm(reached[..., :3, 3] - poses[..., :3, 3], axis=-1)
    return metres, rotation_angle(reached[..., :3, :3], poses[..., :3, :3])


def turned(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] = c * np.eye(3) + s * cross + (1 - c) * np.outer(axis, axis)
    return pose


def moved(x, y, z):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def by_kuka(q):
    """KUKA's own chain, as kr10r1100sixx_macro.xacro has it: origins, axes, and the turn from link 6 to tool0."""
    chain = [
        ((0, 0, 0.400), (0, 0, -1)),
        ((0.025, 0, 0), (0, 1, 0)),
        ((0.560, 0, 0), (0, 1, 0)),
        ((0, 0, 0.035), (-1, 0, 0)),
        ((0.515, 0, 0), (0, 1, 0)),
        ((0.080, 0, 0), (-1, 0, 0)),
    ]
    pose = np.eye(4)
    for angle, (origin, axis) in zip(q, chain, strict=True):
        pose = pose @ moved(*origin) @ turned(axis, angle)
    return pose @ turned((0, 1, 0), np.pi / 2)


def test_forward_is_the_makers_chain():
    for q in random_joints(50, 1, robot=KR10):
        np.testing.assert_allclose(KR10.forward(q), by_kuka(q), atol=1e-12)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda r: r.name)
def test_forward_of_inverse_is_identity(robot):
    q = random_joints(5_000, 3, robot=robot)
    poses = robot.forward(q)
    found = robot.inverse(poses)
    metres, radians = errors(robot, found.q, poses[:, None])
    assert np.nanmax(metres) < 1e-9
    assert np.nanmax(radians) < 1e-9
    misfit = np.abs(turn_free(found.q - q[:, None])).max(axis=-1)
    misfit[~found.valid] = np.inf
    assert misfit.min(axis=1).max() < 1e-7


@settings(deadline=None, max_examples=150)
@given(ARMS, st.integers(0, 1000))
def test_forward_of_inverse_is_identity_for_any_arm(robot, seed):
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (20, 6))
    poses = robot.forward(q)
    found = robot.inverse(poses)
    metres, radians = errors(robot, found.q, poses[:, None])
    assert found.exists.any(axis=1).all()
    assert np.nanmax(metres) < 1e-9
    assert np.nanmax(radians) < 1e-8
    assert (found.valid == found.exists).all()  # a whole turn is allowed to every joint
    # The angles themselves are among the branches; near a border they are as exact as a root is.
    misfit = np.nanmin(np.abs(turn_free(found.q - q[:, None])).max(axis=-1), axis=1)
    assert np.median(misfit) < 1e-8


def other_solver(robot):
    opw = pytest.importorskip("py_opw_kinematics", reason="py-opw-kinematics is not installed")
    a = robot.lengths
    model = opw.KinematicModel(
        a1=a.a1, a2=a.a2, b=a.b, c1=a.c1, c2=a.c2, c3=a.c3, c4=a.c4,
        offsets=tuple(j.offset for j in robot.joints),
        flip_axes=tuple(j.sign < 0 for j in robot.joints),
    )  # fmt: skip
    return opw.Robot(model, degrees=False)


def agree(robot, poses):
    """Whether another solver has the same branches in the same slots, whole turns aside."""
    from scipy.spatial.transform import RigidTransform

    limits = np.stack([robot.lower, robot.upper], axis=1)
    theirs = other_solver(robot).reach(RigidTransform.from_matrix(poses), joint_limits=limits).joints
    ours = robot.inverse(poses)
    both = ~np.isnan(theirs[..., 0]) & ours.exists
    same = (~np.isnan(theirs[..., 0]) == ours.exists).all()
    return same, np.abs(turn_free(theirs - ours.q))[both]


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda r: r.name)
def test_every_branch_of_another_solver_is_found(robot):
    same, misfit = agree(robot, robot.forward(random_joints(5_000, 12, robot=robot)))
    assert same
    assert misfit.max() < 1e-7


@settings(deadline=None, max_examples=60)
@given(ARMS, st.integers(0, 1000))
def test_every_branch_of_another_solver_is_found_for_any_arm(robot, seed):
    # Away from the borders, where rounding decides what exists and roots are inexact.
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (20, 6))
    model = robot._model(q)
    psi = np.arctan2(robot.lengths.a2, robot.lengths.c3)
    poses = robot.forward(q)
    clear = (np.abs(np.sin(model[:, 4])) > 0.05) & (np.abs(np.sin(model[:, 2] + psi)) > 0.05)
    centre = poses[:, :2, 3] - robot.lengths.c4 * poses[:, :2, 2]
    clear &= np.abs(np.linalg.norm(centre, axis=1) - abs(robot.lengths.b)) > 0.05
    if not clear.any():
        return
    ours = robot.inverse(poses[clear])
    _, misfit = agree(robot, poses[clear])
    assert ours.exists.sum() > 0
    assert np.quantile(misfit, 0.9) < 1e-7


@settings(deadline=None, max_examples=60)
@given(ARMS, st.floats(-3.0, 3.0), st.integers(0, 1000))
def test_limits_anywhere_are_kept_by_poses_and_paths(robot, low, seed):
    """A window of 3.5 rad that begins anywhere, whole turns beyond the model's own angles too."""
    high = low + 3.5
    robot = arm(robot.lengths, [j.sign for j in robot.joints], [j.offset for j in robot.joints], low, high)
    rng = np.random.default_rng(seed)
    q = rng.uniform(low + 0.3, high - 0.3, (10, 6))
    found = robot.inverse(robot.forward(q))
    inside = ((found.q >= low - 1e-9) & (found.q <= high + 1e-9)).all(axis=-1)
    np.testing.assert_array_equal(found.valid, found.exists & inside)
    for start in q[:4]:
        line = start + np.linspace(0, 1, 12)[:, None] * rng.uniform(-0.25, 0.25, 6)
        for branch in robot.continuous_branches(robot.forward(line)).q:
            assert branch.min() >= low - 1e-9
            assert branch.max() <= high + 1e-9
            np.testing.assert_allclose(robot.forward(branch), robot.forward(line), atol=1e-9)


def test_paths_of_the_second_arm_are_found_whatever_its_zeros_and_directions():
    rng = np.random.default_rng(7)
    tried = 0
    for start in random_joints(80, 7, margin=0.4, robot=KR10):
        line = start + np.linspace(0, 1, 20)[:, None] * rng.uniform(-0.35, 0.35, 6)
        model = KR10._model(line)
        psi = np.arctan2(KR10.lengths.a2, KR10.lengths.c3)
        if min(np.abs(np.sin(model[:, 4])).min(), np.abs(np.sin(model[:, 2] + psi)).min()) < 0.1:
            continue
        ahead = KR10.lengths.a1 + KR10.lengths.c2 * np.sin(model[:, 1])
        forearm = np.hypot(KR10.lengths.a2, KR10.lengths.c3)
        ahead += forearm * np.sin(model[:, 1] + model[:, 2] + psi)
        if np.abs(ahead).min() < 0.1:
            continue
        found = KR10.continuous_branches(KR10.forward(line))
        assert np.abs(turn_free(found.q - line)).max(axis=(1, 2)).min() < 1e-7
        tried += 1
    assert tried > 20


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda r: r.name)
def test_a_turn_of_the_pose_about_the_base_turns_joint_1_alone(robot):
    poses = robot.forward(random_joints(300, 6, robot=robot))
    before, after = robot.inverse(poses), robot.inverse(turned((0, 0, 1), 1.234) @ poses)
    change = turn_free(after.q - before.q)[before.exists]
    np.testing.assert_array_equal(before.exists, after.exists)
    np.testing.assert_allclose(change[:, 1:], 0, atol=1e-7)
    np.testing.assert_allclose(turn_free(change[:, 0] - robot.joints[0].sign * 1.234), 0, atol=1e-8)
