"""What physics asks of an engine: rigid bodies of convex parts, balls and rods under gravity."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from packenv.config import EngineName
from packenv.sim.closing import Closing
from packenv.sim.physics_items import PhysicsItem
from packenv.types import FloatArray

RawPose: TypeAlias = tuple[FloatArray, FloatArray]
"""(3,) origin of a body frame, m, and (4,) its quaternion xyzw."""


@dataclass(frozen=True, eq=False)
class Touch:
    """An overlap of two bodies.

    Attributes:
        body: the body that was asked for.
        other: the other body.
        depth: how far the surfaces are in each other, m.
        point: (3,) on ``other``, m.
        normal: (3,) unit, from ``other`` into ``body``.
    """

    body: int
    other: int
    depth: float
    point: FloatArray
    normal: FloatArray


@dataclass(frozen=True, eq=False)
class Push:
    """A contact force of the last step.

    Attributes:
        other: the body that pushes.
        point: (3,) where, m.
        force: (3,) on the body that was asked for, N.
    """

    other: int
    point: FloatArray
    force: FloatArray


@dataclass(frozen=True, kw_only=True)
class EngineConfig(ABC):
    """The settings of an engine.

    Attributes:
        time_step: s.
    """

    name: ClassVar[EngineName]
    time_step: float

    @abstractmethod
    def start(self, rolling: float, *, gui: bool = False) -> Engine:
        """An engine without bodies, under gravity.

        Args:
            rolling: lever arm of rolling resistance, m.
            gui: with a window.
        """


class Engine(Closing):
    """Rigid bodies in metres, kilograms and seconds. A body is a number; it has its body frame's pose.

    Attributes:
        failure: what the engine raises, for instance where its window was closed.
    """

    failure: type[Exception]

    @property
    def open(self) -> bool:
        """False once it is closed, by :meth:`close` or by the window's user."""
        return True

    def look(self, size: Sequence[float]) -> None:
        """Turn the window's camera to a container of a size (3,), m, where there is a window."""
        return

    @abstractmethod
    def add_wall(self, half: Sequence[float], centre: Sequence[float]) -> int:
        """A box that never moves: half extents and centre, m."""

    @abstractmethod
    def add_item(self, item: PhysicsItem) -> int:
        """An item, solid; :meth:`place` says where."""

    @abstractmethod
    def add_rod(self, length: float, radius: float, *, rounded: bool) -> int:
        """A cylinder or capsule along z, about its middle, that passes through everything and does not fall."""

    def expect(self, items: Sequence[PhysicsItem]) -> None:
        """Items that will be added: an engine may make room for all of them at once."""
        return

    @abstractmethod
    def remove(self, body: int) -> None:
        """Take an item out."""

    @abstractmethod
    def place(self, body: int, rotation: FloatArray, position: FloatArray) -> None:
        """Put a body frame somewhere, at rest: (3, 3) and (3,) m."""

    @abstractmethod
    def pose(self, body: int) -> RawPose:
        """Where the body frame is."""

    @abstractmethod
    def velocity(self, body: int) -> tuple[FloatArray, FloatArray]:
        """(3,) of the body frame's origin, m/s, and (3,) angular, rad/s, in the world's axes."""

    @abstractmethod
    def step(self) -> None:
        """One time step."""

    @abstractmethod
    def pace(self, time_step: float) -> None:
        """Go on at a time step, s."""

    @abstractmethod
    def gravity(self, acceleration: Sequence[float]) -> None:
        """(3,) m/s²."""

    @abstractmethod
    def rub(self, items: Mapping[int, float], container: float) -> None:
        """Set friction: of two bodies the lesser coefficient counts, or less where an engine knows no better.

        Args:
            items: coefficient of every item, at most the container's.
            container: of the walls.
        """

    @abstractmethod
    def ghost(self, body: int) -> None:
        """Let an item pass through everything, and not fall."""

    @abstractmethod
    def solid(self, body: int) -> None:
        """Undo :meth:`ghost`: contacts begin afresh."""

    @abstractmethod
    def touches(self, body: int, others: Sequence[int]) -> list[Touch]:
        """What a body is in now, of some others, by the geometry alone; either may be a ghost."""

    @abstractmethod
    def pushes(self, body: int) -> list[Push]:
        """Contact forces on a body in the last step."""

    @abstractmethod
    def sleep(self, bodies: Sequence[int]) -> None:
        """Hold items where they are, at rest, at least until something touches them."""

    @abstractmethod
    def wake(self, bodies: Sequence[int]) -> None:
        """Let items move, and none fall asleep by itself."""
