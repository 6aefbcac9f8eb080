"""The container heightmap step by step, from a plan's placements and the meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from packenv.geometry.heightmaps import orient_item
from packenv.planning.container_map import ContainerMap
from packenv.types import Container, Item, Placement


def replay(
    placements: Sequence[Placement], items: Mapping[str, Item], container: Container, cell_size: float
) -> tuple[ContainerMap, ...]:
    """Rebuild the heightmap after each placement.

    Args:
        placements: in packing sequence; corners on cell boundaries, as the planner leaves them.
        items: the placed items by name.
        container: the box.
        cell_size: m.
    """
    surface = ContainerMap.empty(container, cell_size)
    surfaces = []
    for placement in placements:
        oriented = orient_item(items[placement.item], placement.rotation, cell_size=cell_size)
        ix, iy = (round(float(c) / cell_size) for c in placement.corner[:2])
        surface = surface.with_item(oriented, ix, iy, float(placement.corner[2]))
        surfaces.append(surface)
    return tuple(surfaces)
