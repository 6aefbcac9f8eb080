"""The container heightmap step by step, from a plan's poses and the meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from packenv.config import CLEARANCE
from packenv.geometry.heightmaps import orient_item
from packenv.planning.search.contact_height import ExactPile
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting, measured_map
from packenv.types import Container, Item, Placement, Plan

OUTSIDE = 1e-3
"""So far beyond a wall an item may be and is still taken to lie against it, m."""


def replay(
    placements: Sequence[Placement],
    items: Mapping[str, Item],
    container: Container,
    cell_size: float,
    before: ContainerMap | None = None,
    *,
    exact: bool = False,
) -> tuple[ContainerMap, ...]:
    """Rebuild the heightmap after each placement, from the poses alone.

    Args:
        placements: in packing sequence.
        items: the placed items by name.
        container: the box.
        cell_size: m.
        before: what the container holds already; empty where None.
        exact: let the maps of an empty container keep the meshes, too.

    Raises:
        ValueError: an item is not over the container's floor, or below it.
    """
    surface = before or ContainerMap.empty(container, cell_size, ExactPile(items) if exact else None)
    surfaces = []
    for step, placement in enumerate(placements, start=1):
        oriented = orient_item(items[placement.item], placement.rotation, cell_size=cell_size)
        x, y, z = (placement.position - oriented.offset).tolist()
        beyond = np.add([x, y], oriented.extents[:2]) - container.size[:2]
        if min(x, y) < -OUTSIDE or beyond.max() > OUTSIDE or not -1e-6 <= z <= container.height:
            raise ValueError(f"step {step} ({placement.item}) is not inside the container")
        x, y = (max(0.0, c - max(0.0, b - CLEARANCE)) for c, b in zip((x, y), beyond.tolist(), strict=True))
        surface = surface.with_item(*surface.locate(oriented, x, y), z)
        surfaces.append(surface)
    return tuple(surfaces)


def replay_plan(
    plan: Plan, items: Mapping[str, Item], cell_size: float, *, exact: bool = False
) -> tuple[ContainerMap, ...]:
    """The heightmap after each step of a plan, of what lay there already by its measured pose.

    Args:
        plan: the plan.
        items: its placed items by name.
        cell_size: m.
        exact: as for :func:`replay`.

    Raises:
        ValueError: an item is not over the container's floor, or below it.
    """
    done, planned = plan.placements[: plan.lying], plan.placements[plan.lying :]
    lying = [Resting(items[p.item], *p.pose) for p in done]
    pile = ExactPile(items) if exact else None
    maps = [measured_map(plan.container, cell_size, lying[: k + 1], exact=pile) for k in range(len(lying))]
    before = maps[-1] if maps else None
    return (*maps, *replay(planned, items, plan.container, cell_size, before, exact=exact))
