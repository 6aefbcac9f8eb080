"""Drop an item on a pile and see whether it comes to rest where it was meant to be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from packenv.geometry.transforms import angle_between, yaw_rotation
from packenv.robot.cell import RELEASE_HEIGHT
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.rest import RestRule, RestWatch
from packenv.sim.world import World, WorldConfig
from packenv.types import Container, FloatArray, Pose


@dataclass(frozen=True)
class DropRule:
    """How far items may move in a drop, at any time of it.

    Attributes:
        name: a word for plans.
        shift: of the new item's centre of mass from where it was released, horizontally, m.
        sink: of the same below its planned height, m; half as much above it counts as not seated.
        turn: of the new item from how it was released, rad; of balls nothing is asked.
        nudge: of the centre of mass of any item placed before, from where it lay, m.
        settle: longest time for settling, s.
        inside: whether the item must end inside the container.
        restless: whether an item that still moves then may stay.
        rest: when the world counts as at rest.
    """

    name: str = "strict"
    shift: float = 0.008
    sink: float = 0.008
    turn: float = math.radians(12.0)
    nudge: float = 0.004
    settle: float = 2.0
    inside: bool = True
    restless: bool = False
    rest: RestRule = field(default_factory=RestRule)


@dataclass(frozen=True)
class Release:
    """How an item is let go.

    Attributes:
        height: above its planned place, m.
        offset: (x, y) from its planned place, m.
        yaw: about the vertical through its centre of mass, rad.
        pace: time step of the drop over that of the world.
        mu: most friction of the drop; None takes the world's.
    """

    height: float = RELEASE_HEIGHT
    offset: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0
    pace: float = 1.0
    mu: float | None = None


@dataclass(frozen=True, eq=False)
class Lying:
    """An item of the pile: what and where."""

    item: PhysicsItem
    pose: Pose


@dataclass(frozen=True, eq=False)
class Dropped:
    """How a drop went.

    Attributes:
        reason: why the item did not come to rest in place, a word; "" where it did.
        pile: the pile with the item as it came to rest; the one before where it did not.
        shift_m: horizontal distance of the item's centre of mass from its release.
        sink_m: how far it came to rest below its planned height, m.
        turned_rad: from how it was released.
        seconds: simulated.
    """

    reason: str
    pile: tuple[Lying, ...]
    shift_m: float
    sink_m: float
    turned_rad: float
    seconds: float


class DropTest:
    """A scratch world for drops. Close it when done.

    The world is kept from drop to drop: its items are put where the pile has them. So the same questions in
    the same sequence have the same answers.
    """

    def __init__(self, container: Container, config: WorldConfig) -> None:
        """Build floor and walls."""
        self._world = World(container, config)
        self._bodies: list[tuple[PhysicsItem, int]] = []
        self._shows: tuple[Lying, ...] | None = None

    def close(self) -> None:
        """Free the engine's memory."""
        self._world.close()

    def drop(
        self,
        pile: tuple[Lying, ...],
        item: PhysicsItem,
        rotation: FloatArray,
        position: FloatArray,
        how: Release,
        rule: DropRule,
    ) -> Dropped:
        """Release an item over its planned pose.

        Args:
            pile: what lies in the container.
            item: the item.
            rotation: (3, 3) mesh frame to container frame, planned.
            position: (3,) planned, m.
            how: height and error of the release.
            rule: what counts as resting in place.
        """
        world = self._world
        self._lay(pile)
        com = item.com_at(Pose(rotation, position))
        turn = yaw_rotation(how.yaw)
        release = com + np.array([*how.offset, how.height])
        start = Pose(turn @ rotation, release - turn @ rotation @ item.com)
        world.sleep()
        world.pace(how.pace)
        world.rub(None if how.mu is None else min(how.mu, world.config.mu))
        body = world.add(item, *start)
        reason, seconds = self._watch(pile, item, body, start, float(com[2]), rule)
        now = world.pose(body)
        landed = item.com_at(now)
        after = pile
        if not reason:
            self._bodies.append((item, body))
            poses = [world.pose(b) for _, b in self._bodies]
            after = tuple(Lying(i, p) for (i, _), p in zip(self._bodies, poses, strict=True))
            self._shows = after
        else:
            world.remove(body)
            self._shows = None
        return Dropped(
            reason,
            after,
            float(np.hypot(*(landed - release)[:2])),
            float(com[2] - landed[2]),
            angle_between(start[0], now[0]),
            seconds,
        )

    def _watch(
        self, pile: Sequence[Lying], item: PhysicsItem, body: int, start: Pose, height: float, rule: DropRule
    ) -> tuple[str, float]:
        """Step until something has gone wrong or everything is at rest."""
        world = self._world
        release = item.com_at(start)
        began, calm = world.time, RestWatch(world, rule.rest)
        for k in range(round(rule.settle / world.time_step)):
            world.step()
            at_rest = calm.calm()
            if k % _EVERY and not at_rest:
                continue
            now = world.pose(body)
            com = item.com_at(now)
            reason = ""
            if np.hypot(*(com - release)[:2]) > rule.shift:
                reason = "shifts"
            elif com[2] < height - rule.sink:
                reason = "sinks"
            elif not item.radius and angle_between(start[0], now[0]) > rule.turn:
                reason = "turns"
            elif self._nudge(pile) > rule.nudge:
                reason = "nudges-pile"
            elif at_rest and com[2] > height + rule.sink / 2.0:
                reason = "sits-high"
            elif at_rest and rule.inside and not self._inside(item, now):
                reason = "sticks-out"
            if reason or at_rest:
                return reason, world.time - began
        if rule.restless:
            gone = rule.inside and not self._inside(item, world.pose(body))
            return "sticks-out" if gone else "", world.time - began
        return "restless", world.time - began

    def _inside(self, item: PhysicsItem, pose: Pose) -> bool:
        return item.beyond(self._world.container, *pose) < _SEATED

    def _nudge(self, pile: Sequence[Lying]) -> float:
        moved = 0.0
        for lying, (item, body) in zip(pile, self._bodies, strict=True):
            way = item.com_at(self._world.pose(body)) - item.com_at(lying.pose)
            moved = max(moved, float(np.linalg.norm(way)))
        return moved

    def _lay(self, pile: tuple[Lying, ...]) -> None:
        """Make the world hold just this pile, at rest."""
        if self._shows is pile:
            return
        same = 0
        for lying, (item, _) in zip(pile, self._bodies, strict=False):
            if lying.item is not item:
                break
            same += 1
        for _, body in self._bodies[same:]:
            self._world.remove(body)
        del self._bodies[same:]
        for lying, (_, body) in zip(pile, self._bodies, strict=False):
            self._world.move(body, *lying.pose)
        for lying in pile[same:]:
            self._bodies.append((lying.item, self._world.add(lying.item, *lying.pose)))
        self._shows = pile


_SEATED = 0.001
"""How far out of the container an item inside may seem to be, m: walls give way by less."""

_EVERY = 4
"""Steps from one look at the items to the next."""
