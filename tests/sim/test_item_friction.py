"""Friction of each item in physics: of two the lesser counts, or less where Bullet's product cannot be that."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from packenv.config import GRAVITY
from packenv.sim.disturbance import Disturbance
from packenv.sim.engines import engine_config
from packenv.sim.session import ExecutionConfig
from packenv.sim.world import World, WorldConfig
from packenv.types import Container
from tests.conftest import needs_bullet
from tests.sim.bodies import ball, brick, by_hand

LONG = Container(1.8, 0.4, 0.3)
NONE = None


def dynamics(world: World, body: int) -> tuple[float, ...]:
    import pybullet

    return pybullet.getDynamicsInfo(body, -1, physicsClientId=world.engine.client)


def rub(world: World, one: int, other: int) -> float:
    """What Bullet makes of two bodies' friction."""
    return math.prod(dynamics(world, body)[1] for body in (one, other))


def rolling(world: World, one: int, other: int) -> float:
    """What Bullet makes of two bodies' rolling resistance, a length in m."""
    from packenv.sim.bullet import SCALE

    a, b = (dynamics(world, body) for body in (one, other))
    return (a[6] * b[1] + b[6] * a[1]) / SCALE


def in_bullet(mu: float = 0.7) -> WorldConfig:
    return WorldConfig(mu=mu, engine=engine_config("bullet"))


def filled(world: World, *frictions: float | None) -> list[int]:
    """Bricks side by side."""
    return [
        world.add(replace(brick(), friction=mu), np.eye(3), np.array([0.05 + 0.2 * k, 0.1, 0.0]))
        for k, mu in enumerate(frictions)
    ]


@needs_bullet
def test_pairs_have_the_lesser_of_two_or_less() -> None:
    rng = np.random.default_rng(0)
    exact = 0
    for _ in range(40):
        mu = float(rng.uniform(0.1, 1.0))
        given = [None if rng.random() < 0.3 else float(rng.uniform(0.05, 1.2)) for _ in range(5)]
        meant = [mu if own is None else min(own, mu) for own in given]
        with World(LONG, in_bullet(mu)) as world:
            bodies = filled(world, *given)
            top = max(meant)
            for body, own in zip(bodies, meant, strict=True):
                assert rub(world, world.fixed[0], body) == pytest.approx(own, rel=1e-9)
                assert 0.5 <= rolling(world, world.fixed[0], body) / world.config.rolling <= 1.0 + 1e-9
            for i in range(5):
                for k in range(i):
                    found, least = rub(world, bodies[i], bodies[k]), min(meant[i], meant[k])
                    assert found == pytest.approx(meant[i] * meant[k] / top, rel=1e-9)
                    assert found <= least * (1.0 + 1e-9)
                    exact += found == pytest.approx(least, rel=1e-9)
    assert exact >= 100


@needs_bullet
def test_items_of_one_coefficient_have_it_among_each_other() -> None:
    with World(LONG, in_bullet()) as world:
        a, b, c = filled(world, 0.3, 0.3, 0.2)
        assert rub(world, a, b) == pytest.approx(0.3)
        assert rub(world, a, c) == pytest.approx(0.2)
        rough = world.add(brick(), np.eye(3), np.array([0.8, 0.1, 0.0]))
        assert rub(world, a, rough) == pytest.approx(0.3)
        assert rub(world, a, b) == pytest.approx(0.09 / 0.7)
        world.remove(rough)
        assert rub(world, a, b) == pytest.approx(0.3)
        assert rub(world, world.fixed[0], c) == pytest.approx(0.2)


@needs_bullet
def test_a_slippery_drop_lowers_what_is_above_it_alone() -> None:
    with World(LONG, in_bullet()) as world:
        a, b = filled(world, 0.1, None)
        world.rub(0.25)
        assert rub(world, world.fixed[0], a) == pytest.approx(0.1)
        assert rub(world, world.fixed[0], b) == rub(world, b, b) == pytest.approx(0.25)
        world.rub(None)
        assert rub(world, world.fixed[0], b) == pytest.approx(0.7)


@needs_bullet
def test_without_own_friction_every_body_has_what_it_had() -> None:
    with World(LONG, in_bullet()) as world:
        bodies = filled(world, None, None, 0.7)
        told = {dynamics(world, body)[1] for body in bodies}
        assert told == {math.sqrt(0.7)}


@pytest.mark.parametrize(("lower", "upper"), [(NONE, 0.3), (0.3, NONE), (0.3, 0.3), (0.9, 0.3)])
def test_a_box_slides_on_a_box_beyond_the_lesser_friction_angle(
    lower: float | None, upper: float | None, engine: str
) -> None:
    """The lower one leans on a wall of the tilted world, so the upper one alone can slide."""
    moved = []
    for share in (0.92, 1.08):
        angle = math.atan(share * 0.3)
        with World(LONG, WorldConfig(engine=engine_config(engine))) as world:
            world.engine.gravity((GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle)))
            plate = replace(brick(1.0, 0.2, 0.02), friction=lower)
            world.add(plate, np.eye(3), np.array([LONG.length - 1.0, 0.1, 0.0]))
            body = world.add(
                replace(brick(0.12, 0.1, 0.03), friction=upper), np.eye(3), np.array([0.9, 0.15, 0.02])
            )
            for _ in range(round(1.0 / world.time_step)):
                world.step()
            moved.append(world.pose(body)[1][0] - 0.9)
    assert abs(moved[0]) < 2e-3
    expected = 0.5 * GRAVITY * (math.sin(angle) - 0.3 * math.cos(angle))
    assert moved[1] == pytest.approx(expected, rel=0.15)


def test_a_disturbed_world_changes_own_friction_in_the_same_proportion() -> None:
    disturbance = Disturbance(seed=3)
    config = disturbance.config(ExecutionConfig())
    own = disturbance.task(by_hand(replace(ball(), friction=0.35), (0.1, 0.1, 0.0)), 1).item.friction
    assert own == pytest.approx(0.5 * config.world.mu)
    assert disturbance.task(by_hand(ball(), (0.1, 0.1, 0.0)), 1).item.friction is None
