"""The container heightmap step by step, from a plan's poses and the meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from packenv.config import CLEARANCE
from packenv.geometry.heightmaps import orient_item
from packenv.planning.search.contact_height import ExactPile
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting, measured_map
from packenv.types import Container, Item, OrientedItem, Placement, Plan

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
        try:
            surface = surface.with_item(*seated(placement, items[placement.item], surface))
        except ValueError:
            raise ValueError(f"step {step} ({placement.item}) is not inside the container") from None
        surfaces.append(surface)
    return tuple(surfaces)


def seated(placement: Placement, item: Item, surface: ContainerMap) -> tuple[OrientedItem, int, int, float]:
    """A placed item as a map sees it: its maps, the cells of its smallest x and y, and its height, m.

    Raises:
        ValueError: it is not over the container's floor, or below it.
    """
    size = surface.container.size
    oriented = orient_item(item, placement.rotation, cell_size=surface.cell_size)
    x, y, z = (placement.position - oriented.offset).tolist()
    beyond = np.add([x, y], oriented.extents[:2]) - size[:2]
    if min(x, y) < -OUTSIDE or beyond.max() > OUTSIDE or not -1e-6 <= z <= size[2]:
        raise ValueError(f"{placement.item} is not inside the container")
    x, y = (max(0.0, c - max(0.0, b - CLEARANCE)) for c, b in zip((x, y), beyond.tolist(), strict=True))
    return *surface.locate(oriented, x, y), z


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


def surfaces_before(
    plan: Plan, items: Mapping[str, Item], cell_size: float, *, exact: bool = False
) -> list[ContainerMap]:
    """The heightmap before each step of a plan, up to the first item that is not over the container.

    Args:
        plan: the plan.
        items: its placed items by name.
        cell_size: m.
        exact: as for :func:`replay`.
    """
    surfaces: tuple[ContainerMap, ...] = ()
    for count in range(len(plan.placements), plan.lying, -1):
        try:
            part = replace(plan, placements=plan.placements[:count])
            surfaces = replay_plan(part, items, cell_size, exact=exact)
            break
        except ValueError:
            continue
    empty = ContainerMap.empty(plan.container, cell_size, ExactPile(items) if exact else None)
    known = [empty, *surfaces]
    # Where the replay ended early, its next item is outside: there is no way down to it.
    return known[:-1] if len(surfaces) == len(plan.placements) else known[: len(surfaces)]
