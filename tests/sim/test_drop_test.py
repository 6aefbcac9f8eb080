"""Dropping an item on a pile: what counts as resting in place, and that the pile outlives failures."""

from __future__ import annotations

import numpy as np
import pytest

from packenv.sim.drop_test import Dropped, DropRule, DropTest, Lying, Release
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.world import WorldConfig
from tests.sim.bodies import BOX, ball, brick

pytestmark = pytest.mark.usefixtures("auto")

EXACT = Release()
SLAB = brick(0.1, 0.1, 0.05, "slab")


def dropped_on(
    pile: tuple[Lying, ...], item: PhysicsItem, corner: tuple[float, float, float], how: Release = EXACT
) -> Dropped:
    test = DropTest(BOX, WorldConfig())
    try:
        return test.drop(pile, item, np.eye(3), np.array(corner), how, DropRule())
    finally:
        test.close()


def lying(item: PhysicsItem, x: float, y: float, z: float) -> Lying:
    return Lying(item, (np.eye(3), np.array([x, y, z])))


def test_a_box_on_the_floor_rests_where_it_is_put() -> None:
    dropped = dropped_on((), brick(), (0.1, 0.1, 0.0))
    assert dropped.reason == ""
    assert dropped.shift_m < 3e-4
    assert abs(dropped.sink_m) < 3e-4
    assert dropped.turned_rad < 0.01
    assert [part.item.name for part in dropped.pile] == ["brick"]


@pytest.mark.parametrize(("beyond", "stays"), [(-0.02, True), (0.02, False)])
def test_a_box_over_an_edge_stays_as_long_as_its_middle_does(beyond: float, stays: bool) -> None:
    # The brick's middle is 0.05 from its corner; the slab ends at 0.2.
    pile = (lying(SLAB, 0.1, 0.1, 0.0),)
    dropped = dropped_on(pile, brick(), (0.15 + beyond, 0.1, 0.05))
    assert (dropped.reason == "") is stays


def test_a_ball_on_a_slope_does_not_stay() -> None:
    wedge = brick(0.2, 0.1, 0.02, "wedge")
    tilt = np.radians(12.0)
    turn = np.array([[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]])
    pile = (Lying(wedge, (turn, np.array([0.05, 0.1, 0.045]))),)
    test = DropTest(BOX, WorldConfig())
    dropped = test.drop(pile, ball(0.02), np.eye(3), np.array([0.14, 0.15, 0.085]), Release(), DropRule())
    test.close()
    assert dropped.reason != ""


def test_a_failed_drop_leaves_the_pile_as_it_was() -> None:
    pile = (lying(SLAB, 0.1, 0.1, 0.0),)
    test = DropTest(BOX, WorldConfig())
    failed = test.drop(pile, brick(), np.eye(3), np.array([0.18, 0.1, 0.05]), Release(), DropRule())
    assert failed.reason
    assert failed.pile is pile
    again = test.drop(pile, brick(), np.eye(3), np.array([0.1, 0.1, 0.05]), Release(), DropRule())
    test.close()
    assert again.reason == ""
    assert again.pile[0].pose[1] == pytest.approx([0.1, 0.1, 0.0], abs=5e-4)


def test_the_same_question_has_the_same_answer() -> None:
    pile = (lying(SLAB, 0.1, 0.1, 0.0),)
    answers = [dropped_on(pile, brick(), (0.12, 0.09, 0.05), Release(offset=(0.002, 0.0))) for _ in range(2)]
    assert np.array_equal(answers[0].pile[1].pose[1], answers[1].pile[1].pose[1])
    assert answers[0].seconds == answers[1].seconds


def test_an_error_of_the_release_is_where_the_item_ends() -> None:
    how = Release(offset=(0.004, -0.003), yaw=0.05)
    dropped = dropped_on((), brick(), (0.1, 0.1, 0.0), how)
    rotation, position = dropped.pile[0].pose
    middle = rotation @ brick().com + position
    assert middle[:2] == pytest.approx([0.154, 0.137], abs=4e-4)
    assert np.arctan2(rotation[1, 0], rotation[0, 0]) == pytest.approx(0.05, abs=0.01)
