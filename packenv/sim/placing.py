"""The robot brings one item into the container: down the path, release, back up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from packenv.robot.cell import Cell
from packenv.sim.descent import MOST_ASIDE, PlacementTask, Profile, Way, way_out
from packenv.sim.rest import RestRule, RestWatch, Settled
from packenv.sim.robot_model import RobotModel
from packenv.sim.world import Touch, World
from packenv.types import FloatArray

_SUPPORT = 0.3
"""A contact whose normal points up by at least this (sine) holds a body."""
_BACK_UP = 0.03
"""How far the robot goes back up before it tries again, m."""


@dataclass(frozen=True)
class MotionConfig:
    """How the robot moves.

    Attributes:
        profile: speeds, and whether the item is lowered beyond the release.
        tolerance: contacts deeper than this are collisions, m: a cell of the heightmaps. An item that slides
            along another is none.
        feel: depth at which the robot feels a contact and stops, m; None: it feels none.
        retries: how often it then goes back up, aside, and down again.
        settle: longest time for settling, s.
        rest: ends settling earlier; None waits ``settle`` out.
    """

    profile: Profile = field(default_factory=Profile)
    tolerance: float = 0.002
    feel: float | None = None
    retries: int = 0
    settle: float = 20.0
    rest: RestRule | None = field(default_factory=RestRule)


@dataclass(frozen=True, eq=False)
class Placed:
    """What came of one placement.

    Attributes:
        body: of the item.
        deepest: the deepest contact of held item or robot with anything else while the robot moved, or None.
        collided: the first contact beyond the tolerance; the robot stops there. None where all went well.
        released: (3, 3) and (3,) pose of the mesh frame at the release.
        settled: how settling ended.
    """

    body: int
    deepest: Touch | None
    collided: Touch | None
    released: tuple[FloatArray, FloatArray]
    settled: Settled


def place(
    world: World,
    robot: RobotModel | None,
    cell: Cell,
    task: PlacementTask,
    motion: MotionConfig,
    watch: Callable[[], None] | None = None,
) -> Placed:
    """Lower an item along its path, let go of it, and wait until all is at rest.

    The robot is stiff and exact, and the held item hangs on it without giving way. On the way down nothing
    else moves: what lies in the container is at rest, or has had its time. Every overlap is looked at, by the
    geometry alone, for Bullet carries contacts on along the normal with which they began, and past an edge
    that is no depth at all. The robot goes back up while the item falls.

    Args:
        world: with what was placed before.
        robot: in the same world; needed where the task has joints.
        cell: where the container is beside the robot.
        task: what to do.
        motion: how.
        watch: called after every step, for cameras.
    """
    guard = _Guard(motion.tolerance)
    way = Way.of_task(task, cell, motion.profile, world.config.time_step)
    body = world.add(task.item, *way.held(0))
    world.ghost(body)
    begin, aside = 0, np.zeros(2)
    for tries_left in range(motion.retries, -1, -1):
        last, felt = _lower(world, robot, body, task, way, begin, motion, guard, watch)
        if felt is None or guard.collided is not None or not tries_left:
            break
        aside = aside + way_out(felt, way.held(last)[0] @ task.item.com + way.held(last)[1])
        other = way.moved(aside) if np.hypot(*aside) <= MOST_ASIDE else None
        if other is None:
            break
        begin = way.above(last, _BACK_UP)
        for _ in range(last - begin):
            world.pause()
        way = other
    released = way.held(last)
    world.move(body, *released)
    world.solid(body)
    world.wake()
    if guard.collided is not None:
        return Placed(body, guard.deepest, guard.collided, released, Settled(0.0, False))
    settled = _let_go(world, robot, body, way.back(last), motion, guard, watch)
    return Placed(body, guard.deepest, guard.collided, released, settled)


def _lower(
    world: World,
    robot: RobotModel | None,
    body: int,
    task: PlacementTask,
    way: Way,
    begin: int,
    motion: MotionConfig,
    guard: _Guard,
    watch: Callable[[], None] | None,
) -> tuple[int, Touch | None]:
    """Move along a way until its end, support, a collision, or a contact that the robot feels.

    Returns:
        the last index of the way that was reached, and the contact that was felt before the release.
    """
    last = begin
    for k in range(begin + 1, len(way)):
        world.move(body, *way.held(k))
        touches = world.overlaps(body, *task.item.bounds(*way.held(k)))
        if k > way.release and guard.supported(touches):
            break
        last = k
        if robot is not None and way.joints is not None:
            robot.move(way.joints[k])
            touches += robot.overlaps(body)
        world.pause()
        if watch is not None:
            watch()
        if guard.look(touches):
            break
        if motion.feel is not None and k <= way.release:
            deepest = max(touches, key=lambda touch: touch.depth, default=None)
            if deepest is not None and deepest.depth > motion.feel:
                return k, deepest
    return last, None


def _let_go(
    world: World,
    robot: RobotModel | None,
    body: int,
    back: FloatArray,
    motion: MotionConfig,
    guard: _Guard,
    watch: Callable[[], None] | None,
) -> Settled:
    """The item falls while the robot goes back; then wait for rest."""
    rest = None if motion.rest is None else RestWatch(world, motion.rest)
    at_rest = None
    start = world.time
    steps = round(motion.settle / world.config.time_step)
    for k in range(max(steps, len(back))):
        if robot is not None and k < len(back):
            robot.move(back[k])
        world.step()
        if watch is not None:
            watch()
        if robot is not None and k < len(back) and guard.look(robot.overlaps(body)):
            return Settled(world.time - start, False)
        if rest is not None and at_rest is None and rest.calm():
            at_rest = world.time - start
            world.sleep()
        if at_rest is not None and k >= len(back):
            return Settled(at_rest, True)
    return Settled(world.time - start, rest is None)


class _Guard:
    """Keeps the deepest contact, and the first beyond a tolerance."""

    def __init__(self, tolerance: float) -> None:
        self.tolerance = tolerance
        self.deepest: Touch | None = None
        self.collided: Touch | None = None

    def look(self, touches: list[Touch]) -> bool:
        """True where something is deeper than the tolerance."""
        for touch in touches:
            if self.deepest is None or touch.depth > self.deepest.depth:
                self.deepest = touch
            if self.collided is None and touch.depth > self.tolerance:
                self.collided = touch
        return self.collided is not None

    @staticmethod
    def supported(touches: list[Touch]) -> bool:
        """True where something below holds the body."""
        return any(touch.depth > 0.0 and touch.normal[2] > _SUPPORT for touch in touches)
