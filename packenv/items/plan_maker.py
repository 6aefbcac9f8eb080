"""From what the planner returns to the record that is written to a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from packenv.items.shelf import ItemShelf
from packenv.planning.options import PlanOptions
from packenv.planning.packing import Packing
from packenv.planning.robustness import with_robustness
from packenv.types import MeshRecord, OrderLine, Plan


def make_plan(
    packing: Packing,
    order: tuple[OrderLine, ...],
    shelf: ItemShelf,
    options: PlanOptions,
    *,
    unit: str | None = None,
    metrics: Mapping[str, float] | None = None,
    lying: int = 0,
    margins: bool = False,
) -> Plan:
    """Join a packing with what its file must tell.

    Args:
        packing: what the planner returned.
        order: the order's lines.
        shelf: every item of the order.
        options: how the packing was planned.
        unit: the unit that the user gave for the meshes.
        metrics: further figures.
        lying: as in :class:`Plan`.
        margins: tell what the pile of every step withstands, where the plan keeps force balance.
    """
    routes = Counter(placement.route for placement in packing.placements)
    tops = [float(p.corner[2] + p.extents[2]) for p in packing.placements]
    names = dict.fromkeys(line.item for line in order)
    plan = Plan(
        container=packing.container,
        placements=packing.placements,
        leftovers=packing.leftovers,
        settings=options.to_mapping(),
        metrics={
            "ordered": sum(line.qty for line in order),
            "packed": len(packing.placements),
            "utilization": packing.utilization,
            "height": max(tops, default=0.0),
            **{f"route_{route}": n for route, n in sorted(routes.items())},
            **(metrics or {}),
        },
        catalogue=shelf.catalogue.label,
        unit=unit,
        density=shelf.catalogue.density,
        order=order,
        meshes=mesh_records(names, shelf),
        made_by=packing.made_by,
        items={name: shelf.items[name] for name in names},
        lying=lying,
        made_with=options,
    )
    return with_robustness(plan, shelf.shapes, shelf.fields, options) if margins else plan


def mesh_records(names: Iterable[str], shelf: ItemShelf) -> dict[str, MeshRecord]:
    """What a plan keeps of some items, the hash of the envelope included where it is planned with."""
    records: dict[str, MeshRecord] = {}
    for name in names:
        item = shelf.items[name]
        envelope = shelf.shapes[name].sha256 if shelf.geometry == "parts" else None
        records[name] = MeshRecord(
            item.file,
            item.sha256,
            item.volume,
            item.mass,
            item.mass_estimated,
            item.limits,
            envelope,
            item.friction,
        )
    return records
