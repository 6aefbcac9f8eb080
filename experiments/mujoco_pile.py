"""Items in a container in MuJoCo: a second engine, of another kind than Bullet, for the same rigid bodies.

Bullet resolves contacts of hard bodies iteratively; MuJoCo minimizes a convex function with contacts that
give way a little. Nothing is shared but what goes in: parts, masses, inertia, friction, and the walls'
places.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from packenv.config import GRAVITY
from packenv.geometry.transforms import quaternion_to_rotation, rotation_to_quaternion
from packenv.sim.physics_items import PhysicsItem
from packenv.types import Container, FloatArray

_WALL = 0.05
_PARKED = 10.0
"""Where items wait for their release, m from the container and from each other."""


@dataclass(frozen=True)
class MujocoConfig:
    """The settings of MuJoCo.

    With these, piles of ten scanned items creep by at most 0.10 mm in 10 s and sink by less than 0.1 mm into
    each other. With ``noslip`` 0 they creep by up to 3 mm; with ``softness`` 0.02 they sink by 1 mm; and with
    ``softness`` of two time steps only, what slides fast hops.

    Attributes:
        mu: coefficient of friction between any two surfaces.
        rolling: lever arm of rolling and of turning resistance, m, as in
            :class:`packenv.sim.world.WorldConfig`.
        time_step: s.
        softness: time in which a contact pushes bodies apart, s; MuJoCo asks for two time steps or more.
        impratio: how much harder contacts are sideways than along the normal: against creep.
        noslip: iterations that take the remaining creep out of contacts that stick.
    """

    mu: float = 0.7
    rolling: float = 0.0005
    time_step: float = 0.001
    softness: float = 0.004
    impratio: float = 10.0
    noslip: int = 20


@dataclass(frozen=True)
class Meeting:
    """A contact of an item with another one, or with the container.

    Attributes:
        other: index of the other item; -1 for the container.
        depth: how far the surfaces are in each other, m; negative where they are apart.
    """

    other: int
    depth: float


class MujocoPile:
    """A container and all items of a plan; each waits, held against gravity, until it is released.

    To watch for rest it looks like a :class:`packenv.sim.world.World`: ``time``, ``config.time_step``,
    ``items``, ``step``, ``raw_pose`` and ``travel``.
    """

    def __init__(
        self,
        container: Container,
        items: Sequence[PhysicsItem],
        config: MujocoConfig | None = None,
        gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY),
    ) -> None:
        """Build the model.

        Args:
            container: its frame is the world's.
            items: in packing sequence.
            config: settings.
            gravity: m/s².
        """
        self.config = config or MujocoConfig()
        self._items = tuple(items)
        self._model = _spec(container, items, self.config, gravity).compile()
        self._data = mujoco.MjData(self._model)
        self._released = 0
        bodies = [self._model.body(f"item_{k}").id for k in range(len(items))]
        self._bodies = np.array(bodies, dtype=int)
        self._owner = np.full(self._model.nbody, -1)
        self._owner[self._bodies] = np.arange(len(items))
        self._qpos = self._model.jnt_qposadr[self._model.body_jntadr[self._bodies]]
        self._qvel = self._model.jnt_dofadr[self._model.body_jntadr[self._bodies]]

    @property
    def time(self) -> float:
        """Simulated, s."""
        return float(self._data.time)

    @property
    def items(self) -> tuple[int, ...]:
        """Indices of the items that were released."""
        return tuple(range(self._released))

    def release(self, rotation: FloatArray, position: FloatArray) -> tuple[Meeting, ...]:
        """Let go of the next item, at rest.

        Args:
            rotation: (3, 3) mesh frame to container frame.
            position: (3,) m.

        Returns:
            what it meets there.
        """
        k = self._released
        turned, at = self._items[k].body_pose(rotation, position)
        q, v = self._qpos[k], self._qvel[k]
        x, y, z, w = rotation_to_quaternion(turned)
        self._data.qpos[q : q + 7] = [*at, w, x, y, z]
        self._data.qvel[v : v + 6] = 0.0
        self._model.body_gravcomp[self._bodies[k]] = 0.0
        self._released += 1
        mujoco.mj_forward(self._model, self._data)
        return self.meetings(k)

    def meetings(self, k: int) -> tuple[Meeting, ...]:
        """Contacts of an item, as of the last step or release."""
        owner = self._owner[self._model.geom_bodyid]
        found = []
        for contact in self._data.contact:
            a, b = int(owner[contact.geom1]), int(owner[contact.geom2])
            if k in (a, b):
                found.append(Meeting(b if a == k else a, -float(contact.dist)))
        return tuple(found)

    def step(self) -> None:
        """One time step.

        Raises:
            RuntimeError: MuJoCo gave up: numbers out of range, or more contacts than it has memory for.
        """
        mujoco.mj_step(self._model, self._data)
        if any(self._data.warning.number):
            told = [mujoco.mju_warningText(k, 0) for k, n in enumerate(self._data.warning.number) if n]
            raise RuntimeError(f"MuJoCo: {'; '.join(told)}")

    def pose(self, k: int) -> tuple[FloatArray, FloatArray]:
        """(3, 3) and (3,) of an item's mesh frame, m."""
        at, turn = self.raw_pose(k)
        return self._items[k].mesh_pose(quaternion_to_rotation(turn), at)

    def raw_pose(self, k: int) -> tuple[FloatArray, FloatArray]:
        """(3,) centre of mass, m, and (4,) quaternion xyzw of the body frame."""
        q = self._qpos[k]
        at, turn = self._data.qpos[q : q + 3].copy(), self._data.qpos[q + 3 : q + 7]
        return at, np.array([turn[1], turn[2], turn[3], turn[0]])

    def travel(self, k: int, at: FloatArray, turn: FloatArray) -> float:
        """A bound on how far any point of an item is from where it was at an earlier pose, m."""
        now, turned = self.raw_pose(k)
        half = min(float(np.linalg.norm(turned - turn)), float(np.linalg.norm(turned + turn)))
        return math.dist(now, at) + 2.0 * half * self._items[k].reach


def _spec(
    container: Container,
    items: Sequence[PhysicsItem],
    config: MujocoConfig,
    gravity: tuple[float, float, float],
) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep = config.time_step
    option.gravity = gravity
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = config.impratio
    option.noslip_iterations = config.noslip
    # Newer versions find several contacts of two hulls unasked.
    option.enableflags |= getattr(mujoco.mjtEnableBit, "mjENBL_MULTICCD", 0)
    spec.memory = 256 << 20
    surface = {
        "friction": [config.mu, config.rolling, config.rolling],
        "condim": 6,
        "solref": [config.softness, 1.0],
    }
    for half, centre in _walls(container):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=centre, **surface)
    for k, item in enumerate(items):
        body = spec.worldbody.add_body(name=f"item_{k}", pos=[_PARKED * (1 + k), 0.0, 0.0], gravcomp=1.0)
        body.add_freejoint()
        # The body frame is the principal frame, so that the inertia needs no frame of its own.
        body.explicitinertial = True
        body.mass, body.inertia = item.mass, item.moments
        body.ipos, body.iquat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
        if item.radius > 0.0:
            size = [item.radius, 0.0, 0.0]
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=size, pos=item.ball_centre, **surface)
        for j, part in enumerate(item.parts):
            name = f"item_{k}_part_{j}"
            # Mass and inertia are given, and some parts are too thin for a volume.
            spec.add_mesh(
                name=name, uservert=part.ravel(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            )
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **surface)
    return spec


def _walls(container: Container) -> list[tuple[list[float], list[float]]]:
    """Half extents and centre of the floor and the four walls, m."""
    size, t = np.array(container.size), _WALL / 2.0
    boxes = []
    for axis, low in ((2, True), (0, True), (0, False), (1, True), (1, False)):
        half = size / 2.0 + (2.0 * t if axis == 2 else 0.0)
        half[axis] = t
        if axis != 2:
            half[1 - axis] += 2.0 * t
        centre = size / 2.0
        centre[axis] = -t if low else size[axis] + t
        boxes.append((half.tolist(), centre.tolist()))
    return boxes
