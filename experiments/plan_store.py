"""Plans of random orders, kept as plan files: what one worker planned, the others carry out."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from packenv import api
from packenv.io.rows import row_key
from packenv.items.catalogue import Catalogue
from packenv.items.plan_items import shelf_for
from packenv.planning.assembly import own_code
from packenv.planning.options import PlanOptions
from packenv.types import Container, Item, Order, Plan


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
        catalogue: the items.
        revision: of the product: a plan that another one made is none of this one's.
        unit: of the meshes, for the plan files.
    """

    folder: Path
    catalogue: Catalogue
    revision: str
    unit: str | None = None

    def plan(
        self,
        order: Sequence[str],
        boxes: Sequence[Container],
        options: PlanOptions,
        *,
        as_packed: bool = False,
    ) -> StoredPlan:
        """Read the plan of an order, or make and keep it.

        Args:
            order: item names.
            boxes: the first that takes all of them is taken.
            options: how to plan.
            as_packed: as ``robotpack pack`` does, with rehearsals of its own.
        """
        items = fingerprints(shelf_for(self.catalogue, replace(options, geometry="parts")).shapes, order)
        made_of = (tuple(boxes), options.to_mapping(), as_packed, own_code(options), tuple(order), items)
        path = self.folder / f"{row_key(self.revision, *made_of)}.json"
        if not path.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            api.save_plan(self._made(order, boxes, options, as_packed), path)
        plan = api.load_plan(path, self.catalogue)
        return StoredPlan(plan, float(plan.metrics["plan_cpu_s"]))

    def _made(
        self, order: Sequence[str], boxes: Sequence[Container], options: PlanOptions, as_packed: bool
    ) -> Plan:
        simulated = as_packed or options.asks_physics
        shape = "parts" if simulated else options.shape
        shelf_for(self.catalogue, replace(options, geometry=shape)).load(
            order, fields=True, physics=simulated
        )
        seconds, box = 0.0, boxes[0] if len(boxes) == 1 else boxes
        start = time.process_time()
        if as_packed:
            plan = api.plan_rehearsed(
                Order.of(*order), box, self.catalogue, options, unit=self.unit, margins=False
            )
        elif options.rehearse:
            unrehearsed = replace(options, rehearse=0, geometry="parts", engine="auto")
            first = self.plan(order, boxes, unrehearsed)
            seconds, start = first.cpu_s, time.process_time()
            plan = api.rehearse(first.plan, self.catalogue, options, margins=False)
        else:
            plan = api.plan(Order.of(*order), box, self.catalogue, options, unit=self.unit, margins=False)
        seconds += time.process_time() - start
        return replace(plan, metrics={**plan.metrics, "plan_cpu_s": seconds})
