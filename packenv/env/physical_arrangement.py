"""A container that is filled in physics: robot or ideal hand, release, rest, measured poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from packenv.config import EngineName
from packenv.env.arrangement import Landing
from packenv.items.shelf import ItemShelf
from packenv.planning.constraints import Constraint
from packenv.planning.packing import Pile
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting, measured_map
from packenv.robot.cell import Cell
from packenv.sim.plan_tasks import task_of
from packenv.sim.session import ExecutionConfig, Session
from packenv.sim.verdicts import OUT
from packenv.types import Placement, Pose


class PhysicalArrangement:
    """Every item lies where physics leaves it; the heightmap is that of the measured poses."""

    def __init__(
        self,
        cell: Cell,
        cell_size: float,
        constraints: Sequence[Constraint],
        shelf: ItemShelf,
        *,
        robot: bool,
        engine: EngineName = "auto",
    ) -> None:
        """Begin with an empty container; the world is built when the first item comes.

        Args:
            cell: the box, beside the robot.
            cell_size: m.
            constraints: of the planning, whose states begin anew from what lies at rest.
            shelf: the items; its shapes must be envelopes, so that planning and physics know one geometry.
            robot: the arm is in the world, and places what tells joints.
            engine: of physics.
        """
        self._cell, self._container = cell, cell.container
        self._cell_size, self._shelf = cell_size, shelf
        self._constraints, self._robot, self._engine = tuple(constraints), robot, engine
        self._session: Session | None = None
        self._names: list[str] = []
        self._pile = self._measured(())

    @property
    def pile(self) -> Pile:
        """What the container holds."""
        return self._pile

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Where the items lie now."""
        return () if self._session is None else self._session.measured()

    @property
    def session(self) -> Session:
        """The world, built when it is first asked for."""
        if self._session is None:
            config = ExecutionConfig.of(self._cell.setup, self._engine)
            self._session = Session(self._cell, config, arm=self._robot)
        return self._session

    def place(self, placement: Placement, planned: Pile) -> Landing:
        """Bring an item in, wait for rest, and measure all poses."""
        session = self.session
        physics = self._shelf.physics[placement.item]
        outcome = session.place(task_of(placement, physics, self._cell))
        self._names.append(placement.item)
        poses = session.measured()
        resting = [
            Resting(self._shelf.shapes[name], rotation, position)
            for name, (rotation, position) in zip(self._names, poses, strict=True)
        ]
        over, lost = self._beyond(resting)
        self._pile = self._measured([part for k, part in enumerate(resting) if k not in lost])
        return Landing(outcome.drop_m, outcome.shift_m, outcome.collided, frozenset(over), bool(lost))

    def close(self) -> None:
        """Free the engine's memory."""
        if self._session is not None:
            self._session.close()
            self._session = None

    def _measured(self, resting: Sequence[Resting]) -> Pile:
        surface = (
            measured_map(self._container, self._cell_size, resting)
            if resting
            else ContainerMap.empty(self._container, self._cell_size)
        )
        return Pile(surface, tuple(constraint.start(resting) for constraint in self._constraints))

    def _beyond(self, resting: Sequence[Resting]) -> tuple[set[int], set[int]]:
        """Indices of the items that stick out of the container, and of those wholly beside it."""
        size = np.array(self._container.size)
        over, lost = set(), set()
        for k, part in enumerate(resting):
            item = self._shelf.physics[part.item.name]
            if item.beyond(self._container, part.rotation, part.position) > OUT:
                over.add(k)
            low, high = item.bounds(part.rotation, part.position)
            if (high < 0.0).any() or (low[:2] > size[:2]).any():
                lost.add(k)
        return over, lost
