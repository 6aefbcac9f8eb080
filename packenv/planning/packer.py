"""The planner: sequence, place, update the heightmap, report what does not fit (paper Alg. 3 and 4)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from packenv.geometry.prepare import PreparedItem
from packenv.planning.candidates import grid_search
from packenv.planning.container_map import ContainerMap
from packenv.planning.scores import Heuristic
from packenv.types import Container, Leftover, Placement


@dataclass(frozen=True, eq=False)
class Packing:
    """What became of an order in one container.

    Attributes:
        container: the box.
        placements: in packing sequence.
        leftovers: what did not fit, and why.
        surfaces: the container heightmap after each placement.
        utilization: volume of the placed items as a share of the container's.
    """

    container: Container
    placements: tuple[Placement, ...]
    leftovers: tuple[Leftover, ...]
    surfaces: tuple[ContainerMap, ...]
    utilization: float

    @property
    def complete(self) -> bool:
        """True where every item is placed."""
        return not self.leftovers


def by_box_volume(names: Sequence[str], items: Mapping[str, PreparedItem]) -> list[str]:
    """The paper's sequence: non-increasing bounding-box volume, then name."""
    return sorted(names, key=lambda name: (-items[name].box_volume, name))


def place(
    item: PreparedItem,
    instance: int,
    surface: ContainerMap,
    heuristic: Heuristic,
    step: int,
    rng: np.random.Generator,
) -> tuple[Placement, ContainerMap] | None:
    """Place one item at its best legal candidate (paper Alg. 3 under the non-overlap constraints).

    Args:
        item: the item.
        instance: which piece of that name in the order, from 1.
        surface: the container heightmap.
        heuristic: scores the candidates.
        step: cells between tried translations.
        rng: for heuristics that draw.

    Returns:
        The placement and the heightmap after it, or None where there is no legal candidate.
    """
    candidates = grid_search(surface, item.orientations, step)
    if not len(candidates):
        return None
    scores = heuristic(candidates, rng)
    best = int(np.argmin(scores))
    oriented = candidates.grids[candidates.grid_index[best]].oriented
    ix, iy, z = int(candidates.ix[best]), int(candidates.iy[best]), float(candidates.z[best])
    corner = np.array([ix * surface.cell_size, iy * surface.cell_size, z])
    placement = Placement(
        item=item.name,
        instance=instance,
        rotation=oriented.rotation,
        position=oriented.offset + corner,
        corner=corner,
        extents=oriented.extents,
        pose_index=oriented.pose_index,
        yaw=oriented.yaw,
        score=float(scores[best]),
        candidates=len(candidates),
    )
    return placement, surface.with_item(oriented, ix, iy, z)


def pack(
    sequence: Sequence[str],
    items: Mapping[str, PreparedItem],
    container: Container,
    heuristic: Heuristic,
    *,
    cell_size: float,
    step: int,
    seed: int = 0,
) -> Packing:
    """Pack items one after another, without backtracking (paper Alg. 4, first pass).

    Under the non-overlap constraints alone, an item that fits nowhere can never fit later: heights
    only grow. So there is nothing to fall back to here.

    Args:
        sequence: item names, a name as often as the order has it.
        items: every named item, prepared at ``cell_size``.
        container: the box.
        heuristic: scores the candidates.
        cell_size: m.
        step: cells between tried translations.
        seed: for heuristics that draw.
    """
    rng = np.random.default_rng(seed)
    surface = empty = ContainerMap.empty(container, cell_size)
    placements: list[Placement] = []
    leftovers: list[Leftover] = []
    surfaces: list[ContainerMap] = []
    for name, instance in _numbered(sequence):
        placed = place(items[name], instance, surface, heuristic, step, rng)
        if placed is None:
            leftovers.append(_leftover(items[name], instance, empty, step))
        else:
            placement, surface = placed
            placements.append(placement)
            surfaces.append(surface)
    volume = sum(items[p.item].volume for p in placements)
    return Packing(container, tuple(placements), tuple(leftovers), tuple(surfaces), volume / container.volume)


def _numbered(sequence: Sequence[str]) -> Iterator[tuple[str, int]]:
    """Each name with how often it has come up so far, itself included."""
    seen: Counter[str] = Counter()
    for name in sequence:
        seen[name] += 1
        yield name, seen[name]


def _leftover(item: PreparedItem, instance: int, empty: ContainerMap, step: int) -> Leftover:
    """Tell an item that is too large for the empty container from one that finds no room any more."""
    box = empty.container.label
    if len(grid_search(empty, item.orientations, step)):
        detail = f"no tried pose of {item.name} is free of overlap and inside {box} any more"
        return Leftover(item.name, instance, "no-legal-candidate", detail)
    tightest = min(item.orientations, key=lambda o: float(o.extents.prod())).extents
    size = " x ".join(f"{e:.3f}" for e in tightest)
    detail = f"{item.name} ({size} m) is larger than {box} in every tried orientation"
    return Leftover(item.name, instance, "larger-than-container", detail)
