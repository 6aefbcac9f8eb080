"""PyBullet as an engine.

Bullet keeps a skin of 1 mm around every convex shape and was made for bodies of decimetres to metres. So all is
``SCALE`` times as large in there, gravity with it: the skin is then 0.1 mm of the item, thinner than the gaps that
the planner leaves. Times, masses and friction stay.
"""

from __future__ import annotations

import hashlib
import math
import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pybullet

from packenv.config import EngineName
from packenv.geometry.transforms import rotation_to_quaternion
from packenv.sim.engine import Engine, EngineConfig, Push, RawPose, Touch
from packenv.sim.physics_items import PhysicsItem
from packenv.types import FloatArray

SCALE = 10.0
"""Lengths in the engine over lengths in metres."""


@dataclass(frozen=True, kw_only=True)
class BulletConfig(EngineConfig):
    """The settings of PyBullet.

    Attributes:
        time_step: s.
        iterations: most of the contact solver, a step. A light item under a heavy one needs many: with too
            few it creeps for ever, and into the wall.
        residual: at which the solver stops earlier (Bullet's ``solverResidualThreshold``); a pile at rest
            creeps the less, the lower it is; with 0 the solver never stops earlier.
        breaking: contacts are kept while the surfaces are nearer than this, m.
        anchored: friction pulls a contact back that has crept (Bullet's friction anchors), so a pile at rest
            creeps hardly at all.
    """

    name: ClassVar[EngineName] = "bullet"
    time_step: float = 1.0 / 240.0
    iterations: int = 200
    residual: float = 1e-5
    breaking: float = 0.004
    anchored: bool = False

    def start(self, rolling: float, *, gui: bool = False) -> BulletEngine:
        """An engine without bodies."""
        return BulletEngine(self, rolling, gui=gui)


class BulletEngine(Engine):
    """A client of PyBullet."""

    failure = pybullet.error

    def __init__(self, config: BulletConfig, rolling: float, *, gui: bool) -> None:
        """Connect."""
        self.config, self._rolling = config, rolling
        self.client: int = pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT)
        self._folder = Path(tempfile.mkdtemp(prefix="robotpack-"))
        self._free = weakref.finalize(self, _free, self.client, self._folder)
        self._shapes: dict[PhysicsItem, int] = {}
        self._walls: list[int] = []
        self._told: dict[int, dict[str, float]] = {}
        # The breaking threshold belongs to the process, so it is set anew for every world.
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=config.time_step,
            numSolverIterations=config.iterations,
            solverResidualThreshold=config.residual,
            contactBreakingThreshold=config.breaking * SCALE,
            deterministicOverlappingPairs=1,
            physicsClientId=self.client,
        )
        if gui:
            pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_GUI, 0, physicsClientId=self.client)

    def close(self) -> None:
        """Free the engine's memory; twice is fine, and an engine that is forgotten is closed too."""
        self._free()

    @property
    def open(self) -> bool:
        """False once it is closed, by :meth:`close` or by the window's user."""
        return bool(pybullet.isConnected(self.client))

    def look(self, size: Sequence[float]) -> None:
        """Turn the window's camera to a container of a size (3,), m, and make its walls transparent."""
        p, c = pybullet, self.client
        centre = [SCALE * size[0] / 2.0, SCALE * size[1] / 2.0, SCALE * size[2]]
        p.resetDebugVisualizerCamera(SCALE * 3.0 * max(size), 60.0, -40.0, centre, physicsClientId=c)
        for body in self._walls[1:]:
            p.changeVisualShape(body, -1, rgbaColor=[0.6, 0.6, 0.65, 0.25], physicsClientId=c)

    def add_wall(self, half: Sequence[float], centre: Sequence[float]) -> int:
        """A box that never moves."""
        p, c = pybullet, self.client
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[h * SCALE for h in half], physicsClientId=c)
        body = int(p.createMultiBody(0.0, shape, basePosition=[x * SCALE for x in centre], physicsClientId=c))
        self._walls.append(body)
        return body

    def add_item(self, item: PhysicsItem) -> int:
        """An item."""
        p, c = pybullet, self.client
        if item not in self._shapes:
            self._shapes[item] = self._shape(item)
        body = int(p.createMultiBody(item.mass, self._shapes[item], physicsClientId=c))
        p.changeDynamics(
            body,
            -1,
            localInertiaDiagonal=(item.moments * SCALE**2).tolist(),
            linearDamping=0.0,
            angularDamping=0.0,
            physicsClientId=c,
        )
        return body

    def add_rod(self, length: float, radius: float, *, rounded: bool) -> int:
        """A cylinder or capsule that passes through everything."""
        p, c = pybullet, self.client
        kind = p.GEOM_CAPSULE if rounded else p.GEOM_CYLINDER
        size = {"radius": radius * SCALE, "height": length * SCALE}
        shape = p.createCollisionShape(kind, **size, physicsClientId=c)
        body = int(p.createMultiBody(0.0, shape, physicsClientId=c))
        self.ghost(body)
        return body

    def remove(self, body: int) -> None:
        """Take an item out."""
        pybullet.removeBody(body, physicsClientId=self.client)
        self._told.pop(body, None)

    def place(self, body: int, rotation: FloatArray, position: FloatArray) -> None:
        """Put a body frame somewhere, at rest."""
        p, c = pybullet, self.client
        quaternion = rotation_to_quaternion(rotation).tolist()
        p.resetBasePositionAndOrientation(body, (position * SCALE).tolist(), quaternion, physicsClientId=c)
        p.resetBaseVelocity(body, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], physicsClientId=c)

    def pose(self, body: int) -> RawPose:
        """Where the body frame is."""
        at, turn = pybullet.getBasePositionAndOrientation(body, physicsClientId=self.client)
        return np.array(at) / SCALE, np.array(turn)

    def velocity(self, body: int) -> tuple[FloatArray, FloatArray]:
        """Linear and angular."""
        linear, angular = pybullet.getBaseVelocity(body, physicsClientId=self.client)
        return np.array(linear) / SCALE, np.array(angular)

    def step(self) -> None:
        """One time step."""
        pybullet.stepSimulation(physicsClientId=self.client)

    def pace(self, time_step: float) -> None:
        """Go on at a time step."""
        pybullet.setPhysicsEngineParameter(fixedTimeStep=time_step, physicsClientId=self.client)

    def gravity(self, acceleration: Sequence[float]) -> None:
        """Set it."""
        pybullet.setGravity(*(g * SCALE for g in acceleration), physicsClientId=self.client)

    def rub(self, items: Mapping[int, float], container: float) -> None:
        """Set friction: Bullet multiplies the two of a contact, and adds rolling crosswise.

        Where coefficients differ, no factor of each body makes the lesser of two of every product. With t the
        largest one of the items here (at most the container's), the container has √t and an item of μ has μ / √t.
        So an item and the container have μ, two items μ₁ μ₂ / t: the lesser where either has t, less than that
        otherwise, never more. Rolling resistance is between half and all of what is configured, at least where
        one surface is the container or an item of t.
        """
        top = max(items.values(), default=container)
        root = math.sqrt(top)
        for body in (*self._walls, *items):
            own = root if body not in items or not root else root * (items[body] / top)
            rolling = self._rolling * SCALE / (2.0 * root) if root > 0.0 else 0.0
            surface = {"lateralFriction": own, "rollingFriction": rolling, "restitution": 0.0}
            if self.config.anchored:
                surface["frictionAnchor"] = 1
            if self._told.get(body) != surface:
                self._told[body] = surface
                pybullet.changeDynamics(body, -1, **surface, physicsClientId=self.client)

    def ghost(self, body: int) -> None:
        """Let a body pass through everything."""
        self._collide(body, 0)

    def solid(self, body: int) -> None:
        """Undo it."""
        self._collide(body, -1)

    def touches(self, body: int, others: Sequence[int]) -> list[Touch]:
        """What a body is in now."""
        found: list[Touch] = []
        for other in others:
            records = pybullet.getClosestPoints(body, other, 0.0, physicsClientId=self.client)
            # Asked for a distance of 0 it also tells of what is a little farther.
            found += [touch for touch in map(_touch, records) if touch.depth > 0.0]
        return found

    def pushes(self, body: int) -> list[Push]:
        """Contact forces on a body in the last step."""
        records = pybullet.getContactPoints(bodyA=body, physicsClientId=self.client)
        return [
            Push(
                record[2],
                np.array(record[6]) / SCALE,
                sum(
                    (record[f] * np.array(record[d]) for f, d in ((9, 7), (10, 11), (12, 13))),
                    start=np.zeros(3),
                )
                / SCALE,
            )
            for record in records
        ]

    def sleep(self, bodies: Sequence[int]) -> None:
        """Hold items; Bullet wakes an item that an awake one touches, and with it all that touch it in turn."""
        p, c = pybullet, self.client
        for body in bodies:
            p.resetBaseVelocity(body, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], physicsClientId=c)
            for state in (p.ACTIVATION_STATE_ENABLE_SLEEPING, p.ACTIVATION_STATE_SLEEP):
                p.changeDynamics(body, -1, activationState=state, physicsClientId=c)

    def wake(self, bodies: Sequence[int]) -> None:
        """Let items move."""
        awake = pybullet.ACTIVATION_STATE_DISABLE_SLEEPING
        for body in bodies:
            pybullet.changeDynamics(body, -1, activationState=awake, physicsClientId=self.client)

    def _collide(self, body: int, mask: int) -> None:
        group = 1 if mask else 0
        pybullet.setCollisionFilterGroupMask(body, -1, group, mask, physicsClientId=self.client)

    def _shape(self, item: PhysicsItem) -> int:
        p, c = pybullet, self.client
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


def _free(client: int, folder: Path) -> None:
    """Close a client; the window's user may have done so already."""
    if pybullet.isConnected(client):
        pybullet.disconnect(client)
    shutil.rmtree(folder, ignore_errors=True)


def _touch(record: Sequence[Any]) -> Touch:
    """A contact as PyBullet tells it."""
    depth = -float(record[8]) / SCALE
    return Touch(record[1], record[2], depth, np.array(record[6]) / SCALE, np.array(record[7]))


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
