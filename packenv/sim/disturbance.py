"""A world that is not quite as planned: friction, masses, grasp and time step are off, by a seed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from packenv.geometry.transforms import yaw_rotation
from packenv.robot.cell import FRICTION
from packenv.sim.descent import PlacementTask
from packenv.sim.session import ExecutionConfig
from packenv.types import FloatArray, Pose


@dataclass(frozen=True)
class Disturbance:
    """How far a disturbed world may be off.

    Everything is drawn from ``seed`` and the number of the step alone, so that two plans of one order meet
    the same luck.

    Attributes:
        seed: of all draws.
        mu: range of the friction coefficient, even, where the nominal one is 0.7; else in proportion, as of items
            that have their own.
        mass: largest relative error of a mass, even.
        offset: standard deviation of where an item hangs in the cup, along x and along y, m.
        yaw: standard deviation of how it is turned there, rad.
        pace: time step of the disturbed world over that of the nominal one.
    """

    seed: int
    mu: tuple[float, float] = (0.5, 0.9)
    mass: float = 0.1
    offset: float = 0.002
    yaw: float = math.radians(1.0)
    pace: float = 0.8

    def config(self, config: ExecutionConfig) -> ExecutionConfig:
        """The settings of the disturbed world."""
        mu = self._drawn() * (config.world.mu / FRICTION)
        engine = replace(config.world.engine, time_step=config.world.time_step * self.pace)
        return replace(config, world=replace(config.world, mu=mu, engine=engine))

    def task(self, task: PlacementTask, step: int) -> PlacementTask:
        """The task of a step (from 1) with another mass and another hold of the item."""
        rng = np.random.default_rng([self.seed, step])
        factor = 1.0 + float(rng.uniform(-self.mass, self.mass))
        away = rng.normal(0.0, self.offset, 2)
        turn = yaw_rotation(float(rng.normal(0.0, self.yaw)))
        item = task.item.heavier(factor)
        if item.friction is not None:
            item = replace(item, friction=item.friction * (self._drawn() / FRICTION))
        return replace(task, item=item, slip=_about(task, turn, away))

    def _drawn(self) -> float:
        return float(np.random.default_rng([self.seed, 0]).uniform(*self.mu))


def _about(task: PlacementTask, turn: FloatArray, away: FloatArray) -> FloatArray:
    """(4, 4) turn about the vertical through the planned centre of mass, and shift."""
    com = task.item.com_at(Pose(task.rotation, task.position))
    slip = np.eye(4)
    slip[:3, :3] = turn
    slip[:3, 3] = com - turn @ com
    slip[:2, 3] += away
    return slip
