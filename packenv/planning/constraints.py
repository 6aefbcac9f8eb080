"""What a constraint is to the planner: a question about one candidate on one pile.

The legality of a candidate (non-overlap, containment) is the search's; what comes after it, stability and
manipulation, are constraints that the planner is given (paper Alg. 3). So is one of the user's own::

    class FlatOnly(Constraint):
        def check(self, trial, surface, state):
            return Verdict(trial.oriented.extents[2] < 0.1, "too-tall")
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.types import BoolArray, Container, FloatArray, Item, OrientedItem, RobotPath

if TYPE_CHECKING:
    from packenv.planning.search.candidates import Candidates


@dataclass(frozen=True, eq=False)
class Trial:
    """A legal candidate that is put to the constraints.

    Attributes:
        oriented: the item at its orientation.
        ix: cell of its smallest x.
        iy: cell of its smallest y; where in these cells it begins, its phase tells.
        z: height of its lowest point, m.
    """

    oriented: OrientedItem
    ix: int
    iy: int
    z: float

    @property
    def corner(self) -> FloatArray:
        """(3,) smallest x, y, z in the container frame, m."""
        (dx, dy), cell = self.oriented.phase, self.oriented.cell_size
        return np.array([self.ix * cell + dx, self.iy * cell + dy, self.z])

    @property
    def position(self) -> FloatArray:
        """(3,) p_container = rotation @ p_mesh + position, m."""
        position: FloatArray = self.oriented.offset + self.corner
        return position

    @property
    def com(self) -> FloatArray:
        """(3,) centre of mass in the container frame, m."""
        com: FloatArray = self.oriented.com + self.corner
        return com


class Details(Mapping[str, object]):
    """Figures that are made when somebody looks: most candidates that pass are never placed."""

    def __init__(self, make: Callable[[], Mapping[str, object]]) -> None:
        """Keep how they are made."""
        self._make = make

    @cached_property
    def _made(self) -> Mapping[str, object]:
        return self._make()

    def __getitem__(self, key: str) -> object:
        return self._made[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._made)

    def __len__(self) -> int:
        return len(self._made)


@dataclass(frozen=True, eq=False)
class Verdict:
    """A constraint's answer.

    Attributes:
        ok: whether the candidate may be placed.
        reason: a word for programs, where it may not.
        state: what the constraint wants to know again when the next item comes, the candidate placed.
        details: figures for the plan, JSON-able.
        surface: the heightmap to go on with, where the constraint knows more than where the item was meant to
            be; None leaves it at that.
        path: the robot's, where the constraint looked for one.
    """

    ok: bool
    reason: str = ""
    state: Any = None
    details: Mapping[str, object] = field(default_factory=dict)
    surface: ContainerMap | None = None
    path: RobotPath | None = None


class Constraint(ABC):
    """A condition on placements beyond non-overlap; an own one needs :meth:`check` alone."""

    @property
    def name(self) -> str:
        """One word, for messages and for the figures in a plan; no two constraints of a planner share one."""
        return type(self).__name__

    def for_order(self, items: Mapping[str, Item], container: Container) -> Constraint:
        """The constraint for one order: asked once before it is planned.

        Args:
            items: the items by name, as the geometry that is planned with: at least those of the order, mostly
                the whole catalogue. Each is loaded when it is asked for.
            container: the box.
        """
        return self

    def start(self, resting: Sequence[Resting] = ()) -> Any:
        """The state of a container that holds what lies in it, at rest; empty without."""
        return None

    def objection(self, oriented: OrientedItem) -> str | None:
        """Why no candidate at this orientation can ever pass, as a word for programs; None where one may."""
        return None

    def explanation(self, oriented: OrientedItem) -> str | None:
        """The objection to an orientation as a sentence for people; None where its word has to do."""
        return None

    def barrier(self, tallest: float) -> str | None:
        """Why nothing at all can be placed in the empty container, as a sentence; None where something may.

        Args:
            tallest: no item of the order is taller, however it is turned, m.
        """
        return None

    def refused(self, candidates: Candidates, state: Any) -> BoolArray | None:
        """(n,) candidates that :meth:`check` would refuse, where that is quickly told; None tells of none.

        Args:
            candidates: legal ones of one item.
            state: of the pile, as in :meth:`check`.
        """
        return None

    @property
    def refusal(self) -> str:
        """The word against what :meth:`refused` refuses."""
        return self.name

    @abstractmethod
    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        """Answer for a candidate on the pile that ``surface`` and ``state`` describe.

        Args:
            trial: the candidate.
            surface: the container heightmap without it.
            state: what :meth:`start`, or the verdict on the item placed before, gave.
        """

    def close(self) -> None:
        """Free what the constraint holds; twice is fine."""
        return
