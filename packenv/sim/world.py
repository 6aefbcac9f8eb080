"""A world in physics with a container in it, built anew for every run, in whichever engine."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from packenv.config import GRAVITY
from packenv.geometry.transforms import quaternion_to_rotation
from packenv.sim.closing import Closing
from packenv.sim.engine import EngineConfig, Push, RawPose, Touch
from packenv.sim.engines import engine_config
from packenv.sim.physics_items import PhysicsItem
from packenv.types import BoolArray, Container, FloatArray, Pose

_LOOK = 1.0 / 240.0
"""About how long a robot moves from one look at it to the next, s: 2 mm at 0.5 m/s."""
_WALL = 0.05
"""Thickness of floor and walls, outward, m."""

_Bounds: TypeAlias = tuple[float, float, float, float, float, float]
"""Smallest x, y, z, then largest, m."""


@dataclass(frozen=True)
class WorldConfig:
    """The settings of a world.

    Attributes:
        mu: coefficient of friction of the container, and of items without their own.
        rolling: lever arm of rolling resistance, m: a ball under the load N feels the torque N · rolling.
        engine: which one, and its settings.
    """

    mu: float = 0.7
    rolling: float = 0.0005
    engine: EngineConfig = field(default_factory=engine_config)

    @property
    def time_step(self) -> float:
        """Of the engine, s."""
        return self.engine.time_step


class World(Closing):
    """Floor, walls and items under gravity. Close it, or use it in a ``with`` statement."""

    def __init__(
        self,
        container: Container,
        config: WorldConfig | None = None,
        *,
        coming: Sequence[PhysicsItem] = (),
        gui: bool = False,
    ) -> None:
        """Build floor and walls.

        Args:
            container: its frame is the world's.
            config: settings.
            coming: items that will be added: some engines make room for all at once.
            gui: with the engine's window.
        """
        self.config = config or WorldConfig()
        self.container, self.gui = container, gui
        self.time = 0.0
        self.time_step = self.config.time_step
        self.stride = max(1, round(_LOOK / self.time_step))
        """Time steps from one look at a moving robot to the next."""
        self.joints: FloatArray | None = None
        """(6,) of the robot now, rad; None without a robot."""
        self._mu = self.config.mu
        self.engine = self.config.engine.start(self.config.rolling, gui=gui)
        self.engine.gravity((0.0, 0.0, -GRAVITY))
        self._items: dict[int, PhysicsItem] = {}
        boxes = _walls(container)
        self.fixed = tuple(self.engine.add_wall(*box) for box in boxes)
        self._walls: dict[int, _Bounds] = {
            body: (*np.subtract(centre, half).tolist(), *np.add(centre, half).tolist())
            for body, (half, centre) in zip(self.fixed, boxes, strict=True)
        }
        self.engine.expect(coming)
        self._bounds: dict[int, _Bounds] = {}
        self._asleep = False
        self._rub()
        if gui:
            self.engine.look(container.size)

    def close(self) -> None:
        """Free the engine's memory; twice is fine, and a world that is forgotten is closed too."""
        self.engine.close()

    @property
    def open(self) -> bool:
        """False once it is closed, by :meth:`close` or by the window's user."""
        return self.engine.open

    @property
    def items(self) -> tuple[int, ...]:
        """Bodies of the items, in the sequence in which they came."""
        return tuple(self._items)

    def item_of(self, body: int) -> PhysicsItem | None:
        """The item that a body is; None for others."""
        return self._items.get(body)

    def add(self, item: PhysicsItem, rotation: FloatArray, position: FloatArray) -> int:
        """Put an item at a pose of its mesh frame, at rest.

        Args:
            item: the item.
            rotation: (3, 3) mesh frame to container frame.
            position: (3,) m.

        Returns:
            its body.
        """
        body = self.engine.add_item(item)
        self._items[body] = item
        self._asleep = False
        self._rub()
        self.move(body, rotation, position)
        return body

    def move(self, body: int, rotation: FloatArray, position: FloatArray) -> None:
        """Put a body at a pose of its mesh frame, at rest."""
        self.engine.place(body, *self._items[body].body_pose(rotation, position))
        self._bounds.pop(body, None)

    def remove(self, body: int) -> None:
        """Take an item out."""
        self.engine.remove(body)
        del self._items[body]
        self._bounds.pop(body, None)
        self._rub()

    def sleep(self) -> None:
        """Hold every item where it is until something touches it, or :meth:`wake`: for a world at rest."""
        self.engine.sleep(self.items)
        self._asleep = True

    def wake(self) -> None:
        """Let every item move, and none fall asleep."""
        self.engine.wake(self.items)
        self._asleep = False

    def step(self) -> None:
        """One time step; nothing moves in a world that sleeps."""
        self.time += self.time_step
        if not self._asleep:
            self.engine.step()
            self._bounds.clear()

    def pause(self) -> None:
        """Let a time step pass in which nothing moves by itself."""
        self.time += self.time_step

    def pace(self, factor: float) -> None:
        """Go on at a multiple of the configured time step."""
        self.time_step = self.config.time_step * factor
        self.engine.pace(self.time_step)

    def rub(self, mu: float | None) -> None:
        """Go on with another coefficient of friction, the most of any item; None: with the configured one."""
        self._mu = self.config.mu if mu is None else mu
        self._rub()

    def _rub(self) -> None:
        self.engine.rub({body: self._friction(item) for body, item in self._items.items()}, self._mu)

    def _friction(self, item: PhysicsItem) -> float:
        """What an item is meant to have with the container."""
        return self._mu if item.friction is None else min(item.friction, self._mu)

    def pose(self, body: int) -> Pose:
        """(3, 3) and (3,) of a body's mesh frame, m."""
        at, turn = self.engine.pose(body)
        return self._items[body].mesh_pose(quaternion_to_rotation(turn), at)

    def raw_pose(self, body: int) -> RawPose:
        """(3,) centre of mass, m, and (4,) quaternion of the body frame, for :meth:`travel`."""
        return self.engine.pose(body)

    def travel(self, body: int, at: FloatArray, turn: FloatArray) -> float:
        """A bound on how far any point of an item is from where it was at an earlier pose, m."""
        now, turned = self.raw_pose(body)
        # Chord of the rotation: twice the sine of half the angle.
        half = min(float(np.linalg.norm(turned - turn)), float(np.linalg.norm(turned + turn)))
        return math.dist(now, at) + 2.0 * half * self._items[body].reach

    def pushes(self, body: int) -> list[Push]:
        """Contact forces on an item in the last step."""
        return self.engine.pushes(body)

    def ghost(self, body: int) -> None:
        """Let a body pass through everything; :meth:`overlaps` still sees it."""
        self.engine.ghost(body)

    def solid(self, body: int) -> None:
        """Undo :meth:`ghost`: contacts begin afresh."""
        self.engine.solid(body)

    def overlaps(self, body: int, box: FloatArray, apart: Collection[int] = ()) -> list[Touch]:
        """What a body is in now, by the geometry alone.

        Args:
            body: may be a ghost.
            box: (2, 3) around it: smallest and largest coordinates, m.
            apart: bodies that do not count.
        """
        near = []
        # Asked at every step of a way, of every item: arrays of three numbers would cost ten times as much.
        (x0, y0, z0), (x1, y1, z1) = box.tolist()
        for other in (*self.fixed, *self._items):
            if other == body or other in apart:
                continue
            u0, v0, w0, u1, v1, w1 = self._bounds_of(other)
            if u0 > x1 or v0 > y1 or w0 > z1 or x0 > u1 or y0 > v1 or z0 > w1:
                continue
            near.append(other)
        return self.engine.touches(body, near) if near else []

    def near(self, boxes: FloatArray, apart: Collection[int]) -> BoolArray:
        """Which boxes meet one around a body, as all lie now: only there :meth:`overlaps` finds anything.

        Args:
            boxes: (n, 2, 3) smallest and largest coordinates, m.
            apart: bodies that do not count.
        """
        others = np.array([self._bounds_of(b) for b in (*self.fixed, *self._items) if b not in apart])
        low, high = others[:, :3], others[:, 3:]
        apart_along = (boxes[:, None, 0] > high) | (low > boxes[:, None, 1])
        meets: BoolArray = np.any(~np.any(apart_along, axis=2), axis=1)
        return meets

    def _bounds_of(self, body: int) -> _Bounds:
        """A box around a wall or an item; of an item it is kept until it moves."""
        wall = self._walls.get(body)
        if wall is not None:
            return wall
        known = self._bounds.get(body)
        if known is None:
            at, reach = self.raw_pose(body)[0], self._items[body].reach
            known = self._bounds[body] = (*(at - reach).tolist(), *(at + reach).tolist())
        return known


def _walls(container: Container) -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Half extents and centre of the floor and the four walls, m."""
    length, width, height = container.size
    t = _WALL
    floor = ((length / 2 + t, width / 2 + t, t / 2), (length / 2, width / 2, -t / 2))
    across, along = (t / 2, width / 2 + t, height / 2), (length / 2, t / 2, height / 2)
    return [
        floor,
        *((across, (x, width / 2, height / 2)) for x in (-t / 2, length + t / 2)),
        *((along, (length / 2, y, height / 2)) for y in (-t / 2, width + t / 2)),
    ]
