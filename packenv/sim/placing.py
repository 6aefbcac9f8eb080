"""The robot brings one item into the container: down the path, release, back up."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from packenv.robot.cell import Cell
from packenv.sim.descent import PlacementTask, Profile, Way, ways_out
from packenv.sim.engine import Touch
from packenv.sim.rest import RestRule, RestWatch, Settled
from packenv.sim.robot_model import RobotModel, RobotWay
from packenv.sim.world import World
from packenv.types import FloatArray, Pose

_SUPPORT = 0.3
"""A contact whose normal points up by at least this (sine) holds a body."""
_BACK_UP = 0.02
"""How far the robot goes back up before it tries again, m."""
_PAST = 0.003
"""How much deeper than a contact it must get to be past it, m."""


@dataclass(frozen=True)
class MotionConfig:
    """How the robot moves.

    Attributes:
        profile: speeds, and whether the item is lowered beyond the release.
        tolerance: contacts deeper than this are collisions, m: a cell of the heightmaps. An item that slides
            along another is none.
        feel: depth at which the robot feels a contact and stops, m; None: it feels none.
        retries: how often, for one item, it then goes back up, aside, and down again.
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
    released: Pose
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
    way = Way.of_task(task, cell, motion.profile, world.time_step * world.stride)
    body = world.add(task.item, *way.held(0))
    world.ghost(body)
    lower = _Lowering(world, robot, cell, body, task, motion, guard, watch)
    course = lower.course(way)
    last, felt = lower.along(course, 0)
    tries = motion.retries
    while felt is not None and guard.collided is None:
        met, start = last, course.way.above(last, _BACK_UP)
        beside = lower.beside(course.way, met, felt)
        for other in itertools.islice(beside, tries):
            tries -= 1
            lower.pause(met - start)
            if not lower.fits(other, start):
                continue
            last, felt = lower.along(other, start)
            if felt is None or guard.collided is not None or other.way.deeper(last, met) > _PAST:
                course = other
                break
        else:
            # Nowhere to go: whoever does not let go up here pushes on, and that is a collision.
            last, felt = lower.along(course, met, blind=True)
    released = course.way.held(last)
    world.move(body, *released)
    world.solid(body)
    world.wake()
    if guard.collided is not None:
        return Placed(body, guard.deepest, guard.collided, released, Settled(0.0, False))
    settled = _let_go(world, robot, body, course.robot, last, motion, guard, watch)
    return Placed(body, guard.deepest, guard.collided, released, settled)


@dataclass(frozen=True, eq=False)
class _Course:
    """A way, and what is watched along it.

    Attributes:
        way: of the held item.
        boxes: (n, 2, 3) around the held item, m.
        robot: of the robot; None for an ideal hand.
    """

    way: Way
    boxes: FloatArray
    robot: RobotWay | None


@dataclass(frozen=True, eq=False)
class _Lowering:
    """A held item, or a robot with it, on its way down."""

    world: World
    robot: RobotModel | None
    cell: Cell
    body: int
    task: PlacementTask
    motion: MotionConfig
    guard: _Guard
    watch: Callable[[], None] | None

    def course(self, way: Way) -> _Course:
        """What to watch along a way."""
        along = None if self.robot is None or way.joints is None else self.robot.way(way.joints)
        return _Course(way, self.task.item.boxes(way.poses), along)

    def along(self, course: _Course, begin: int, *, blind: bool = False) -> tuple[int, Touch | None]:
        """Move along a way until its end, support, a collision, or a contact that the robot feels.

        Returns:
            the last index of the way that was reached, and the contact that was felt before the release.
        """
        way, last = course.way, begin
        # Nothing else moves meanwhile, so where to look is known beforehand.
        near = self.world.near(course.boxes, (self.body,))
        if course.robot is not None and self.robot is not None:
            near |= self.robot.near(course.robot, self.body)
        for k in range(begin + 1, len(way)):
            if not near[k] and self.watch is None:
                last = k
                self.pause(1)
                continue
            touches = self._item_at(course, k)
            if k > way.release and self.guard.supported(touches):
                break
            last = k
            touches += self._robot_at(course, k)
            self.pause(1)
            if self.guard.look(touches):
                break
            if not blind and k <= way.release:
                felt = self._felt(touches)
                if felt is not None:
                    return k, felt
        return last, None

    def fits(self, course: _Course, k: int) -> bool:
        """Whether a robot that goes aside to index ``k`` of a way feels nothing there; else it turns back."""
        return self._felt(self._item_at(course, k) + self._robot_at(course, k)) is None

    def _item_at(self, course: _Course, k: int) -> list[Touch]:
        """Move the held item, and see what it is in."""
        self.world.move(self.body, *course.way.held(k))
        return self.world.overlaps(self.body, course.boxes[k])

    def _robot_at(self, course: _Course, k: int) -> list[Touch]:
        """Move the robot, and see what it is in."""
        if self.robot is None or course.robot is None:
            return []
        self.robot.move(course.robot.joints[k])
        return self.robot.overlaps(course.robot, k, self.body)

    def _felt(self, touches: list[Touch]) -> Touch | None:
        """The deepest contact, where the robot feels it."""
        deepest = max(touches, key=lambda touch: touch.depth, default=None)
        feel = self.motion.feel
        return deepest if feel is not None and deepest is not None and deepest.depth > feel else None

    def beside(self, way: Way, k: int, felt: Touch) -> Iterator[_Course]:
        """Ways beside one that met something at index ``k``, the likeliest first."""
        for aside in ways_out(felt, self.task.item.com_at(way.held(k))):
            other = way.moved(aside, self.cell)
            if other is not None:
                yield self.course(other)

    def pause(self, looks: int) -> None:
        """Let time pass in which nothing moves by itself."""
        for _ in range(looks * self.world.stride):
            self.world.pause()
            if self.watch is not None:
                self.watch()


def _let_go(
    world: World,
    robot: RobotModel | None,
    body: int,
    way: RobotWay | None,
    last: int,
    motion: MotionConfig,
    guard: _Guard,
    watch: Callable[[], None] | None,
) -> Settled:
    """The item falls while the robot goes back up its way from index ``last``; then wait for rest."""
    rest = RestWatch(world, motion.rest or RestRule())
    at_rest = None
    start = world.time
    back = (last + 1) * world.stride if robot is not None and way is not None else 0
    steps = round(motion.settle / world.time_step)
    for k in range(max(steps, back)):
        world.step()
        if watch is not None:
            watch()
        if robot is not None and way is not None and k < back and k % world.stride == 0:
            robot.move(way.joints[last - k // world.stride])
            if guard.look(robot.overlaps(way, last - k // world.stride, body)):
                return Settled(world.time - start, False)
        if at_rest is None and rest.calm() and motion.rest is not None:
            at_rest = world.time - start
            world.sleep()
        if at_rest is not None and k >= back:
            return Settled(at_rest, True)
    if at_rest is not None:
        return Settled(at_rest, True)
    return Settled(world.time - start, rest.rested)


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
