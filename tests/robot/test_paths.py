"""Branches along a path: laws."""

import numpy as np
import pytest

from packenv.robot.motion import refine
from packenv.robot.protocol import MAX_STEP
from tests.robot.sampling import LOWER, TX90, UPPER, random_joints, turn_free


def smooth(start, end, count=40):
    return start + (end - start) * np.linspace(0, 1, count)[:, None]


def random_lines(count, seed):
    """Straight lines in joint space, no joint stepping by more than 0.05 rad."""
    starts = random_joints(count, seed, margin=0.05)
    moves = np.random.default_rng(seed + 1).uniform(-1.5, 1.5, starts.shape)
    ends = np.clip(starts + moves, LOWER + 0.05, UPPER - 0.05)
    return [smooth(a, b) for a, b in zip(starts, ends, strict=True)]


def meets_singularity(line):
    """Whether wrist, elbow or shoulder comes within 0.05 of its singularity, or passes it."""
    ahead = 0.05 + 0.425 * (np.sin(line[:, 1]) + np.sin(line[:, 1] + line[:, 2]))
    return any(v.min() < 0.05 and v.max() > -0.05 for v in (line[:, 4], line[:, 2], ahead))


def test_branches_meet_the_path_stay_in_the_limits_and_do_not_jump():
    followed = 0
    for line in random_lines(60, 1):
        path = TX90.forward(line)
        found = TX90.continuous_branches(path)
        followed += len(found)
        for q in found.q:
            np.testing.assert_allclose(TX90.forward(q), path, atol=1e-9)
            assert (q >= LOWER - 1e-9).all()
            assert (q <= UPPER + 1e-9).all()
            assert np.abs(np.diff(q, axis=0)).max() <= MAX_STEP
    assert followed > 60


def test_the_joints_that_made_a_path_are_found():
    tried = 0
    for line in random_lines(200, 3):
        if meets_singularity(line):
            continue  # there a branch has other continuations too
        found = TX90.continuous_branches(TX90.forward(line))
        misfit = np.abs(turn_free(found.q - line)).max(axis=(1, 2))
        assert misfit.min() < 1e-7
        tried += 1
    assert tried > 30


def test_a_path_backwards_has_the_same_branches():
    for line in random_lines(60, 5):
        if meets_singularity(line):
            continue
        path = TX90.forward(line)
        there = TX90.continuous_branches(path)
        back = TX90.continuous_branches(path[::-1])
        assert there.slots == back.slots
        np.testing.assert_allclose(back.q[:, ::-1], there.q, atol=1e-7)


def test_joint_6_is_unwrapped_past_half_a_turn():
    line = smooth(np.array([0.2, 0.5, 1.0, 0.3, 0.7, -4.5]), np.array([0.2, 0.5, 1.0, 0.3, 0.7, 4.5]), 80)
    found = TX90.continuous_branches(TX90.forward(line))
    assert np.abs(found.q - line).max(axis=(1, 2)).min() < 1e-9


def test_more_than_the_limits_of_joint_6_is_refused():
    line = smooth(np.array([0.2, 0.5, 1.0, 0.3, 0.7, -4.8]), np.array([0.2, 0.5, 1.0, 0.3, 0.7, 4.8]), 80)
    found = TX90.continuous_branches(TX90.forward(line))
    assert len(found) == 0
    assert found.beyond_limits > 0


def test_a_path_through_the_wrist_singularity_is_followed():
    start, end = np.array([0.2, 0.5, 1.0, 0.0, -0.4, 0.3]), np.array([0.2, 0.5, 1.0, 0.0, 0.4, 0.3])
    for count in (21, 20):  # with and without a pose in the singularity itself
        line = smooth(start, end, count)
        found = TX90.continuous_branches(TX90.forward(line))
        assert np.abs(turn_free(found.q - line)).max(axis=(1, 2)).min() < 1e-7


@pytest.mark.parametrize("backwards", [False, True])
def test_a_path_may_begin_or_end_in_the_wrist_singularity(backwards):
    line = smooth(np.array([0.2, 0.5, 1.0, 0.9, 0.0, 0.3]), np.array([0.2, 0.5, 1.0, 0.9, 0.8, 0.3]))
    line = line[::-1] if backwards else line
    found = TX90.continuous_branches(TX90.forward(line))
    assert np.abs(turn_free(found.q - line)).max(axis=(1, 2)).min() < 1e-7


def test_a_jump_is_refused():
    line = np.array([[0.2, 0.5, 1.0, 0.3, 0.7, 0.0], [1.2, 0.5, 1.0, 0.3, 0.7, 0.0]])
    assert TX90.continuous_branch(TX90.forward(line)) is None
    assert TX90.continuous_branch(TX90.forward(line), max_step=1.01) is not None


def test_one_unreachable_pose_ends_every_branch():
    path = TX90.forward(
        smooth(np.array([0.2, 0.5, 1.0, 0.3, 0.7, 0.0]), np.array([0.4, 0.6, 1.1, 0.3, 0.7, 0.0]))
    )
    assert len(TX90.continuous_branches(path)) > 0
    path[-1, :3, 3] += 3.0
    assert len(TX90.continuous_branches(path)) == 0


def test_one_pose_is_a_path():
    path = TX90.forward(random_joints(1, 8))
    assert len(TX90.continuous_branches(path)) == TX90.inverse(path).valid.sum()


def test_the_chosen_branch_has_the_largest_margin():
    for line in random_lines(20, 9):
        path = TX90.forward(line)
        found = TX90.continuous_branches(path)
        chosen = TX90.continuous_branch(path)
        if chosen is None:
            assert len(found) == 0
        else:
            margins = [TX90.limit_margin(q).min() for q in found.q]
            assert TX90.limit_margin(chosen).min() == max(margins)


def test_an_empty_path_is_refused():
    with pytest.raises(ValueError, match="empty"):
        TX90.continuous_branches(np.empty((0, 4, 4)))


def straight_down():
    """(6, 4, 4) flange poses from a posture whose fourth joint stands at half a turn, 10 cm straight down."""
    top = TX90.forward(np.array([-2.792, -0.339, -2.2068, np.pi, 0.5958, -2.792]))
    path = np.repeat(top[None], 6, axis=0)
    path[:, 2, 3] -= np.linspace(0.0, 0.1, 6)
    return path


@pytest.mark.parametrize("turn", [0.0, 2.0 * np.pi, -2.0 * np.pi])
def test_waypoints_are_filled_up_whatever_turn_a_joint_is_given_in(turn):
    """Half a turn and minus half a turn are one posture; which one inverse kinematics finds is chance."""
    branches = TX90.continuous_branches(straight_down()).q
    half = branches[np.abs(np.abs(branches[:, 0, 3]) - np.pi) < 1e-9]
    assert len(half)
    for found in half:
        given = found.copy()
        given[:, 3] += turn
        if TX90.limit_margin(given).min() < 0.0:
            with pytest.raises(ValueError, match="do not lie on one branch"):
                refine(TX90, given)
            continue
        fine = refine(TX90, given)
        assert len(fine) > len(given)
        for waypoint in given:
            assert np.abs(fine - waypoint).max(axis=1).min() < 1e-6
        assert np.abs(np.diff(fine, axis=0)).max() < 0.05
        assert TX90.limit_margin(fine).min() >= 0.0
