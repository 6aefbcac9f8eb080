"""MuJoCo as an engine.

A model is compiled, and its bodies cannot be added later: what comes is compiled in with what is there, and bodies
that are taken out are parked for the next one of their shape. Contacts of convex parts give way a little, and are
stiff enough here that piles sink by less than 0.1 mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import mujoco
import numpy as np

from packenv.config import EngineName
from packenv.geometry.transforms import rotation_to_quaternion
from packenv.sim.engine import Engine, EngineConfig, Push, RawPose, Touch
from packenv.sim.physics_items import PhysicsItem
from packenv.types import FloatArray

_PARKED = 10.0
"""Where bodies wait that are not in the world, m from it and from each other."""
_ARENA = 64 << 20
"""Memory for contacts, bytes; what is not used is never touched."""
_SOLID, _ASKED = 1, 2
"""Bits of the collision masks: bodies that push each other; bodies whose overlap is asked for."""


@dataclass(frozen=True, kw_only=True)
class MujocoConfig(EngineConfig):
    """The settings of MuJoCo.

    Attributes:
        time_step: s.
        softness: time in which a contact pushes bodies apart, s; MuJoCo asks for two time steps or more.
        impratio: how much harder contacts are sideways than along the normal: against creep.
        noslip: iterations that take the remaining creep out of contacts that stick; they cost more than all else.
    """

    name: ClassVar[EngineName] = "mujoco"
    time_step: float = 0.002
    softness: float = 0.005
    impratio: float = 60.0
    noslip: int = 0

    def start(self, rolling: float, *, gui: bool = False) -> MujocoEngine:
        """An engine without bodies; it has no window."""
        return MujocoEngine(self, rolling)


@dataclass(eq=False)
class _Body:
    """A body of the model, or a wall.

    Attributes:
        name: in the model.
        item: of its shape, kept so that no other shape gets its identity; None for walls and rods.
        ghost: it passes through everything.
        node: of the model.
        geoms: of the model.
        q, v: where its coordinates begin; of a wall nothing.
    """

    name: str
    item: PhysicsItem | None = None
    ghost: bool = False
    node: int = 0
    geoms: slice = field(default_factory=lambda: slice(0, 0))
    q: int = -1
    v: int = -1


class MujocoEngine(Engine):
    """A model of MuJoCo and its state."""

    failure = mujoco.FatalError

    def __init__(self, config: MujocoConfig, rolling: float) -> None:
        """Begin with nothing."""
        self._spec = _spec(config)
        self._bodies: dict[int, _Body] = {}
        self._parked: dict[object, list[_Body]] = {}
        self._items: dict[int, PhysicsItem] = {}
        self._count = 0
        self._friction: tuple[dict[int, float], float] = ({}, 1.0)
        self._surface: dict[str, Any] = {
            "friction": [1.0, rolling, rolling],
            # Rolling and turning resistance, of all: with less, items that rock come to rest later.
            "condim": 6,
            "solref": [config.softness, 1.0],
        }
        self._model: Any = None
        self._data: Any = None
        self._stale = True

    def close(self) -> None:
        """Free the engine's memory; twice is fine."""
        self._model = self._data = None

    def add_wall(self, half: Sequence[float], centre: Sequence[float]) -> int:
        """A box that never moves."""
        # A geometry of the world itself has no body: it is told apart by its own name.
        name = f"wall_{self._count}"
        box = mujoco.mjtGeom.mjGEOM_BOX
        self._spec.worldbody.add_geom(name=name, type=box, size=half, pos=centre, **self._surface)
        self._stale = True
        return self._number(_Body(name))

    def add_item(self, item: PhysicsItem) -> int:
        """An item: a parked body of its shape, or a new one."""
        shape = _shape_of(item)
        parked = self._parked.get(shape)
        body = parked.pop() if parked else self._new_item(item)
        number = self._number(body)
        self._items[number] = item
        body.ghost = False
        if not self._stale:
            self._tell(number, body)
        return number

    def expect(self, items: Sequence[PhysicsItem]) -> None:
        """Park a body for each item, to compile once."""
        for item in items:
            self._parked.setdefault(_shape_of(item), []).append(self._new_item(item))

    def add_rod(self, length: float, radius: float, *, rounded: bool) -> int:
        """A cylinder or capsule that passes through everything."""
        kind = mujoco.mjtGeom.mjGEOM_CAPSULE if rounded else mujoco.mjtGeom.mjGEOM_CYLINDER
        name = f"rod_{self._count}"
        rod = self._new_body(name)
        rod.add_geom(type=kind, size=[radius, length / 2.0, 0.0], **self._surface)
        rod.mass, rod.inertia = 1.0, [1.0, 1.0, 1.0]
        return self._number(_Body(name, ghost=True))

    def remove(self, body: int) -> None:
        """Park an item."""
        gone = self._bodies.pop(body)
        del self._items[body]
        gone.ghost = True
        assert gone.item is not None
        self._parked.setdefault(_shape_of(gone.item), []).append(gone)
        if not self._stale:
            self._park(gone)

    def place(self, body: int, rotation: FloatArray, position: FloatArray) -> None:
        """Put a body frame somewhere, at rest."""
        self._fresh()
        x, y, z, w = rotation_to_quaternion(rotation).tolist()
        self._put(self._bodies[body], [*position.tolist(), w, x, y, z])

    def pose(self, body: int) -> RawPose:
        """Where the body frame is."""
        self._fresh()
        q = self._bodies[body].q
        x, y, z, w, i, j, k = self._data.qpos[q : q + 7].tolist()
        return np.array([x, y, z]), np.array([i, j, k, w])

    def velocity(self, body: int) -> tuple[FloatArray, FloatArray]:
        """Linear and angular."""
        self._fresh()
        found = self._bodies[body]
        speed = self._data.qvel[found.v : found.v + 6].copy()
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, self._data.qpos[found.q + 3 : found.q + 7])
        # MuJoCo has the spin of a free body in the body's own axes.
        return speed[:3], turn.reshape(3, 3) @ speed[3:]

    def step(self) -> None:
        """One time step.

        Raises:
            RuntimeError: MuJoCo gave up: numbers out of range, or more contacts than it has memory for.
        """
        self._fresh()
        mujoco.mj_step(self._model, self._data)
        if self._data.warning.number.any():
            told = [mujoco.mju_warningText(k, 0) for k, n in enumerate(self._data.warning.number) if n]
            raise RuntimeError(f"MuJoCo: {'; '.join(told)}")

    def pace(self, time_step: float) -> None:
        """Go on at a time step."""
        self._spec.option.timestep = time_step
        if self._model is not None:
            self._model.opt.timestep = time_step

    def gravity(self, acceleration: Sequence[float]) -> None:
        """Set it."""
        self._spec.option.gravity = list(acceleration)
        if self._model is not None:
            self._model.opt.gravity[:] = acceleration

    def rub(self, items: Mapping[int, float], container: float) -> None:
        """Set friction: the surface of higher priority counts, so the more slippery one gets it."""
        self._friction = (dict(items), container)
        if not self._stale:
            self._tell_friction()

    def ghost(self, body: int) -> None:
        """Let an item pass through everything, and not fall."""
        self._bodies[body].ghost = True
        if not self._stale:
            self._tell_masks(self._bodies[body])

    def solid(self, body: int) -> None:
        """Undo it."""
        self._bodies[body].ghost = False
        if not self._stale:
            self._tell_masks(self._bodies[body])

    def touches(self, body: int, others: Sequence[int]) -> list[Touch]:
        """What a body is in now: MuJoCo's own search for contacts, of this body alone."""
        if not others:
            return []
        self._fresh()
        model, data = self._model, self._data
        kept = [mask.copy() for mask in self._masks()]
        for mask in self._masks():
            mask[:] = 0
        own = self._bodies[body]
        model.geom_contype[own.geoms], model.body_contype[own.node] = _ASKED, _ASKED
        for other in others:
            found = self._bodies[other]
            model.geom_conaffinity[found.geoms] = _ASKED
            model.body_conaffinity[found.node] = _ASKED
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        for mask, before in zip(self._masks(), kept, strict=True):
            mask[:] = before
        contacts = data.contact
        touches = []
        for (one, two), distance, point, frame in zip(
            contacts.geom.tolist(), contacts.dist.tolist(), contacts.pos, contacts.frame, strict=True
        ):
            second = own.geoms.start <= two < own.geoms.stop
            # MuJoCo's normal leads from the first into the second, and its point is halfway between the surfaces.
            normal = frame[:3] if second else -frame[:3]
            depth = -distance
            if depth > 0.0:
                other = int(self._owner[one if second else two])
                touches.append(Touch(body, other, depth, point + normal * (depth / 2.0), normal.copy()))
        return touches

    def pushes(self, body: int) -> list[Push]:
        """Contact forces on a body in the last step."""
        self._fresh()
        own = self._bodies[body].geoms
        found = []
        force = np.empty(6)
        for k, contact in enumerate(self._data.contact):
            one, two = (own.start <= int(g) < own.stop for g in contact.geom)
            if one == two:
                continue
            mujoco.mj_contactForce(self._model, self._data, k, force)
            # On the second body, in the contact's frame.
            push = contact.frame.reshape(3, 3).T @ force[:3]
            other = int(self._owner[contact.geom[0 if two else 1]])
            found.append(Push(other, contact.pos.copy(), push if two else -push))
        return found

    def sleep(self, bodies: Sequence[int]) -> None:
        """Hold items: they stand still, until the next step."""
        self._fresh()
        for body in bodies:
            v = self._bodies[body].v
            self._data.qvel[v : v + 6] = 0.0

    def wake(self, bodies: Sequence[int]) -> None:
        """Nothing sleeps."""

    def _number(self, body: _Body) -> int:
        number = self._count
        self._count += 1
        self._bodies[number] = body
        return number

    def _new_body(self, name: str) -> Any:
        self._stale = True
        body = self._spec.worldbody.add_body(
            name=name, pos=[_PARKED * (1 + self._count), 0.0, -_PARKED], gravcomp=1.0
        )
        body.add_freejoint()
        # The body frame is the principal frame, so that the inertia needs no frame of its own.
        body.explicitinertial = True
        body.ipos, body.iquat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
        return body

    def _new_item(self, item: PhysicsItem) -> _Body:
        name = f"item_{self._count}"
        self._count += 1
        body = self._new_body(name)
        body.mass, body.inertia = item.mass, item.moments
        if item.radius > 0.0:
            ball = mujoco.mjtGeom.mjGEOM_SPHERE
            body.add_geom(type=ball, size=[item.radius, 0.0, 0.0], pos=item.ball_centre, **self._surface)
        for k, part in enumerate(item.parts):
            mesh = f"{name}_{k}"
            # Mass and inertia are given, and some parts are too thin for a volume.
            shell = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            self._spec.add_mesh(name=mesh, uservert=part.ravel(), inertia=shell)
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, **self._surface)
        return _Body(name, item, ghost=True)

    def _every(self) -> list[_Body]:
        """What is in the model: in the world, and parked."""
        return [*self._bodies.values(), *(body for parked in self._parked.values() for body in parked)]

    def _fresh(self) -> None:
        """Compile what was added, and go on from the state that was."""
        if not self._stale:
            return
        before = self._data
        model = self._spec.compile()
        data = mujoco.MjData(model)
        for body in self._every():
            old = (body.q, body.v)
            _find(model, body)
            if before is not None and old[0] >= 0:
                data.qpos[body.q : body.q + 7] = before.qpos[old[0] : old[0] + 7]
                for name in ("qvel", "qacc_warmstart"):
                    getattr(data, name)[body.v : body.v + 6] = getattr(before, name)[old[1] : old[1] + 6]
        self._model, self._data, self._stale = model, data, False
        self._owner = np.full(model.ngeom, -1)
        for number, body in self._bodies.items():
            self._owner[body.geoms] = number
        for body in self._every():
            self._tell_masks(body)
        for number in self._items:
            self._tell_mass(number)
        self._tell_friction()

    def _tell(self, number: int, body: _Body) -> None:
        """Make a parked body an item of the world."""
        self._owner[body.geoms] = number
        self._tell_masks(body)
        self._tell_mass(number)

    def _park(self, body: _Body) -> None:
        self._owner[body.geoms] = -1
        self._tell_masks(body)
        self._put(body, [_PARKED * (1 + body.node), 0.0, -_PARKED, 1.0, 0.0, 0.0, 0.0])

    def _put(self, body: _Body, coordinates: list[float]) -> None:
        self._data.qpos[body.q : body.q + 7] = coordinates
        self._data.qvel[body.v : body.v + 6] = 0.0
        self._data.qacc_warmstart[body.v : body.v + 6] = 0.0

    def _tell_mass(self, number: int) -> None:
        """Bodies of one shape may differ in mass."""
        model, node, item = self._model, self._bodies[number].node, self._items[number]
        if model.body_mass[node] != item.mass:
            model.body_mass[node], model.body_inertia[node] = item.mass, item.moments
            kept = self._data.qpos.copy()
            mujoco.mj_setConst(model, self._data)
            self._data.qpos[:] = kept

    def _tell_masks(self, body: _Body) -> None:
        mask = 0 if body.ghost else _SOLID
        self._model.geom_contype[body.geoms] = self._model.geom_conaffinity[body.geoms] = mask
        self._model.body_contype[body.node] = self._model.body_conaffinity[body.node] = mask
        self._model.body_gravcomp[body.node] = 1.0 if body.ghost else 0.0

    def _tell_friction(self) -> None:
        items, container = self._friction
        told = {number: items.get(number, container) for number in self._bodies}
        ranks = {mu: rank for rank, mu in enumerate(sorted(set(told.values()), reverse=True))}
        for number, mu in told.items():
            geoms = self._bodies[number].geoms
            self._model.geom_friction[geoms, 0] = mu
            self._model.geom_priority[geoms] = ranks[mu]

    def _masks(self) -> tuple[Any, ...]:
        model = self._model
        return model.geom_contype, model.geom_conaffinity, model.body_contype, model.body_conaffinity


def _shape_of(item: PhysicsItem) -> object:
    """The same for items of the same shape: copies of an item share its parts."""
    return ("ball", item.radius, *item.ball_centre.tolist()) if item.radius > 0.0 else id(item.parts)


def _find(model: Any, body: _Body) -> None:
    """Where a body is in a compiled model."""
    if body.name.startswith("wall"):
        geom = model.geom(body.name).id
        body.node, body.geoms = 0, slice(geom, geom + 1)
        return
    body.node = model.body(body.name).id
    first = int(model.body_geomadr[body.node])
    body.geoms = slice(first, first + int(model.body_geomnum[body.node]))
    joint = int(model.body_jntadr[body.node])
    body.q, body.v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])


def _spec(config: MujocoConfig) -> Any:
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep = config.time_step
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = config.impratio
    option.noslip_iterations = config.noslip
    # Newer versions find several contacts of two hulls unasked.
    option.enableflags |= getattr(mujoco.mjtEnableBit, "mjENBL_MULTICCD", 0)
    spec.memory = _ARENA
    return spec
