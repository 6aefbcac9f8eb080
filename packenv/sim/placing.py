"""The robot brings one item into the container: down the path, release, back up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from packenv.robot import gripper, tx90
from packenv.robot.cell import Cell
from packenv.robot.motion import follow, refine
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.rest import RestRule, RestWatch, Settled
from packenv.sim.robot_model import RobotModel
from packenv.sim.world import Touch, World
from packenv.types import FloatArray

_SUPPORT = 0.3
"""A contact whose normal points up by at least this (sine) holds a body."""


@dataclass(frozen=True, eq=False)
class PlacementTask:
    """What the robot shall do with one item.

    Attributes:
        item: the item.
        rotation: (3, 3) mesh frame to container frame, as planned.
        position: (3,) as planned, m.
        joints: (m, 6) waypoints from above the rim to the release, and the place itself, rad; None where an
            ideal hand, of no size, holds the item: for plans that never asked the robot.
        heights: (m,) of the same waypoints, m, from any level.
        slip: (4, 4) by which the item is off in the cup, container axes about its planned centre of mass;
            None where it is held as planned.
    """

    item: PhysicsItem
    rotation: FloatArray
    position: FloatArray
    joints: FloatArray | None
    heights: FloatArray
    slip: FloatArray | None = None


@dataclass(frozen=True)
class MotionConfig:
    """How the robot moves.

    Attributes:
        speed: largest speed of the cup, m/s.
        acceleration: of the cup, m/s².
        share: of the joints' published speeds that is used.
        gentle: lower the item beyond the release until something below holds it, at most to its place; else
            it drops from the release (the paper).
        gentle_speed: of the cup on this last bit, m/s.
        tolerance: contacts deeper than this are collisions, m: a cell of the heightmaps. An item that slides
            along another is none.
        settle: longest time for settling, s.
        rest: ends settling earlier; None waits ``settle`` out.
    """

    speed: float = 0.5
    acceleration: float = 2.5
    share: float = 0.5
    gentle: bool = False
    gentle_speed: float = 0.05
    tolerance: float = 0.002
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
    way = _Way(task, cell, motion, world.config.time_step)
    body = world.add(task.item, *way.held(0))
    world.ghost(body)
    last = 0
    for k in range(1, len(way)):
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
    released = way.held(last)
    world.move(body, *released)
    world.solid(body)
    world.wake()
    if guard.collided is not None:
        return Placed(body, guard.deepest, guard.collided, released, Settled(0.0, False))
    settled = _let_go(world, robot, body, way.back(last), motion, guard, watch)
    return Placed(body, guard.deepest, guard.collided, released, settled)


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


class _Way:
    """Joints and held item at every time step of the way down.

    Attributes:
        joints: (n, 6) rad; None where an ideal hand holds the item.
        release: index at which the cup lets go of an item that drops; what follows is the last bit to the
            place itself, for gentle lowering.
    """

    def __init__(self, task: PlacementTask, cell: Cell, motion: MotionConfig, step: float) -> None:
        mesh = np.eye(4)
        mesh[:3, :3], mesh[:3, 3] = task.rotation, task.position
        if task.slip is not None:
            mesh = task.slip @ mesh
        parts = [(0, -1, motion.speed)] + ([(-2, None, motion.gentle_speed)] if motion.gentle else [])
        if task.joints is None:
            heights = [_sampled_fall(task.heights[a:b], motion, v, step) for a, b, v in parts]
            self.joints = None
            lifts = np.concatenate([heights[0], *(h[1:] for h in heights[1:])])
            self._poses = np.repeat(mesh[None], len(lifts), axis=0)
            self._poses[:, 2, 3] += lifts - task.heights[-1]
            self.release = len(heights[0]) - 1
        else:
            joints = [_sampled(task.joints[a:b], motion, v, step) for a, b, v in parts]
            self.joints = np.concatenate([joints[0], *(q[1:] for q in joints[1:])])
            tools = _tools(cell, self.joints)
            self._poses = tools @ (np.linalg.inv(_tools(cell, task.joints[-1:])[0]) @ mesh)
            self.release = len(joints[0]) - 1
        self._step = step

    def __len__(self) -> int:
        """Number of time steps, and one."""
        return len(self._poses)

    def held(self, k: int) -> tuple[FloatArray, FloatArray]:
        """(3, 3) and (3,) pose of the held item's mesh frame in the container frame."""
        return self._poses[k, :3, :3], self._poses[k, :3, 3]

    def back(self, k: int) -> FloatArray:
        """(k + 1, 6) joints from index ``k`` back to the start; none for an ideal hand."""
        return np.empty((0, 6)) if self.joints is None else self.joints[k::-1]


def _tools(cell: Cell, joints: FloatArray) -> FloatArray:
    """(n, 4, 4) tool frames in the container frame."""
    tools: FloatArray = gripper.flange_to_tool(tx90.forward(joints))
    tools[:, :3, 3] = cell.to_container(tools[:, :3, 3])
    return tools


def _sampled(joints: FloatArray, motion: MotionConfig, speed: float, step: float) -> FloatArray:
    """(n, 6) joints at the world's time steps, both ends included."""
    fine = refine(joints)
    tips = gripper.flange_to_tool(tx90.forward(fine))[:, :3, 3]
    way = follow(fine, tips, speed=speed, acceleration=motion.acceleration, share=motion.share)
    return way.sampled(step)


def _sampled_fall(heights: FloatArray, motion: MotionConfig, speed: float, step: float) -> FloatArray:
    """(n,) heights of an ideal hand at the world's time steps: the same profile without joints."""
    tips = np.column_stack([np.zeros((len(heights), 2)), heights])
    way = follow(np.zeros((len(heights), 6)), tips, speed=speed, acceleration=motion.acceleration)
    travelled = abs(float(heights[0] - heights[-1])) * np.linspace(0.0, 1.0, len(way.times))
    times = np.minimum(np.arange(int(np.ceil(way.duration / step - 1e-9)) + 1) * step, way.duration)
    down: FloatArray = float(heights[0]) - np.interp(times, way.times, travelled)
    return down


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
