"""Plans of random orders, kept as plan files: what one experiment planned, the others carry out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.physics_shelf import PhysicsShelf
from packenv.config import GridConfig
from packenv.io.assets import robot_urdf
from packenv.io.plan_maker import make_plan, with_envelopes
from packenv.io.plans import read_plan, write_plan
from packenv.io.rows import row_key
from packenv.physics_planning import make_planner, make_spares
from packenv.planning.assembly import PlannerChoice, Shelf
from packenv.planning.packer import Planner, by_box_volume
from packenv.planning.packing import Packing
from packenv.rehearsal import Rehearsal, pack_rehearsed
from packenv.sim.world import WorldConfig
from packenv.types import Container, OrderLine, Plan
from packenv.version import __version__


def fingerprints(shelf: Shelf, order: Sequence[str]) -> tuple[str, ...]:
    """What results depend on of each item of an order: its surface and its mass."""
    items = (shelf.meshes[name] for name in order)
    return tuple(f"{item.sha256[:16]} {item.mass!r}" for item in items)


@dataclass(frozen=True, eq=False)
class StoredPlan:
    """A plan, and what it took.

    Attributes:
        plan: as it was read back from its file.
        cpu_s: CPU-seconds that planning took when it was made.
    """

    plan: Plan
    cpu_s: float


@dataclass(frozen=True, eq=False)
class PlanStore:
    """A folder of plan files, one for each order and way of planning; made where one is missing.

    Every plan goes through its file, the one that was just made as well: what is carried out is what a user
    would carry out.

    Attributes:
        folder: where the files are.
        catalogue: the user's name for the catalogue.
        shelf: its items.
        box: the container.
        grid: the discretization that the shelf was made with.
        world: of the planner's scratch world.
    """

    folder: Path
    catalogue: str
    shelf: PhysicsShelf
    box: Container
    grid: GridConfig
    world: WorldConfig

    def planner(self, choice: PlannerChoice) -> Planner:
        """The planner of a choice, for this container."""
        return make_planner(choice, self.shelf.plan, self.box, self.grid, self.shelf.physics, self.world)

    def spares(self, choice: PlannerChoice) -> tuple[Planner, ...]:
        """More planners, for rehearsals."""
        return make_spares(choice, self.shelf.plan, self.box, self.grid)

    def plan(self, order: Sequence[str], choice: PlannerChoice) -> StoredPlan:
        """Read the plan of an order, or make and keep it.

        Args:
            order: item names, each once.
            choice: how to plan.
        """
        items = fingerprints(self.shelf.plan, order)
        key = row_key(__version__, self.grid, self.box, self.world, choice, tuple(order), items)
        path = self.folder / f"{key}.json"
        if not path.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            write_plan(path, self._made(order, choice))
        plan = read_plan(path)
        return StoredPlan(plan, float(plan.metrics["plan_cpu_s"]))

    def _made(self, order: Sequence[str], choice: PlannerChoice) -> Plan:
        prepared, physics = self.shelf.plan.prepared, self.shelf.physics
        planner, sequence = self.planner(choice), by_box_volume(order, prepared)
        seconds, rehearsed = 0.0, None
        if choice.rehearse:
            first = self.plan(order, replace(choice, rehearse=0))
            seconds = first.cpu_s
            start = time.process_time()
            rehearsal = Rehearsal(self.box, physics, robot_urdf(), choice.rehearse)
            known = Packing.of_plan(first.plan)
            spares = self.spares(choice)
            rehearsed = pack_rehearsed(planner, sequence, prepared, rehearsal, first=known, spares=spares)
            packing = rehearsed.packing
        else:
            start = time.process_time()
            packing = planner.pack(sequence, prepared, self.box)
        seconds += time.process_time() - start
        settings: dict[str, Any] = {**asdict(choice), "geometry": "parts", "sequence": "volume"}
        items = {name: self.shelf.items[name] for name in order}
        lines = tuple(OrderLine(name, 1) for name in order)
        plan = make_plan(packing, lines, items, self.grid, catalogue=self.catalogue, settings=settings)
        plan = with_envelopes(plan, {name: self.shelf.plan.meshes[name] for name in order})
        if rehearsed is not None:
            plan = rehearsed.told_by(plan)
        return replace(plan, metrics={**plan.metrics, "plan_cpu_s": seconds})
