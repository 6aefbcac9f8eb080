"""From what the planner returns to the record that is written to a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, replace

from packenv.config import GridConfig
from packenv.io.plans import EnvelopeRecord
from packenv.planning.packing import Packing
from packenv.types import Item, MeshRecord, OrderLine, Plan


def make_plan(
    packing: Packing,
    order: tuple[OrderLine, ...],
    items: Mapping[str, Item],
    grid: GridConfig,
    *,
    catalogue: str,
    unit: str | None = None,
    settings: Mapping[str, object],
) -> Plan:
    """Join a packing with what its file must tell.

    Args:
        packing: what the planner returned.
        order: the order's lines.
        items: every item of the order by name.
        grid: the discretization that the packing was made with.
        catalogue: folder of the catalogue, or ``builtin``.
        unit: the unit that the user gave for the meshes.
        settings: further settings to keep: heuristic, constraints, sequence, seed.
    """
    routes = Counter(placement.route for placement in packing.placements)
    tops = [float(p.corner[2] + p.extents[2]) for p in packing.placements]
    return Plan(
        container=packing.container,
        placements=packing.placements,
        leftovers=packing.leftovers,
        settings={**settings, **asdict(grid)},
        metrics={
            "ordered": sum(line.qty for line in order),
            "packed": len(packing.placements),
            "utilization": packing.utilization,
            "height": max(tops, default=0.0),
            **{f"route_{route}": n for route, n in sorted(routes.items())},
        },
        catalogue=catalogue,
        unit=unit,
        order=order,
        meshes={
            name: MeshRecord(item.file, item.sha256, item.volume, item.mass, item.mass_estimated)
            for name, item in items.items()
        },
    )


def with_envelopes(plan: Plan, shapes: Mapping[str, Item]) -> Plan:
    """The plan with the hash of every item's envelope, for plans on convex parts.

    Args:
        plan: the plan.
        shapes: every item of the order by name, as its envelope.
    """
    records = {
        name: EnvelopeRecord(**asdict(mesh), envelope_sha256=shapes[name].sha256)
        for name, mesh in plan.meshes.items()
    }
    return replace(plan, meshes={**records})
