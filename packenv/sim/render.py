"""Pictures of a packing, drawn by PyBullet: container, items and robot as surfaces, without physics."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import weakref
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import pybullet
from numpy.typing import NDArray

from packenv.errors import InputError
from packenv.geometry.transforms import rotation_to_quaternion
from packenv.quiet import engine_muted
from packenv.robot.cell import Cell, CellSetup
from packenv.robot.files import default_cell
from packenv.sim.backdrop import Standing, View, backdrop
from packenv.sim.closing import Closing
from packenv.sim.view_meshes import view_mesh
from packenv.types import Container, FloatArray, Item

Colour: TypeAlias = Callable[[int], tuple[int, int, int]]
"""Place in the packing sequence, from 0, to (red, green, blue), 0 to 255."""

Placed: TypeAlias = tuple[Item, FloatArray, FloatArray]
"""An item with its (3, 3) rotation and (3,) position, mesh frame to container frame, m."""

_WALL = 0.004
_EDGE = 0.0025
_TABLE = (0.925, 0.91, 0.88)
_FLOOR = (0.80, 0.72, 0.60)
_SIDES = (0.88, 0.81, 0.70)
_EDGES = (0.42, 0.36, 0.29)
_PARKED = 0.12
"""How far above the rim the cup waits at home, m."""
_MOST_SHAPES = 256
"""Bullet never forgets a shape; with more than this the scene is built anew."""


class Renderer(Closing):
    """Draws packings. Close it, or use it in a ``with`` statement.

    The camera looks from the container's far right corner above the rim toward the robot. The two walls on
    its side are left out but for their edges. What was drawn last stays: items that come to those of the last
    picture are added, the others moved, so a picture costs little more than its pixels.

    The same scene gives the same picture, whatever was drawn before.
    """

    def __init__(
        self,
        colour: Colour,
        *,
        setup: CellSetup | None = None,
        mode: Literal["rgb_array", "human"] = "rgb_array",
        egl: bool | None = None,
    ) -> None:
        """Open the engine.

        Args:
            colour: of the items by their place in the sequence.
            setup: the robot cell; None is the usual one.
            mode: ``rgb_array`` for :meth:`frame`; ``human`` opens PyBullet's window for :meth:`show`.
            egl: draw with OpenGL by PyBullet's EGL plugin where it loads, else as without; None:
                only where there is a graphics card, without which OpenGL may take ten times as long.

        Raises:
            InputError: ``human`` without a display, or a second window.
        """
        if mode == "human" and sys.platform == "linux" and not os.environ.get("DISPLAY"):
            raise InputError(
                "render mode 'human': there is no display (DISPLAY is not set); 'rgb_array' needs none"
            )
        self.colour = colour
        self.setup = setup or default_cell()
        self.mode = mode
        with engine_muted():
            try:
                self._client: int = pybullet.connect(pybullet.GUI if mode == "human" else pybullet.DIRECT)
            except pybullet.error as problem:
                why = str(problem).partition(".")[0]
                raise InputError(f"render mode {mode!r}: PyBullet opens no window ({why})") from None
            wanted = _graphics_card() if egl is None else egl
            plugin = _load_egl(self._client) if wanted and mode == "rgb_array" else -1
        self._folder = Path(tempfile.mkdtemp(prefix="robotpack-"))
        self._free = weakref.finalize(self, _free, self._client, plugin, self._folder)
        self.hardware = plugin >= 0
        self._container: Container | None = None
        self._robot = -1
        self._home: FloatArray | None = None
        self._backdrop = np.empty((0, 0, 3), dtype=np.uint8)
        self._shapes: dict[str, int] = {}
        self._shown: list[tuple[str, int]] = []

    def close(self) -> None:
        """Free the engine; twice is fine, and a renderer that is forgotten is closed too."""
        self._free()

    @property
    def open(self) -> bool:
        """Whether it has not been closed."""
        return self._free.alive

    def frame(
        self,
        container: Container,
        items: Sequence[Placed],
        joints: FloatArray | None = None,
        *,
        size: tuple[int, int] = (480, 480),
    ) -> NDArray[np.uint8]:
        """Draw a picture.

        Args:
            container: the box.
            items: what is in it, or in the hand, in packing sequence.
            joints: (6,) of the robot, rad; None puts the cup above the middle of the rim.
            size: width and height, pixels.

        Returns:
            (height, width, 3) red, green, blue.
        """
        with self._quiet():
            self._draw(container, items, joints)
        width, height = size
        kind = pybullet.ER_BULLET_HARDWARE_OPENGL if self.hardware else pybullet.ER_TINY_RENDERER
        view = _view(container)
        _, _, rgba, _, seen = pybullet.getCameraImage(
            width,
            height,
            view.matrix,
            view.projection(width / height),
            lightDirection=[0.45, -0.8, 1.6],
            lightColor=[1.0, 1.0, 1.0],
            lightDistance=3.0,
            shadow=0,
            lightAmbientCoeff=0.62,
            lightDiffuseCoeff=0.42,
            lightSpecularCoeff=0.06,
            renderer=kind,
            physicsClientId=self._client,
        )
        picture = np.array(rgba, dtype=np.uint8).reshape(height, width, 4)[:, :, :3]
        empty = np.asarray(seen).reshape(height, width) < 0
        if self._backdrop.shape != picture.shape:
            self._backdrop = backdrop(_view(container), size, _standing(self.setup.with_container(container)))
        return np.where(empty[:, :, None], self._backdrop, picture)

    def show(self, container: Container, items: Sequence[Placed], joints: FloatArray | None = None) -> None:
        """Bring the window up to date; arguments as of :meth:`frame`."""
        p, c = pybullet, self._client
        anew = container != self._container
        # Otherwise the window is painted anew for every body.
        p.configureDebugVisualizer(p.COV_ENABLE_RENDERING, 0, physicsClientId=c)
        with self._quiet():
            self._draw(container, items, joints)
        if anew:
            view = _view(container)
            yaw, pitch = view.yaw_and_pitch
            p.configureDebugVisualizer(p.COV_ENABLE_GUI, 0, physicsClientId=c)
            # The window's field of view is wider than the picture's.
            near = 0.65 * view.distance
            p.resetDebugVisualizerCamera(near, yaw, pitch, view.target.tolist(), physicsClientId=c)
        p.configureDebugVisualizer(p.COV_ENABLE_RENDERING, 1, physicsClientId=c)

    def _quiet(self) -> AbstractContextManager[None]:
        """OpenGL comments on every shape; the built-in renderer says nothing."""
        return engine_muted() if self.hardware or self.mode == "human" else nullcontext()

    def _draw(self, container: Container, items: Sequence[Placed], joints: FloatArray | None) -> None:
        if not self.open:
            raise RuntimeError("the renderer is closed")
        if container != self._container or len(self._shapes) > _MOST_SHAPES:
            self._build(container)
        self._place(items)
        chosen = self._home if joints is None else joints
        if chosen is not None:
            for joint, value in enumerate(np.asarray(chosen, dtype=np.float64).tolist()):
                pybullet.resetJointState(self._robot, joint, value, physicsClientId=self._client)

    def _place(self, items: Sequence[Placed]) -> None:
        kept = 0
        for (digest, _), (item, _, _) in zip(self._shown, items, strict=False):
            if digest != item.sha256:
                break
            kept += 1
        for _, body in self._shown[kept:]:
            pybullet.removeBody(body, physicsClientId=self._client)
        del self._shown[kept:]
        for k, (item, rotation, position) in enumerate(items):
            if k == len(self._shown):
                self._shown.append((item.sha256, self._add(item, k)))
            turned = rotation_to_quaternion(np.asarray(rotation)).tolist()
            at = np.asarray(position, dtype=np.float64).tolist()
            pybullet.resetBasePositionAndOrientation(
                self._shown[k][1], at, turned, physicsClientId=self._client
            )

    def _add(self, item: Item, place: int) -> int:
        p, c = pybullet, self._client
        if item.sha256 not in self._shapes:
            # Named by content, for Bullet never reads a path again.
            path = self._folder / f"{item.sha256}.obj"
            if not path.exists():
                path.write_text(view_mesh(item).obj_text(), encoding="ascii")
            shape = p.createVisualShape(p.GEOM_MESH, fileName=str(path), physicsClientId=c)
            self._shapes[item.sha256] = shape
        shape = self._shapes[item.sha256]
        body = p.createMultiBody(0.0, -1, shape, physicsClientId=c)
        rgb = [channel / 255 for channel in self.colour(place)]
        p.changeVisualShape(body, -1, rgbaColor=[*rgb, 1.0], specularColor=[0.1, 0.1, 0.1], physicsClientId=c)
        return int(body)

    def _build(self, container: Container) -> None:
        """An empty container on the table, with the robot beside it."""
        p, c = pybullet, self._client
        p.resetSimulation(physicsClientId=c)
        for path in self._folder.glob("*.obj"):
            path.unlink()
        self._container = container
        self._shapes, self._shown = {}, []
        self._backdrop = np.empty((0, 0, 3), dtype=np.uint8)
        for half, centre, rgb in _furniture(container, table=self.mode == "human"):
            shape = p.createVisualShape(
                p.GEOM_BOX,
                halfExtents=half,
                rgbaColor=[*rgb, 1.0],
                specularColor=[0, 0, 0],
                physicsClientId=c,
            )
            p.createMultiBody(0.0, -1, shape, centre, physicsClientId=c)
        cell = self.setup.with_container(container)
        urdf = self._folder / "robot.urdf"
        urdf.write_text(cell.robot.urdf(), encoding="utf-8")
        base = cell.to_container(np.zeros(3)).tolist()
        self._robot = p.loadURDF(
            str(urdf),
            base,
            p.getQuaternionFromEuler([0.0, 0.0, -cell.yaw]),
            useFixedBase=True,
            physicsClientId=c,
        )
        self._home = _home(cell)


def _free(client: int, plugin: int, folder: Path) -> None:
    # The window's user may have closed it already.
    if pybullet.isConnected(client):
        with engine_muted() if plugin >= 0 else nullcontext():
            if plugin >= 0:
                pybullet.unloadPlugin(plugin, physicsClientId=client)
            pybullet.disconnect(client)
    shutil.rmtree(folder, ignore_errors=True)


def _graphics_card() -> bool:
    """Whether this machine has a device that OpenGL can draw with."""
    devices = Path("/dev")
    return any(devices.glob("dri/renderD*")) or any(devices.glob("nvidia[0-9]*"))


def _load_egl(client: int) -> int:
    """Number of the EGL plugin; negative where it does not load."""
    import importlib.util

    found = importlib.util.find_spec("eglRenderer")
    if found is None or found.origin is None:
        return -1
    return int(pybullet.loadPlugin(found.origin, "_eglRendererPlugin", physicsClientId=client))


def _home(cell: Cell) -> FloatArray | None:
    """Joints with the cup above the middle of the rim; None where the arm does not get there."""
    length, width, height = cell.container.size
    found = cell.clear_branches(cell.top_down_path(np.array([length / 2, width / 2, height + _PARKED]), 0.0))
    return found.q[0, 0] if len(found.q) else None


def _view(container: Container) -> View:
    """From beyond the far right corner, above the rim, toward the robot."""
    length, width, height = container.size
    target = np.array([length * 0.38, width * 0.55, height * 0.97])
    return View(target + max(length, width, height) * np.array([2.0, -3.1, 2.45]), target, 37.0)


def _standing(cell: Cell) -> tuple[Standing, ...]:
    """What darkens the table."""
    length, width, _ = cell.container.size
    x, y, _ = cell.to_container(np.zeros(3)).tolist()
    foot = (x, y)
    return (
        Standing((0.0, 0.0), (length, width), _WALL),
        Standing(
            foot,
            foot,
            cell.robot.shapes.primitives[0].radius,
        ),
    )


def _furniture(
    container: Container, *, table: bool
) -> list[tuple[list[float], list[float], tuple[float, float, float]]]:
    """Half extents, centre and colour of floor, back walls, edges and, for a window, the table, m."""
    length, width, height = container.size
    w, e = _WALL, _EDGE
    boxes = [
        ((-w, -w, -w), (length + w, width + w, 0.0), _FLOOR),
        ((-w, -w, 0.0), (0.0, width + w, height), _SIDES),
        ((0.0, width, 0.0), (length + w, width + w, height), _SIDES),
    ]
    corners = [(x, y) for x in (-w / 2, length + w / 2) for y in (-w / 2, width + w / 2)]
    boxes += [((x - e, y - e, 0.0), (x + e, y + e, height), _EDGES) for x, y in corners]
    for z in (0.0, height):
        boxes += [((x - e, -w, z - e), (x + e, width + w, z + e), _EDGES) for x in (-w / 2, length + w / 2)]
        boxes += [((-w, y - e, z - e), (length + w, y + e, z + e), _EDGES) for y in (-w / 2, width + w / 2)]
    if table:
        boxes.append(((-1.2, -0.9, -w - 0.05), (length + 0.9, width + 0.9, -w), _TABLE))
    low, high = (np.array([box[k] for box in boxes]) for k in (0, 1))
    half, centre = ((high - low) / 2).tolist(), ((high + low) / 2).tolist()
    return [(half[k], centre[k], box[2]) for k, box in enumerate(boxes)]
