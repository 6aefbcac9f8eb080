"""The world obeys mechanics: fall, friction, rolling, rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from packenv.config import GRAVITY
from packenv.sim.engines import engine_config
from packenv.sim.rest import RestRule, settle
from packenv.sim.world import World, WorldConfig
from packenv.types import Container
from tests.conftest import needs_bullet
from tests.sim.bodies import BOX, ball, brick

SKIN = {"bullet": 1e-4, "mujoco": 0.0}
"""Margin around a mesh, m."""
LONG = Container(1.8, 0.4, 0.3)


@pytest.fixture
def config(engine: str) -> WorldConfig:
    return WorldConfig(engine=engine_config(engine))


@contextmanager
def tilted(angle: float, config: WorldConfig) -> Iterator[World]:
    """A world whose floor slopes down along x, seen from the floor."""
    with World(LONG, config) as world:
        world.engine.gravity((GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle)))
        yield world


def run(world: World, seconds: float) -> None:
    for _ in range(round(seconds / world.time_step)):
        world.step()


def test_free_fall_is_half_g_t_squared_whatever_the_mass(config: WorldConfig) -> None:
    heights = []
    for factor in (1.0, 0.1, 20.0):
        with World(BOX, config) as world:
            body = world.add(brick().heavier(factor), np.eye(3), np.array([0.1, 0.1, 0.2]))
            run(world, 0.15)
            heights.append(world.pose(body)[1][2])
            t, dt = world.time, world.time_step
    # One step of semi-implicit integration is half a step ahead of the parabola.
    assert heights[0] == pytest.approx(0.2 - GRAVITY * t * (t + dt) / 2.0, abs=1e-6)
    assert abs(heights[0] - (0.2 - GRAVITY * t * t / 2.0)) <= GRAVITY * t * dt
    assert heights[1:] == pytest.approx([heights[0]] * 2, abs=1e-9)


def test_a_light_box_holds_a_heavy_ball_against_the_wall(config: WorldConfig) -> None:
    """The ball is wedged between the box's edge and a wall: too few iterations let both creep."""
    light = brick(0.14, 0.14, 0.16)
    radius = 0.55 * (BOX.length - 0.14)
    heavy = ball(radius)
    heavy = heavy.heavier(10.0 * light.mass / heavy.mass)
    with World(BOX, config) as world:
        box = world.add(light, np.eye(3), np.array([0.0, 0.1, 0.0]))
        wedged = world.add(heavy, np.eye(3), np.array([BOX.length - radius, 0.17, 0.16 + radius]))
        run(world, 3.0)
        at = world.pose(wedged)[1]
        run(world, 3.0)
        assert math.dist(world.pose(wedged)[1], at) < 5e-4
        # Contacts of MuJoCo give way a little; this one bears 16 kg.
        assert light.beyond(BOX, *world.pose(box)) < (1e-4 if config.engine.name == "bullet" else 5e-4)


@pytest.mark.parametrize(
    ("name", "more", "creep"),
    [
        pytest.param("bullet", {}, 1e-4, marks=needs_bullet),
        pytest.param("bullet", {"anchored": True}, 1e-5, marks=needs_bullet),
        pytest.param("bullet", {"residual": 0.0}, 1e-5, marks=needs_bullet),
        ("mujoco", {}, 1e-5),
    ],
)
def test_a_box_at_rest_stays(name: str, more: dict[str, Any], creep: float) -> None:
    """At rest surfaces are a skin apart for every mesh in a contact: one at the floor, two between boxes."""
    heights = np.array([0.0, 0.05]) + SKIN[name] * np.array([1.0, 3.0])
    with World(BOX, WorldConfig(engine=replace(engine_config(name), **more))) as world:
        lower = world.add(brick(), np.eye(3), np.array([0.1, 0.1, heights[0]]))
        upper = world.add(brick(0.06, 0.06, 0.06), np.eye(3), np.array([0.12, 0.11, heights[1]]))
        before = {body: world.pose(body) for body in (lower, upper)}
        run(world, 5.0)
        for body, (rotation, position) in before.items():
            now = world.pose(body)
            assert np.abs(now[1] - position)[:2].max() <= creep
            assert abs(now[1] - position)[2] <= 5e-5
            assert np.abs(now[0] - rotation).max() <= 1e-3


@pytest.mark.parametrize(
    ("name", "more"),
    [
        pytest.param("bullet", {}, marks=needs_bullet),
        pytest.param("bullet", {"anchored": True}, marks=needs_bullet),
        ("mujoco", {}),
    ],
)
@pytest.mark.parametrize("mu", [0.3, 0.7])
def test_a_box_slides_where_the_slope_exceeds_friction(mu: float, name: str, more: dict[str, Any]) -> None:
    moved = []
    for share in (0.92, 1.08):
        angle = math.atan(share * mu)
        with tilted(angle, WorldConfig(mu=mu, engine=replace(engine_config(name), **more))) as world:
            body = world.add(brick(0.12, 0.1, 0.03), np.eye(3), np.array([0.2, 0.15, 0.0]))
            run(world, 1.0)
            moved.append(world.pose(body)[1][0] - 0.2)
    assert abs(moved[0]) < 5e-4
    expected = 0.5 * GRAVITY * (math.sin(angle) - mu * math.cos(angle))
    assert moved[1] == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("rolling", [0.0, 0.0005])
def test_a_ball_rolls_as_a_solid_ball_does(rolling: float, engine: str) -> None:
    angle, radius = math.radians(4.0), 0.04
    with tilted(angle, WorldConfig(rolling=rolling, engine=engine_config(engine))) as world:
        item = ball(radius)
        body = world.add(item, np.eye(3), np.array([0.1, 0.2, radius]))
        run(world, 1.0)
        now = world.pose(body)[1]
    factor = 1.0 / (1.0 + item.moments.mean() / (item.mass * radius**2))
    assert factor == pytest.approx(5.0 / 7.0, rel=0.02)
    expected = 0.5 * GRAVITY * factor * (math.sin(angle) - math.cos(angle) * rolling / radius)
    assert now[0] - 0.1 == pytest.approx(expected, rel=0.03)
    assert abs(now[1] - 0.2) < 1e-4


def energy(world: World, body: int) -> float:
    """Kinetic and potential energy, J."""
    item = world.item_of(body)
    assert item is not None
    speed, angular = world.engine.velocity(body)
    rotation, position = world.pose(body)
    height = (rotation @ item.com + position)[2]
    spin = (rotation @ item.axes).T @ angular
    return float(item.mass * (0.5 * speed @ speed + GRAVITY * height) + 0.5 * item.moments @ spin**2)


def test_energy_never_exceeds_that_at_the_start_and_never_grows_at_rest(config: WorldConfig) -> None:
    turn = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    with World(BOX, config) as world:
        body = world.add(brick(), turn, np.array([0.1, 0.1, 0.12]))
        item = world.item_of(body)
        assert item is not None
        start = energy(world, body)
        tumbling = []
        for _ in range(round(1.5 / world.time_step)):
            world.step()
            tumbling.append(energy(world, body))
        resting = []
        for _ in range(round(2.0 / world.time_step)):
            world.step()
            resting.append(energy(world, body))
    weight = item.mass * GRAVITY
    assert max(tumbling) <= start
    # 1 µm of height; flat on a side, its centre of mass is half a side high.
    assert max(resting) <= resting[0] + 1e-6 * weight
    assert min(abs(resting[-1] / weight - half) for half in (0.05, 0.04, 0.025)) < 3e-4


def test_settling_ends_at_rest_and_says_so(config: WorldConfig) -> None:
    with World(BOX, config) as world:
        body = world.add(brick(), np.eye(3), np.array([0.1, 0.1, 0.03]))
        ended = settle(world, 20.0, RestRule())
        assert ended.at_rest
        assert 0.1 < ended.seconds < 1.0
        assert world.pose(body)[1][2] == pytest.approx(0.0, abs=3e-4)
        world.move(body, np.eye(3), np.array([0.1, 0.1, 0.2]))
        assert not settle(world, 0.1, RestRule()).at_rest


def test_a_pose_comes_back_as_it_was_given(config: WorldConfig) -> None:
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    with World(BOX, config) as world:
        body = world.add(brick(), turn, np.array([0.1, 0.2, 0.15]))
        rotation, position = world.pose(body)
    assert np.abs(rotation - turn).max() < 1e-12
    assert np.abs(position - [0.1, 0.2, 0.15]).max() < 1e-12


def test_overlap_is_the_depth_of_the_geometry(config: WorldConfig) -> None:
    everywhere = np.array([[-1.0] * 3, [1.0] * 3])
    with World(BOX, config) as world:
        a = world.add(brick(), np.eye(3), np.array([0.1, 0.1, 0.0]))
        b = world.add(brick(), np.eye(3), np.array([0.1, 0.1, 0.047]))
        world.ghost(b)
        depths = [touch.depth for touch in world.overlaps(b, everywhere) if touch.other == a]
        assert max(depths) == pytest.approx(0.003, abs=3e-4)  # both skins
        world.move(b, np.eye(3), np.array([0.1, 0.1, 0.06]))
        assert not [touch for touch in world.overlaps(b, everywhere) if touch.other == a]


def test_an_item_lowered_past_an_edge_is_not_thrown_back_when_it_is_let_go(config: WorldConfig) -> None:
    # Bullet carries a contact on along the normal with which it began: centimetres of depth past the edge.
    beside = brick()
    low, high = beside.bounds(np.eye(3), np.zeros(3))
    width = float(high[0] - low[0])
    with World(BOX, config) as world:
        world.add(beside, np.eye(3), np.array([0.1, 0.1, 0.0]))
        held = world.add(beside, np.eye(3), np.array([0.1 + width, 0.1, 0.2]))
        world.ghost(held)
        for z in np.linspace(0.2, 0.0, 100):
            world.move(held, np.eye(3), np.array([0.1 + width, 0.1, z]))
            world.pause()
        world.solid(held)
        for _ in range(120):
            world.step()
        assert world.pose(held)[1] == pytest.approx([0.1 + width, 0.1, 0.0], abs=1e-3)
