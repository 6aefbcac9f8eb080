"""Perturbed orientations: the roll and pitch grid of the paper's fallback (Alg. 4)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from packenv.config import CLEARANCE, GridConfig
from packenv.geometry.heightmaps import orient_item
from packenv.geometry.transforms import axis_rotation, yaw_rotation
from packenv.types import FloatArray, Item, OrientedItem, StablePose

PERTURBATION = math.pi / 4
"""Δr of the paper, for roll and pitch."""

MEMORY = 2**30
"""Bytes of heightmaps that :data:`RECENT` keeps; an item's whole grid takes 10 to 100 MB at 2 mm cells."""


def euler_zyx(rotation: FloatArray) -> tuple[float, float, float]:
    """Angles (γ, φ, ψ) of a (3, 3) rotation R_z(γ) R_y(φ) R_x(ψ), rad.

    γ first, the others from what is left after it is turned back: so they fit together at the poles too,
    where γ alone is arbitrary.
    """
    gamma = math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))
    left = axis_rotation(2, -gamma) @ rotation
    phi = math.atan2(-float(left[2, 0]), float(left[0, 0]))
    psi = math.atan2(-float(left[1, 2]), float(left[1, 1]))
    return gamma, phi, psi


def perturbations(
    item: Item,
    poses: Sequence[StablePose],
    grid: GridConfig,
    size: tuple[float, float, float],
    memory: OrientationMemory | None = None,
) -> Iterator[tuple[OrientedItem, ...]]:
    """Yield, for each roll and pitch offset of Alg. 4, the item at all poses and yaws, maps included.

    The first offset is (0, 0): the stable poses themselves. An orientation that an earlier offset had
    already (the grid of Euler angles covers most rotations twice) is left out.

    Maps depend on the item alone and take milliseconds each, so those of recent items are kept.

    Args:
        item: the item.
        poses: its stable poses that are tried.
        grid: yaws and cell size.
        size: of the container, m: an orientation whose bounding box does not fit it gets no maps and is left
            out, but its offset is still yielded.
        memory: where maps are kept; that of the process where None.
    """
    memory = memory or RECENT
    kept = memory.of(item)
    recipe = (grid.n_yaws, *(pose.rotation.tobytes() for pose in poses))
    groups = kept.rotations.get(recipe)
    if groups is None:
        groups = kept.rotations[recipe] = _rotations(item, poses, grid.n_yaws)
    largest = np.add(size, CLEARANCE)
    for group in groups:
        fitting = [rotated for rotated in group if not np.any(rotated.extents > largest)]
        yield tuple(memory.orient(item, rotated, grid.cell_size) for rotated in fitting)


@dataclass(frozen=True, eq=False)
class _Rotation:
    """An orientation of the grid before it has maps; ``extents`` (3,) are those of its bounding box, m."""

    rotation: FloatArray
    pose_index: int
    yaw: float
    extents: FloatArray


_Groups: TypeAlias = tuple[tuple[_Rotation, ...], ...]


def _rotations(item: Item, poses: Sequence[StablePose], n_yaws: int) -> _Groups:
    """The grid of Alg. 4, one group for each offset, every rotation once."""
    from scipy.spatial import ConvexHull  # a third of a second, and most plans need no fallback

    outline = item.vertices[ConvexHull(item.vertices).vertices]
    angles = [k * PERTURBATION for k in range(round(2 * math.pi / PERTURBATION))]
    euler = [euler_zyx(pose.rotation) for pose in poses]
    seen: set[bytes] = set()
    found: list[list[tuple[FloatArray, int, float]]] = []
    for roll in angles:
        for pitch in angles:
            found.append([])
            for index, (gamma, phi, psi) in enumerate(euler):
                tilted = axis_rotation(1, phi + roll) @ axis_rotation(0, psi + pitch)
                for k in range(n_yaws):
                    yaw = k * math.pi / n_yaws
                    rotation = yaw_rotation(yaw + gamma) @ tilted
                    key = (np.round(rotation, 6) + 0.0).tobytes()
                    if key not in seen:
                        seen.add(key)
                        found[-1].append((rotation, index, yaw))
    axes = np.concatenate([rotation for group in found for rotation, _, _ in group])
    extents = iter(np.ptp(outline @ axes.T, axis=0).reshape(-1, 3))
    return tuple(tuple(_Rotation(*rotated, next(extents)) for rotated in group) for group in found)


@dataclass(eq=False)
class _Kept:
    """What is remembered of one item."""

    rotations: dict[tuple[object, ...], _Groups] = field(default_factory=dict)
    maps: dict[tuple[_Rotation, float], OrientedItem] = field(default_factory=dict)
    bytes: int = 0
    used: int = 0


class OrientationMemory:
    """Perturbed orientations of the items that were used last. It changes no result, only the time."""

    def __init__(self, budget: int) -> None:
        """Keep at most ``budget`` bytes of heightmaps; an item that is gone takes its maps along."""
        self.budget = budget
        self._items: WeakKeyDictionary[Item, _Kept] = WeakKeyDictionary()
        self._clock = 0
        self._at_most = 0  # what `bytes` would give, items that are gone included: no sum for every map

    def of(self, item: Item) -> _Kept:
        """What is kept of an item, which becomes the one used last."""
        kept = self._items.setdefault(item, _Kept())
        self._clock += 1
        kept.used = self._clock
        return kept

    @property
    def bytes(self) -> int:
        """Of the heightmaps that are kept."""
        return sum(kept.bytes for kept in self._items.values())

    def orient(self, item: Item, rotated: _Rotation, cell_size: float) -> OrientedItem:
        """The item with its maps, made where they are not kept."""
        kept = self.of(item)
        oriented = kept.maps.get((rotated, cell_size))
        if oriented is None:
            oriented = orient_item(
                item, rotated.rotation, cell_size=cell_size, pose_index=rotated.pose_index, yaw=rotated.yaw
            )
            needed = oriented.top.nbytes + oriented.bottom.nbytes
            if self._make_room(needed, kept):
                kept.maps[rotated, cell_size] = oriented
                kept.bytes += needed
                self._at_most += needed
        return oriented

    def _make_room(self, needed: int, owner: _Kept) -> bool:
        """Forget the maps of other items, those used longest ago first, until there is room."""
        if self._at_most + needed <= self.budget:
            return True
        for kept in sorted(self._items.values(), key=lambda kept: kept.used):
            if kept is not owner and self.bytes + needed > self.budget:
                kept.maps.clear()
                kept.bytes = 0
        self._at_most = self.bytes
        return self._at_most + needed <= self.budget


RECENT = OrientationMemory(MEMORY)
"""The memory of this process."""
