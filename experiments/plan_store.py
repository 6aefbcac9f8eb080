"""Plans of random orders, kept as plan files: what one experiment planned, the others carry out."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from packenv import api
from packenv.io.rows import row_key
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import own_code
from packenv.planning.options import PlanOptions
from packenv.types import Container, Item, Order, Plan
from packenv.version import __version__


def fingerprints(items: Mapping[str, Item], order: Sequence[str]) -> tuple[str, ...]:
    """What results depend on of each item of an order: its surface and its mass."""
    return tuple(f"{items[name].sha256[:16]} {items[name].mass!r}" for name in order)


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
        shelf: the items, as their envelopes.
        box: the container.
        meshes: the items as their meshes, for options that plan on these; None where all do on envelopes.
    """

    folder: Path
    shelf: ItemShelf
    box: Container
    meshes: ItemShelf | None = None

    def shelf_of(self, options: PlanOptions) -> ItemShelf:
        """The items that options plan with."""
        return self.shelf if options.shape == "parts" or self.meshes is None else self.meshes

    def plan(self, order: Sequence[str], options: PlanOptions) -> StoredPlan:
        """Read the plan of an order, or make and keep it.

        Args:
            order: item names, each once.
            options: how to plan.
        """
        if self.meshes is None:
            options = replace(options, geometry="parts")
        shelf = self.shelf_of(options)
        items = fingerprints(self.shelf.shapes, order)
        key = row_key(__version__, self.box, options.to_mapping(), own_code(options), tuple(order), items)
        path = self.folder / f"{key}.json"
        if not path.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            api.save_plan(self._made(order, options), path)
        plan = api.load_plan(path, shelf)
        return StoredPlan(plan, float(plan.metrics["plan_cpu_s"]))

    def _made(self, order: Sequence[str], options: PlanOptions) -> Plan:
        seconds = 0.0
        if options.rehearse:
            first = self.plan(order, replace(options, rehearse=0, geometry="parts"))
            seconds, start = first.cpu_s, time.process_time()
            plan = api.rehearse(first.plan, self.shelf, options, margins=False)
        else:
            shelf = self.shelf_of(options)
            shelf.load(order, fields=True)
            start = time.process_time()
            plan = api.plan(Order.of(*order), self.box, shelf, options, margins=False)
        seconds += time.process_time() - start
        return replace(plan, metrics={**plan.metrics, "plan_cpu_s": seconds})
