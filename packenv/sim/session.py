"""A packing in physics, item by item: what was placed, where it ended, and whether all went well."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from packenv.geometry.transforms import angle_between
from packenv.robot.cell import Cell, CellSetup
from packenv.sim.closing import Closing
from packenv.sim.descent import PlacementTask
from packenv.sim.drop_test import Lying
from packenv.sim.engines import engine_config
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.placing import MotionConfig, Placed, place
from packenv.sim.robot_model import RobotModel
from packenv.sim.verdicts import DISPLACED, Cause, collision, sticking_out
from packenv.sim.world import World, WorldConfig
from packenv.types import Container, FloatArray, Pose

FEEL = 0.0005
"""Depth at which a robot that feels contacts does, m."""
RETRIES = 24
"""How often it then tries beside its place."""
CAREFULLY = 0.25
"""Its largest speed, m/s."""


@dataclass(frozen=True)
class ExecutionConfig:
    """The settings of an execution.

    Attributes:
        world: physics.
        motion: robot, release, rest.
    """

    world: WorldConfig = field(default_factory=WorldConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)

    @classmethod
    def of(cls, setup: CellSetup, engine: str = "auto") -> ExecutionConfig:
        """The usual settings of an engine, by name, with a cell's friction.

        Raises:
            PhysicsError: the engine is not installed.
        """
        return cls(world=WorldConfig(mu=setup.friction, engine=engine_config(engine)))


def feeling(config: ExecutionConfig) -> ExecutionConfig:
    """The same settings with guarded moves: the robot feels contacts on its way down, and tries beside."""
    profile = replace(config.motion.profile, speed=CAREFULLY)
    return replace(config, motion=replace(config.motion, profile=profile, feel=FEEL, retries=RETRIES))


@dataclass(frozen=True, eq=False)
class ItemOutcome:
    """What became of one item.

    Attributes:
        item: its name.
        planned: pose of the mesh frame in the plan, (3, 3) and (3,) m.
        measured: the same once it had settled.
        drop_m: how far its centre of mass fell from the release, m.
        shift_m: horizontal distance of its centre of mass from where it was planned, m.
        turned_rad: angle between planned and measured orientation.
        settle_s: simulated seconds until everything was at rest.
        at_rest: False where something still moved when the time ran out.
        deepest_m: the deepest contact while the robot moved, m; None without any.
        met: what it was with: an item's name or ``container``, "" without any.
        collided: the robot or the held item went deeper than the tolerance.
        moved: what lay there before and moved by more than ``DISPLACED`` meanwhile, by index of its pose.
    """

    item: str
    planned: Pose
    measured: Pose
    drop_m: float
    shift_m: float
    turned_rad: float
    settle_s: float
    at_rest: bool
    deepest_m: float | None
    met: str
    collided: bool
    moved: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Execution:
    """What physics made of a plan (paper Sec. V-C).

    Attributes:
        success: neither robot nor held item collided, and at the end every item is inside the container.
        cause: why not: ``collision`` while placing; ``item-displaced``: a collision with an item that had
            left its planned place, or a displaced item that is out; ``item-out``: an item sticks out though
            it is where it was planned.
        detail: one phrase for people.
        items: outcomes in packing sequence, up to the collision where there was one.
        final: measured pose of every item at the end; of what lay there at the beginning first.
        simulated_s: simulated time.
    """

    success: bool
    cause: Cause | None
    detail: str
    items: tuple[ItemOutcome, ...]
    final: tuple[Pose, ...]
    simulated_s: float


class Session(Closing):
    """A container, a robot and the items placed so far. Close it, or use it in a ``with`` statement."""

    def __init__(
        self,
        cell: Cell,
        config: ExecutionConfig,
        *,
        arm: bool = True,
        lying: Sequence[Lying] = (),
        coming: Sequence[PhysicsItem] = (),
        gui: bool = False,
        watch: Callable[[World], None] | None = None,
    ) -> None:
        """Build the world.

        Args:
            cell: container and robot.
            config: settings.
            arm: have the robot in the world; not needed where no task has joints.
            lying: what the container holds already, at rest; it counts as planned where it lies.
            coming: items that will be placed: some engines make room for all at once.
            gui: open the engine's window.
            watch: called after every step, for cameras.
        """
        self.cell, self.config = cell, config
        coming = (*(thing.item for thing in lying), *coming)
        self.world = World(cell.container, config.world, coming=coming, gui=gui)
        self._robot = RobotModel(self.world, cell) if arm else None
        self._watch = None if watch is None else lambda: watch(self.world)
        self._outcomes: list[ItemOutcome] = []
        self._bodies = [self.world.add(thing.item, *thing.pose) for thing in lying]
        self._planned = [thing.pose for thing in lying]
        self._collision: tuple[Cause, str] | None = None

    def close(self) -> None:
        """Free the engine's memory."""
        self.world.close()

    @property
    def container(self) -> Container:
        """The box."""
        return self.cell.container

    @property
    def failed(self) -> bool:
        """True after a collision: the robot has stopped."""
        return self._collision is not None

    def measured(self) -> tuple[Pose, ...]:
        """Poses of all items' mesh frames now; of what lay there at the beginning first."""
        return tuple(self.world.pose(body) for body in self._bodies)

    def place(self, task: PlacementTask) -> ItemOutcome:
        """Bring one item in and wait for rest."""
        before = self.measured()
        placed = place(self.world, self._robot, self.cell, task, self.config.motion, self._watch)
        self._bodies.append(placed.body)
        now = self.measured()
        moved = tuple(
            k for k, (a, b) in enumerate(zip(before, now, strict=False)) if self._travel(k, a, b) > DISPLACED
        )
        outcome = self._outcome(task, placed, now[-1], moved)
        if placed.collided is not None:
            self._collision = self._blame(task, placed)
        self._outcomes.append(outcome)
        self._planned.append(outcome.planned)
        return outcome

    def result(self) -> Execution:
        """Judge by the paper's two criteria."""
        final = self.measured()
        outcomes = tuple(self._outcomes)
        cause, detail = self._collision or self._out(final) or (None, "")
        return Execution(cause is None, cause, detail, outcomes, final, self.world.time)

    def _com(self, k: int, pose: Pose) -> FloatArray:
        item = self.world.item_of(self._bodies[k])
        assert item is not None
        return item.com_at(pose)

    def _travel(self, k: int, a: Pose, b: Pose) -> float:
        return float(np.linalg.norm(self._com(k, a) - self._com(k, b)))

    def _outcome(self, task: PlacementTask, placed: Placed, now: Pose, moved: tuple[int, ...]) -> ItemOutcome:
        k = len(self._bodies) - 1
        planned = Pose(task.rotation, task.position)
        away = self._com(k, now) - self._com(k, planned)
        drop = self._com(k, placed.released) - self._com(k, now)
        deepest = placed.deepest
        return ItemOutcome(
            item=task.item.name,
            planned=planned,
            measured=now,
            drop_m=float(drop[2]),
            shift_m=float(np.hypot(away[0], away[1])),
            turned_rad=angle_between(now[0], task.rotation),
            settle_s=placed.settled.seconds,
            at_rest=placed.settled.at_rest,
            deepest_m=None if deepest is None else deepest.depth,
            met="" if deepest is None else self._name(deepest.other),
            collided=placed.collided is not None,
            moved=moved,
        )

    def _name(self, body: int) -> str:
        item = self.world.item_of(body)
        return "container" if item is None else item.name

    def _displaced(self, k: int) -> bool:
        if k >= len(self._planned):
            return False
        return self._travel(k, self._planned[k], self.measured()[k]) > DISPLACED

    def _blame(self, task: PlacementTask, placed: Placed) -> tuple[Cause, str]:
        touch = placed.collided
        assert touch is not None
        mover = "the robot" if touch.body != placed.body else task.item.name
        gone = touch.other in self._bodies and self._displaced(self._bodies.index(touch.other))
        return collision(mover, self._name(touch.other), touch.depth, displaced=gone)

    def _out(self, final: tuple[Pose, ...]) -> tuple[Cause, str] | None:
        items = [self.world.item_of(body) for body in self._bodies]
        return sticking_out([i for i in items if i is not None], final, self.container, self._displaced)
