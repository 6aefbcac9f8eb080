"""A PyBullet world with a container in it, built anew for every run.

Bullet keeps a skin of 1 mm around every convex shape and was made for bodies of decimetres to metres. The
world is therefore simulated ``SCALE`` times as large, gravity with it: the skin is then 0.1 mm of the
item, thinner than the gaps that the planner leaves. Times, masses and friction stay; whoever uses
:class:`World` sees metres, kilograms and seconds alone.
"""

from __future__ import annotations

import hashlib
import math
import shutil
import tempfile
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pybullet

from packenv.config import GRAVITY
from packenv.geometry.transforms import quaternion_to_rotation, rotation_to_quaternion
from packenv.sim.closing import Closing
from packenv.sim.physics_items import PhysicsItem
from packenv.types import Container, FloatArray, Pose

SCALE = 10.0
"""Lengths in the engine over lengths in metres."""
_WALL = 0.05
"""Thickness of floor and walls, outward, m."""

_Bounds: TypeAlias = tuple[float, float, float, float, float, float]
"""Smallest x, y, z, then largest, m."""

EngineError: type[Exception] = pybullet.error
"""What the engine raises, for instance where its window was closed."""


@dataclass(frozen=True)
class WorldConfig:
    """The settings of a world.

    Attributes:
        mu: coefficient of friction of the container, and of items without their own.
        rolling: lever arm of rolling resistance, m: a ball under the load N feels the torque N · rolling.
        time_step: s.
        iterations: most of the contact solver, a step. A light item under a heavy one needs many: with too
            few it creeps for ever, and into the wall.
        residual: at which the solver stops earlier (Bullet's ``solverResidualThreshold``); a pile at rest
            creeps the less, the lower it is; with 0 the solver never stops earlier.
        breaking: contacts are kept while the surfaces are nearer than this, m.
        anchored: friction pulls a contact back that has crept (Bullet's friction anchors), so a pile at rest
            creeps hardly at all.
    """

    mu: float = 0.7
    rolling: float = 0.0005
    time_step: float = 1.0 / 240.0
    iterations: int = 200
    residual: float = 1e-5
    breaking: float = 0.004
    anchored: bool = False


@dataclass(frozen=True, eq=False)
class Touch:
    """A contact of two bodies.

    Attributes:
        body: the body that was asked for.
        other: the other body.
        link: of ``body``, -1 for a body of one link.
        depth: how far the surfaces are in each other, m; negative where they are apart.
        point: (3,) on ``other``, m.
        normal: (3,) unit, from ``other`` into ``body``.
    """

    body: int
    other: int
    link: int
    depth: float
    point: FloatArray
    normal: FloatArray


class World(Closing):
    """Floor, walls and items under gravity. Close it, or use it in a ``with`` statement."""

    def __init__(self, container: Container, config: WorldConfig | None = None, *, gui: bool = False) -> None:
        """Build floor and walls.

        Args:
            container: its frame is the world's.
            config: settings.
            gui: open PyBullet's window.
        """
        self.config = config or WorldConfig()
        self.container = container
        self.time = 0.0
        self.time_step = self.config.time_step
        self._mu = self._top = self.config.mu
        self._client: int = pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT)
        self._folder = Path(tempfile.mkdtemp(prefix="robotpack-"))
        self._free = weakref.finalize(self, _free, self._client, self._folder)
        self._items: dict[int, PhysicsItem] = {}
        self._shapes: dict[PhysicsItem, int] = {}
        p, c = pybullet, self._client
        # The breaking threshold belongs to the process, so it is set anew for every world.
        p.setPhysicsEngineParameter(
            fixedTimeStep=self.config.time_step,
            numSolverIterations=self.config.iterations,
            solverResidualThreshold=self.config.residual,
            contactBreakingThreshold=self.config.breaking * SCALE,
            deterministicOverlappingPairs=1,
            physicsClientId=c,
        )
        p.setGravity(0.0, 0.0, -GRAVITY * SCALE, physicsClientId=c)
        boxes = _walls(container)
        self.fixed = tuple(self._add_wall(*box) for box in boxes)
        self._walls: dict[int, _Bounds] = {
            body: (*np.subtract(centre, half).tolist(), *np.add(centre, half).tolist())
            for body, (half, centre) in zip(self.fixed, boxes, strict=True)
        }
        for body in self.fixed:
            p.changeDynamics(body, -1, **self._surface(body), physicsClientId=c)
        self._bounds: dict[int, _Bounds] = {}
        if gui:
            self._arrange_window()

    def close(self) -> None:
        """Free the engine's memory; twice is fine, and a world that is forgotten is closed too."""
        self._free()

    @property
    def client(self) -> int:
        """PyBullet's number of this world, for cameras."""
        return self._client

    @property
    def open(self) -> bool:
        """False once it is closed, by :meth:`close` or by the window's user."""
        return bool(pybullet.isConnected(self._client))

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
        p, c = pybullet, self._client
        if item not in self._shapes:
            self._shapes[item] = self._shape(item)
        shape = self._shapes[item]
        body = p.createMultiBody(item.mass, shape, physicsClientId=c)
        p.changeDynamics(
            body,
            -1,
            localInertiaDiagonal=(item.moments * SCALE**2).tolist(),
            linearDamping=0.0,
            angularDamping=0.0,
            physicsClientId=c,
        )
        self._items[body] = item
        self._rub(body)
        self.move(body, rotation, position)
        return int(body)

    def move(self, body: int, rotation: FloatArray, position: FloatArray) -> None:
        """Put a body at a pose of its mesh frame, at rest."""
        turned, at = self._items[body].body_pose(rotation, position)
        p, c = pybullet, self._client
        quaternion = rotation_to_quaternion(turned).tolist()
        p.resetBasePositionAndOrientation(body, (at * SCALE).tolist(), quaternion, physicsClientId=c)
        p.resetBaseVelocity(body, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], physicsClientId=c)
        self._bounds.pop(body, None)

    def remove(self, body: int) -> None:
        """Take an item out."""
        pybullet.removeBody(body, physicsClientId=self._client)
        del self._items[body]
        self._bounds.pop(body, None)
        self._rub()

    def sleep(self) -> None:
        """Hold every item where it is until something touches it, or :meth:`wake`: for a world at rest.

        Bullet wakes an item that an awake one touches, and with it all that touch it in turn.
        """
        p, c = pybullet, self._client
        for body in self._items:
            p.resetBaseVelocity(body, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], physicsClientId=c)
            for state in (p.ACTIVATION_STATE_ENABLE_SLEEPING, p.ACTIVATION_STATE_SLEEP):
                p.changeDynamics(body, -1, activationState=state, physicsClientId=c)

    def wake(self) -> None:
        """Let every item move, and none fall asleep."""
        for body in self._items:
            pybullet.changeDynamics(
                body,
                -1,
                activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
                physicsClientId=self._client,
            )

    def step(self) -> None:
        """One time step."""
        pybullet.stepSimulation(physicsClientId=self._client)
        self.time += self.time_step
        self._bounds.clear()

    def pace(self, time_step: float | None) -> None:
        """Go on at another time step, s; None: at the configured one."""
        self.time_step = self.config.time_step if time_step is None else time_step
        pybullet.setPhysicsEngineParameter(fixedTimeStep=self.time_step, physicsClientId=self._client)

    def rub(self, mu: float | None) -> None:
        """Go on with another coefficient of friction, the most of any item; None: with the configured one."""
        self._mu = self.config.mu if mu is None else mu
        self._rub()

    def _rub(self, new: int | None = None) -> None:
        """Tell Bullet of friction: of the new body alone, where it changes nothing of the others."""
        top = max(map(self._friction, self._items), default=self._mu)
        bodies = (*self.fixed, *self._items) if top != self._top else () if new is None else (new,)
        self._top = top
        for body in bodies:
            pybullet.changeDynamics(body, -1, **self._surface(body), physicsClientId=self._client)

    def _friction(self, body: int) -> float:
        """What a body is meant to have with the container."""
        own = self._items[body].friction if body in self._items else None
        return self._mu if own is None else min(own, self._mu)

    def pose(self, body: int) -> Pose:
        """(3, 3) and (3,) of a body's mesh frame, m."""
        at, quaternion = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client)
        turned = quaternion_to_rotation(np.array(quaternion))
        return self._items[body].mesh_pose(turned, np.array(at) / SCALE)

    def raw_pose(self, body: int) -> tuple[FloatArray, FloatArray]:
        """(3,) centre of mass, m, and (4,) quaternion of the body frame, for :meth:`travel`."""
        at, turn = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client)
        return np.array(at) / SCALE, np.array(turn)

    def travel(self, body: int, at: FloatArray, turn: FloatArray) -> float:
        """A bound on how far any point of an item is from where it was at an earlier pose, m."""
        now, turned = self.raw_pose(body)
        # Chord of the rotation: twice the sine of half the angle.
        half = min(float(np.linalg.norm(turned - turn)), float(np.linalg.norm(turned + turn)))
        return math.dist(now, at) + 2.0 * half * self._items[body].reach

    def ghost(self, body: int) -> None:
        """Let a body pass through everything; :meth:`overlaps` still sees it."""
        self._collide(body, 0)

    def solid(self, body: int) -> None:
        """Undo :meth:`ghost`: contacts begin afresh."""
        self._collide(body, -1)

    def pause(self) -> None:
        """Let a time step pass in which nothing moves by itself."""
        self.time += self.time_step

    def overlaps(self, body: int, low: FloatArray, high: FloatArray, link: int | None = None) -> list[Touch]:
        """What a body or one of its links is in now, by the geometry alone.

        Args:
            body: may be a ghost.
            low: (3,) of its bounding box, m.
            high: (3,) of its bounding box, m.
            link: one link; all of them where None.
        """
        touches = []
        # Asked at every step of a way, of every item: arrays of three numbers would cost ten times as much.
        (x0, y0, z0), (x1, y1, z1) = low.tolist(), high.tolist()
        for other in (*self.fixed, *self._items):
            if other == body:
                continue
            u0, v0, w0, u1, v1, w1 = self._walls.get(other) or self._item_bounds(other)
            if u0 > x1 or v0 > y1 or w0 > z1 or x0 > u1 or y0 > v1 or z0 > w1:
                continue
            chosen = {} if link is None else {"linkIndexA": link}
            found = pybullet.getClosestPoints(body, other, 0.0, **chosen, physicsClientId=self._client)
            # Asked for a distance of 0 it also tells of what is a little farther.
            touches += [touch for touch in map(_touch, found) if touch.depth > 0.0]
        return touches

    def _item_bounds(self, body: int) -> _Bounds:
        """A box around an item, kept until it moves."""
        known = self._bounds.get(body)
        if known is None:
            at, reach = self.raw_pose(body)[0], self._items[body].reach
            known = self._bounds[body] = (*(at - reach).tolist(), *(at + reach).tolist())
        return known

    def _arrange_window(self) -> None:
        """Look at the container from above the robot's far side, through its walls, without panels."""
        p, c = pybullet, self._client
        p.configureDebugVisualizer(p.COV_ENABLE_GUI, 0, physicsClientId=c)
        x, y, z = self.container.size
        centre = [SCALE * x / 2.0, SCALE * y / 2.0, SCALE * z]
        distance = SCALE * 3.0 * max(self.container.size)
        p.resetDebugVisualizerCamera(distance, 60.0, -40.0, centre, physicsClientId=c)
        for body in self.fixed[1:]:
            p.changeVisualShape(body, -1, rgbaColor=[0.6, 0.6, 0.65, 0.25], physicsClientId=c)

    def _collide(self, body: int, mask: int) -> None:
        p, c = pybullet, self._client
        for link in range(-1, p.getNumJoints(body, physicsClientId=c)):
            p.setCollisionFilterGroupMask(body, link, 1 if mask else 0, mask, physicsClientId=c)

    def _surface(self, body: int) -> dict[str, float]:
        """Friction of one body: Bullet multiplies the two of a contact, and adds rolling crosswise.

        Where coefficients differ, no factor of each body makes the lesser of two of every product. With t the
        largest one of the items here (at most the container's), the container has √t and an item of μ has μ / √t.
        So an item and the container have μ, two items μ₁ μ₂ / t: the lesser where either has t, less than that
        otherwise, never more. Rolling resistance is between half and all of what is configured, at least where
        one surface is the container or an item of t.
        """
        root = math.sqrt(self._top)
        own = root if body in self.fixed or not root else root * (self._friction(body) / self._top)
        rolling = self.config.rolling * SCALE / (2.0 * root) if root > 0.0 else 0.0
        anchor = {"frictionAnchor": 1} if self.config.anchored else {}
        return {"lateralFriction": own, "rollingFriction": rolling, "restitution": 0.0, **anchor}

    def _shape(self, item: PhysicsItem) -> int:
        p, c = pybullet, self._client
        if item.radius > 0.0:
            shape = p.createCollisionShape(
                p.GEOM_SPHERE,
                radius=item.radius * SCALE,
                collisionFramePosition=(item.ball_centre * SCALE).tolist(),
                physicsClientId=c,
            )
        else:
            path = self._parts_file(item)
            shape = p.createCollisionShape(p.GEOM_MESH, fileName=str(path), physicsClientId=c)
        if shape < 0:
            raise RuntimeError(f"PyBullet made no shape of {item.name}")
        return int(shape)

    def _parts_file(self, item: PhysicsItem) -> Path:
        """One OBJ with an ``o`` a part; named by content, for Bullet never reads a path again."""
        text = _obj_text([part * SCALE for part in item.parts])
        path = self._folder / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.obj"
        if not path.exists():
            path.write_text(text, encoding="ascii")
        return path

    def _add_wall(self, half: tuple[float, float, float], centre: tuple[float, float, float]) -> int:
        p, c = pybullet, self._client
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[h * SCALE for h in half], physicsClientId=c)
        body = p.createMultiBody(0.0, shape, basePosition=[x * SCALE for x in centre], physicsClientId=c)
        return int(body)


def _free(client: int, folder: Path) -> None:
    """Close a world; the window's user may have done so already."""
    if pybullet.isConnected(client):
        pybullet.disconnect(client)
    shutil.rmtree(folder, ignore_errors=True)


def _touch(record: Sequence[Any]) -> Touch:
    """A contact as PyBullet tells it."""
    depth = -float(record[8]) / SCALE
    return Touch(record[1], record[2], record[3], depth, np.array(record[6]) / SCALE, np.array(record[7]))


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


def _obj_text(parts: Sequence[FloatArray]) -> str:
    """An OBJ with one ``o`` a part. Bullet takes the hull of the points that faces name, so any faces do."""
    lines, first = [], 1
    for k, part in enumerate(parts):
        lines.append(f"o part_{k:03d}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in part.tolist()]
        n = len(part)
        corners = [[min(i + j, n - 1) + first for j in range(3)] for i in range(0, n, 3)]
        lines += [f"f {a} {b} {c}" for a, b, c in corners]
        first += n
    return "\n".join(lines) + "\n"
