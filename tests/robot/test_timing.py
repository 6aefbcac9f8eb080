"""The laws of a motion: rest at both ends, every limit, and derivatives that are derivatives."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from packenv.errors import InputError
from packenv.robot.timing import STEP, Motion, MotionLimits, timed

SPEEDS = np.array([7.0, 6.0, 5.0, 4.0, 3.0, 2.0])


def wave(seed: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    """(80, 6) joints and (80, 3) tips along a smooth path that bends."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, 80)[:, None]
    joints, tips = (
        size * (rng.normal(size=n) * s + 0.3 * rng.normal(size=n) * np.sin(4.0 * s + rng.normal(size=n)))
        for n in (6, 3)
    )
    return joints, tips


motions = {"seed": st.integers(0, 10**6), "size": st.floats(1e-3, 3.0), "empty": st.booleans()}


@settings(deadline=None, max_examples=60)
@given(**motions, share=st.floats(0.05, 1.0), ramp=st.floats(0.05, 1.0))
def test_every_limit_holds_at_every_time(seed, size, empty, share, ramp):
    joints, tips = wave(seed, size)
    limits = MotionLimits(share=share, ramp=ramp)
    motion = timed(joints, tips, SPEEDS, limits, empty=empty)
    assert (np.abs(motion.velocities) <= limits.joint_speeds(SPEEDS) * (1 + 1e-9)).all()
    assert (np.abs(motion.accelerations) <= limits.joint_accelerations(SPEEDS) * (1 + 1e-9)).all()
    steps = np.diff(motion.positions, axis=0) / np.diff(motion.times)[:, None]
    assert (np.abs(steps) <= limits.joint_speeds(SPEEDS) * (1 + 1e-9)).all()


@settings(deadline=None, max_examples=40)
@given(**motions)
def test_it_leads_from_end_to_end_from_rest_to_rest(seed, size, empty):
    joints, tips = wave(seed, size)
    motion = timed(joints, tips, SPEEDS, MotionLimits(), empty=empty)
    np.testing.assert_array_equal(motion.positions[[0, -1]], joints[[0, -1]])
    assert np.abs(motion.velocities[[0, -1]]).max() < 1e-9
    assert np.abs(motion.accelerations[[0, -1]]).max() < 1e-6
    assert motion.times[0] == 0.0
    assert 0.0 < np.diff(motion.times).min() <= np.diff(motion.times).max() <= STEP + 1e-12


@settings(deadline=None, max_examples=40)
@given(**motions)
def test_velocity_and_acceleration_are_the_derivatives(seed, size, empty):
    """The quintic of positions, velocities and accelerations at both ends is what a controller plays."""
    motion = timed(*wave(seed, size), SPEEDS, MotionLimits(), empty=empty)
    h = np.diff(motion.times)[:, None]
    mean_v = (motion.velocities[1:] + motion.velocities[:-1]) / 2.0
    change = (motion.accelerations[1:] - motion.accelerations[:-1]) / 12.0
    got = np.diff(motion.positions, axis=0) / h
    # The corrected trapezoid rule is exact to the fourth order.
    scale = np.abs(motion.velocities).max() + 1e-9
    np.testing.assert_allclose(got, mean_v - h * change, atol=2e-3 * scale)
    got = np.diff(motion.velocities, axis=0) / h
    mean_a = (motion.accelerations[1:] + motion.accelerations[:-1]) / 2.0
    np.testing.assert_allclose(got, mean_a, atol=0.05 * (np.abs(motion.accelerations).max() + 1e-9))


def test_the_tool_keeps_its_limits_and_the_empty_one_may_be_faster():
    tips = np.column_stack([np.linspace(0.0, 1.0, 40), np.zeros(40), np.zeros(40)])
    joints = 0.01 * tips[:, [0, 0, 0, 1, 1, 1]]
    limits = MotionLimits(speed=0.4, acceleration=1.5, empty=1.5)
    for empty, factor in ((False, 1.0), (True, 1.5)):
        motion = timed(joints, tips, SPEEDS, limits, empty=empty)
        along = motion.velocities[:, 0] / 0.01, motion.accelerations[:, 0] / 0.01
        assert along[0].max() <= 0.4 * factor
        assert np.abs(along[1]).max() <= 1.5 * factor
        # One of the two is used up: nothing is given away on a straight way.
        assert max(along[0].max() / 0.4, np.abs(along[1]).max() / 1.5) > 0.97 * factor


def test_higher_limits_never_take_longer():
    joints, tips = wave(3, 1.0)

    def duration(**words: float) -> float:
        return timed(joints, tips, SPEEDS, MotionLimits(**words)).duration

    for name, low, high in (("share", 0.2, 0.9), ("speed", 0.1, 1.0), ("acceleration", 0.5, 5.0)):
        assert duration(**{name: high}) <= duration(**{name: low})
    assert duration(full_speed_in=0.1) <= duration(full_speed_in=1.0)


def test_straight_lines_between_points_stay_near_the_path():
    """Of a tool whose joints are its coordinates: an error of acceleration · STEP² / 8."""
    _, tips = wave(5, 0.4)
    six_tips = np.concatenate([tips, np.zeros((80, 3))], axis=1)
    limits = MotionLimits()
    motion = timed(six_tips, tips, SPEEDS, limits, empty=True)
    fine = np.linspace(0.0, motion.duration, 20001)
    line = np.column_stack([np.interp(fine, motion.times, c) for c in motion.positions.T])[:, :3]
    nearest = np.array([np.linalg.norm(_segments(six_tips[:, :3], p), axis=1).min() for p in line[::40]])
    assert nearest.max() < 0.5e-3


def _segments(path: np.ndarray, point: np.ndarray) -> np.ndarray:
    """From a point to the nearest point of each straight part of a path."""
    start, along = path[:-1], np.diff(path, axis=0)
    share = np.clip(((point - start) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    return start + share[:, None] * along - point


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ({"share": 0.0}, "share is 0"),
        ({"share": 1.5}, "at most 1"),
        ({"speed": -1.0}, "speed is -1"),
        ({"ramp": float("nan")}, "ramp is nan"),
        ({"acceleration": "much"}, "acceleration is 'much'"),
        ({"empty": True}, "empty is True"),
    ],
)
def test_wrong_limits_are_told(words, told):
    with pytest.raises(InputError, match=told):
        MotionLimits(**words)


def test_the_duration_is_the_last_time():
    zeros = np.zeros((2, 6))
    assert Motion(np.array([0.0, 1.5]), zeros, zeros, zeros).duration == 1.5
