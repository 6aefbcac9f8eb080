"""What happens to an accepted placement: it lies where it was planned, or where physics leaves it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from packenv.planning.constraints import Constraint
from packenv.planning.packing import Pile
from packenv.planning.search.container_map import ContainerMap
from packenv.types import Placement, Pose


@dataclass(frozen=True)
class Landing:
    """How a placement ended.

    Attributes:
        drop: how far the item's centre of mass fell from the release, m; 0 where nothing fell.
        shift: its horizontal distance from where it was planned, m.
        collided: the robot or the held item met something on the way: the robot has stopped.
        outside: indices of all placed items that stick out of the container now.
        lost: one of these lies wholly beside the container.
    """

    drop: float = 0.0
    shift: float = 0.0
    collided: bool = False
    outside: frozenset[int] = frozenset()
    lost: bool = False


class Arrangement(Protocol):
    """A container that is being filled."""

    @property
    def pile(self) -> Pile:
        """What it holds, for planning."""
        ...

    @property
    def poses(self) -> tuple[Pose, ...]:
        """(3, 3) rotation and (3,) position of every placed item, mesh frame to container frame, m."""
        ...

    def place(self, placement: Placement, planned: Pile) -> Landing:
        """Put an item in; ``planned`` is the pile with it as it was planned."""
        ...

    def close(self) -> None:
        """Free what it holds; twice is fine."""
        ...


class PlannedArrangement:
    """Every item lies where it was planned."""

    def __init__(self, empty: ContainerMap, constraints: Sequence[Constraint]) -> None:
        """Begin with an empty container."""
        self._pile = Pile(empty, tuple(constraint.start() for constraint in constraints))
        self._poses: list[Pose] = []

    @property
    def pile(self) -> Pile:
        """What the container holds."""
        return self._pile

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Where the items lie."""
        return tuple(self._poses)

    def place(self, placement: Placement, planned: Pile) -> Landing:
        """Put an item where it was planned."""
        self._pile = planned
        self._poses.append(placement.pose)
        return Landing()

    def close(self) -> None:
        """Nothing to free."""
