"""The second engine against mechanics: rest, friction, rolling, tipping."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
import pytest

pytest.importorskip(
    "mujoco", reason="the second engine is not installed (pip install 'robotpack[second-engine]')"
)

from experiments.mujoco_pile import MujocoConfig, MujocoPile
from packenv.config import GRAVITY
from packenv.sim.rest import RestRule, settle
from packenv.sim.world import World
from tests.sim.bodies import BOX, ball, brick

CONFIG = MujocoConfig()


def tilted(angle: float) -> tuple[float, float, float]:
    """Gravity as on a slope that falls along +x."""
    return (GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle))


def run(pile: MujocoPile, seconds: float) -> None:
    for _ in range(round(seconds / CONFIG.time_step)):
        pile.step()


def along(pile: MujocoPile, seconds: float, k: int = 0) -> float:
    """How far an item moves along x."""
    before = pile.pose(k)[1][0]
    run(pile, seconds)
    return float(pile.pose(k)[1][0] - before)


def angle(rotation: np.ndarray) -> float:
    return math.acos(min(1.0, (float(np.trace(rotation)) - 1.0) / 2.0))


def test_a_dropped_box_rests_where_it_was_dropped() -> None:
    pile = MujocoPile(BOX, [brick()])
    assert pile.release(np.eye(3), np.array([0.1, 0.1, 0.01])) == ()
    settled = settle(cast(World, pile), 5.0, RestRule())
    rotation, position = pile.pose(0)
    assert settled.at_rest
    # A fall of a centimetre, of which the last bit may be within the rule's travel, and the rule's time.
    assert settled.seconds > 0.9 * math.sqrt(2 * 0.01 / GRAVITY) + RestRule().time
    assert np.abs(position - [0.1, 0.1, 0.0]).max() < 5e-4
    assert angle(rotation) < math.radians(1.0)


def test_a_pile_at_rest_neither_creeps_nor_sinks() -> None:
    pile = MujocoPile(BOX, [brick(), brick()], gravity=tilted(math.radians(20.0)))
    for z in (0.0, 0.05):
        pile.release(np.eye(3), np.array([0.05, 0.1, z]))
    run(pile, 0.5)
    before = [pile.pose(k)[1] for k in (0, 1)]
    run(pile, 10.0)
    for k in (0, 1):
        assert np.linalg.norm(pile.pose(k)[1] - before[k]) < 5e-5
        assert all(meeting.depth < 1e-4 for meeting in pile.meetings(k))


@pytest.mark.parametrize(("degrees", "slides"), [(30.0, False), (34.0, False), (36.0, True), (45.0, True)])
def test_a_box_slides_where_the_slope_is_steeper_than_friction(degrees: float, slides: bool) -> None:
    slope = math.radians(degrees)
    pile = MujocoPile(BOX, [brick(0.08, 0.08, 0.02)], gravity=tilted(slope))
    pile.release(np.eye(3), np.array([0.02, 0.1, 0.0]))
    seconds = 0.15
    # What the second stretch is longer than the first owes nothing to how the box began.
    first, second = along(pile, seconds), along(pile, seconds)
    pull = GRAVITY * (math.sin(slope) - CONFIG.mu * math.cos(slope)) if slides else 0.0
    assert second - first == pytest.approx(pull * seconds**2, rel=0.02, abs=1e-4)
    assert (first > 1e-3) == slides


def test_a_ball_rolls_nowhere_on_a_level_floor() -> None:
    pile = MujocoPile(BOX, [ball()])
    pile.release(np.eye(3), np.array([0.16, 0.16, 0.05]))
    run(pile, 5.0)
    assert np.abs(pile.pose(0)[1] - [0.16, 0.16, 0.04]).max() < 1e-4


@pytest.mark.parametrize("degrees", [0.4, 2.0, 5.0])
def test_a_ball_rolls_against_its_rolling_resistance(degrees: float) -> None:
    radius, slope, seconds = 0.04, math.radians(degrees), 0.6
    pile = MujocoPile(BOX, [ball(radius)], gravity=tilted(slope))
    pile.release(np.eye(3), np.array([0.05, 0.16, radius]))
    pull = math.sin(slope) - CONFIG.rolling / radius * math.cos(slope)
    expected = 0.5 * max(pull, 0.0) * GRAVITY * 5.0 / 7.0 * seconds**2
    assert along(pile, seconds) == pytest.approx(expected, rel=0.05, abs=2e-4)


@pytest.mark.parametrize(("over", "falls"), [(0.45, False), (0.55, True)])
def test_an_item_tips_where_its_centre_of_mass_is_beyond_the_edge(over: float, falls: bool) -> None:
    pile = MujocoPile(BOX, [brick(), brick()])
    pile.release(np.eye(3), np.array([0.05, 0.1, 0.0]))
    pile.release(np.eye(3), np.array([0.05 + 0.1 * over, 0.1, 0.05]))
    run(pile, 2.0)
    assert (angle(pile.pose(1)[0]) > math.radians(10.0)) == falls


def test_items_wait_unmoved_and_unfelt() -> None:
    alone, first = (MujocoPile(BOX, [brick()] * n) for n in (1, 4))
    waiting = [first.pose(k)[1] for k in (1, 2, 3)]
    for pile in (alone, first):
        pile.release(np.eye(3), np.array([0.1, 0.1, 0.01]))
        run(pile, 1.0)
    assert alone.items == first.items == (0,)
    assert np.abs(alone.pose(0)[1] - first.pose(0)[1]).max() < 1e-6
    assert np.abs(np.array([first.pose(k)[1] for k in (1, 2, 3)]) - waiting).max() == 0.0


def test_a_release_tells_what_it_meets_and_how_deep() -> None:
    pile = MujocoPile(BOX, [brick()] * 3)
    pile.release(np.eye(3), np.array([0.1, 0.1, 0.001]))
    into_item = pile.release(np.eye(3), np.array([0.1, 0.1, 0.048]))
    assert {m.other for m in into_item} == {0}
    assert max(m.depth for m in into_item) == pytest.approx(0.003, abs=1e-4)
    into_wall = pile.release(np.eye(3), np.array([-0.004, 0.1, 0.2]))
    assert {m.other for m in into_wall} == {-1}
    assert max(m.depth for m in into_wall) == pytest.approx(0.004, abs=1e-4)
