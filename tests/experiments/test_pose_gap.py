"""How far apart two poses are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from packenv.experiments.pose_gap import pose_gap
from packenv.geometry.transforms import yaw_rotation
from packenv.sim.world import World
from packenv.types import Pose
from tests.sim.bodies import BOX, ball, brick

HOME: Pose = (np.eye(3), np.array([0.1, 0.1, 0.0]))
shifts = st.tuples(*[st.floats(-0.1, 0.1)] * 3)


@given(shifts)
def test_a_shift_moves_every_point_by_its_length(shift: tuple[float, float, float]) -> None:
    moved = (HOME[0], HOME[1] + shift)
    for item in (brick(), ball()):
        assert pose_gap(item, HOME, moved) == pytest.approx(math.hypot(*shift), abs=1e-12)


@given(st.floats(-3.0, 3.0), shifts)
def test_both_ways_it_is_the_same(yaw: float, shift: tuple[float, float, float]) -> None:
    moved = (yaw_rotation(yaw), HOME[1] + shift)
    there, back = pose_gap(brick(), HOME, moved), pose_gap(brick(), moved, HOME)
    assert there == pytest.approx(back, abs=1e-12)
    assert pose_gap(brick(), moved, moved) == 0.0


@pytest.mark.parametrize("yaw", [0.01, 0.5, math.pi])
def test_the_farthest_corner_counts(yaw: float) -> None:
    # About the corner at the mesh's origin, the opposite one swings on the diagonal of the base.
    moved = (yaw_rotation(yaw), HOME[1])
    chord = 2.0 * math.sin(yaw / 2.0) * math.hypot(0.1, 0.08)
    assert pose_gap(brick(), HOME, moved) == pytest.approx(chord, abs=1e-12)


def test_a_ball_may_turn() -> None:
    assert pose_gap(ball(), HOME, (yaw_rotation(2.0), HOME[1])) < 1e-15


def test_it_is_no_more_than_the_bound_by_which_rest_is_judged() -> None:
    rng = np.random.default_rng(0)
    with World(BOX) as world:
        item = brick()
        body = world.add(item, *HOME)
        before = world.raw_pose(body)
        for _ in range(50):
            moved = (yaw_rotation(float(rng.normal(0, 0.5))), HOME[1] + rng.normal(0, 0.01, 3))
            world.move(body, *moved)
            assert pose_gap(item, HOME, moved) <= world.travel(body, *before) + 1e-9
