"""What an agent sees: the observation space of ``RobotPack-v0``, and how its arrays are filled.

All lengths are in metres, volumes in m³, masses in kg, angles in rad. Every array is float32 and inside the
bounds that its space declares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from packenv.env.config import PackConfig
from packenv.limits import ItemLimits
from packenv.planning.options import heuristic_label
from packenv.planning.search.container_map import cells_across
from packenv.types import Container, Float32Array, FloatArray

if TYPE_CHECKING:
    from packenv.env.candidate_set import CandidateSet
    from packenv.geometry.prepare import PreparedItem

HEURISTIC_COLUMNS = ("hm", "dblf", "mta", "minz", "first-fit")
"""Heuristics whose scores and ranks the candidates tell; names of ``scores.HEURISTICS``."""

FEATURES: tuple[str, ...] = (
    "present",
    "x",
    "y",
    "z",
    "length",
    "width",
    "height",
    "yaw",
    "pose",
    "probability",
    "perturbed",
    "com_height",
    "support_margin",
    *(f"score_{name}" for name in HEURISTIC_COLUMNS),
    *(f"rank_{name}" for name in HEURISTIC_COLUMNS),
)
"""Columns of ``candidates``; own heuristics of the configuration add their scores, then their ranks."""

ITEM_FEATURES: tuple[str, ...] = (
    "present",
    "length",
    "width",
    "height",
    "volume",
    "mass",
    "share_filled",
    "deferred",
    "max_tilt",
    "bears",
    "refused",
)
"""Columns of ``remaining``."""

STATE_FEATURES: tuple[str, ...] = (
    "length",
    "width",
    "height",
    "utilization",
    "packed_share",
    "left_share",
    "stage",
)
"""Entries of ``state``; ``left_share`` is of the items still to come, the current one included."""

Observation: TypeAlias = dict[str, NDArray[Any]]

SUPPORT_CLIP: Final = 0.1
"""``support_margin`` is clipped to this, m."""
LARGEST_ITEM: Final = 2.0
"""Sizes of items are clipped to this, m, and their volumes to its cube."""
HEAVIEST_ITEM: Final = 100.0
"""Masses, and what items bear, are clipped to this, kg."""


@dataclass(frozen=True, eq=False)
class ItemView:
    """What is told of an item that is still to come.

    Attributes:
        extents: (3,) of its bounding box at its first stable pose, m.
        volume: m³.
        mass: kg.
        deferred: whether it was deferred before.
        limits: what may not be done with it.
        refused: whether the box takes it no more: kept apart from what is in it, or too heavy beside it.
    """

    extents: FloatArray
    volume: float
    mass: float
    deferred: bool
    limits: ItemLimits
    refused: bool


@dataclass(frozen=True, eq=False)
class View:
    """All that an observation is made of.

    Attributes:
        container: the box.
        heights: (nx, ny) container heightmap, m.
        current: the current item; None at the end.
        offered: its candidates; None where it has none.
        items: the items that are seen, the current one first.
        perturbed: whether the candidates are of perturbed orientations.
        utilization: volume of what is packed, as a share of the container's.
        packed_share: of the order's pieces, those that are packed.
        left_share: of the order's pieces, those still to come.
        stage: 0, 1 or 2.
    """

    container: Container
    heights: Float32Array
    current: PreparedItem | None
    offered: CandidateSet | None
    items: Sequence[ItemView]
    perturbed: bool
    utilization: float
    packed_share: float
    left_share: float
    stage: int


class Observer:
    """The observation space of a configuration, and the arrays in it."""

    def __init__(self, config: PackConfig) -> None:
        """Work out shapes and bounds.

        Args:
            config: sizes of the containers, K, and the discretization.
        """
        self.config = config
        self.largest = tuple(max(size[axis] for size in config.containers) for axis in range(3))
        grid = config.grid
        cells = cells_across(self.largest, grid.cell_size)
        self.pixels = tuple(max(1, math.ceil(n / config.map_step)) for n in cells)
        steps = [n // grid.step_cells + 1 for n in cells]
        own = [heuristic_label(given) for given in config.heuristics]
        self.features = (*FEATURES, *(f"score_{name}" for name in own), *(f"rank_{name}" for name in own))
        self._most_ranks = float(grid.n_poses * grid.n_yaws * steps[0] * steps[1])
        self._pooled: WeakKeyDictionary[PreparedItem, Float32Array] = WeakKeyDictionary()

    @cached_property
    def space(self) -> spaces.Dict:
        """The observation space."""
        config = self.config
        length, width, height = self.largest
        side, poses, k = max(self.pixels), config.grid.n_poses, config.candidates
        columns, own = len(HEURISTIC_COLUMNS), len(config.heuristics)
        low = [0.0] * len(self.features)
        low[FEATURES.index("support_margin")] = -SUPPORT_CLIP
        high = [1.0, length, width, height, length, width, height, math.pi, poses, 1.0, 1.0, height]
        high += [SUPPORT_CLIP, *[1.0] * columns, *[self._most_ranks] * columns]
        high += [*[1.0] * own, *[self._most_ranks] * own]
        item_high = [1.0, *[LARGEST_ITEM] * 3, LARGEST_ITEM**3, HEAVIEST_ITEM, 1.0, 1.0]
        item_high += [math.pi, HEAVIEST_ITEM, 1.0]
        maps_high = np.empty((poses, 3, side, side))
        maps_high[:, :2], maps_high[:, 2] = height, 1.0
        state_high = [length, width, height, 1.0, 1.0, 1.0, 2.0]
        return spaces.Dict(
            {
                "container": _box(np.zeros(self.pixels), np.full(self.pixels, height)),
                "item": _box(np.zeros(maps_high.shape), maps_high),
                "candidates": _box(np.tile(low, (k, 1)), np.tile(high, (k, 1))),
                "remaining": _box(
                    np.zeros((config.max_items, len(ITEM_FEATURES))),
                    np.tile(item_high, (config.max_items, 1)),
                ),
                "state": _box(np.zeros(len(STATE_FEATURES)), np.array(state_high)),
                "action_mask": spaces.MultiBinary(k + 1),
            }
        )

    def observe(self, view: View, mask: NDArray[np.int8]) -> Observation:
        """The observation of a view; every array is new.

        Args:
            view: what there is to see.
            mask: (K + 1,) int8.
        """
        rows: dict[str, FloatArray | Float32Array] = {
            "container": self._container(view),
            "item": self._item(view.current),
            "candidates": self._candidates(view),
            "remaining": self._remaining(view.items),
            "state": np.array(
                [*view.container.size, view.utilization, view.packed_share, view.left_share, view.stage]
            ),
        }
        seen: Observation = {}
        for name, values in rows.items():
            box = self.space[name]
            assert isinstance(box, spaces.Box)
            seen[name] = np.clip(values.astype(np.float32), box.low, box.high)
        seen["action_mask"] = mask.copy()
        return seen

    def _container(self, view: View) -> Float32Array:
        pooled = self._pool(view.heights, self.pixels, np.maximum, 0.0)
        across, along = (math.ceil(n / self.config.map_step) for n in view.heights.shape)
        pooled[across:] = pooled[:, along:] = view.container.height
        return pooled

    def _item(self, item: PreparedItem | None) -> Float32Array:
        if item is None:
            side = max(self.pixels)
            return np.zeros((self.config.grid.n_poses, 3, side, side), dtype=np.float32)
        maps = self._pooled.get(item)
        if maps is None:
            maps = self._pooled[item] = self._item_maps(item)
        return maps

    def _item_maps(self, item: PreparedItem) -> Float32Array:
        side, step = max(self.pixels), self.config.map_step
        maps = np.zeros((self.config.grid.n_poses, 3, side, side), dtype=np.float32)
        for oriented in item.orientations:
            if oriented.yaw != 0.0:
                continue
            top, bottom, share = maps[oriented.pose_index]
            room = (side, side)
            top[:] = self._pool(oriented.top, room, np.maximum, 0.0)
            lowest = self._pool(oriented.bottom, room, np.minimum, math.inf)
            bottom[:] = np.where(np.isfinite(lowest), lowest, 0.0)
            touched = oriented.footprint.astype(np.float32)
            share[:] = self._pool(touched, room, np.add, 0.0) / np.float32(step**2)
        return maps

    def _pool(
        self, cells: NDArray[np.float32], room: tuple[int, ...], how: np.ufunc, beyond: float
    ) -> Float32Array:
        """Blocks of ``map_step`` by ``map_step`` cells as one pixel each, on so many pixels; cropped."""
        step = self.config.map_step
        padded = np.full((room[0] * step, room[1] * step), beyond, dtype=np.float32)
        w, h = (min(a, b) for a, b in zip(cells.shape, padded.shape, strict=True))
        padded[:w, :h] = cells[:w, :h]
        blocks = padded.reshape(room[0], step, room[1], step)
        pooled: Float32Array = how.reduce(how.reduce(blocks, axis=3), axis=1)
        return pooled

    def _candidates(self, view: View) -> FloatArray:
        from packenv.env.support import support_margin

        table = np.zeros((self.config.candidates, len(self.features)))
        offered = view.offered
        if offered is None:
            return table
        found, chosen = offered.candidates, offered.chosen
        oriented = [found.grids[g].oriented for g in found.grid_index[chosen].tolist()]
        m, cell = len(chosen), found.cell_size
        extents = np.array([o.extents for o in oriented])
        coms = np.array([o.com for o in oriented])
        z = found.z[chosen].astype(np.float64)
        assert view.current is not None
        poses = view.current.poses
        # An item that fits in no other way leans; it counts as perturbed, as in the fallback.
        resting = [o.rotation[2] @ poses[o.pose_index].rotation[2] > 1 - 1e-9 for o in oriented]
        perturbed = view.perturbed | ~np.array(resting, dtype=bool)
        margins = [
            support_margin(view.heights, o.bottom, ix, iy, height, cell / 2, cell, o.com[0], o.com[1])
            for o, ix, iy, height in zip(
                oriented, found.ix[chosen].tolist(), found.iy[chosen].tolist(), found.z[chosen], strict=True
            )
        ]
        columns = len(HEURISTIC_COLUMNS)
        rows = table[:m]
        rows[:, 0] = 1.0
        rows[:, 1], rows[:, 2], rows[:, 3] = found.ix[chosen] * cell, found.iy[chosen] * cell, z
        rows[:, 4:7] = extents
        rows[:, 7] = [o.yaw for o in oriented]
        rows[:, 8] = [o.pose_index for o in oriented]
        rows[:, 9] = np.where(perturbed, 0.0, [poses[o.pose_index].probability for o in oriented])
        rows[:, 10] = perturbed
        rows[:, 11] = z + coms[:, 2]
        rows[:, 12] = np.clip(margins, -SUPPORT_CLIP, SUPPORT_CLIP)
        best, worst = offered.scores.min(axis=0), offered.scores.max(axis=0)
        shares = (offered.scores - best) / np.where(worst > best, worst - best, 1.0)
        ranks = offered.ranks
        told = (shares[:, :columns], ranks[:, :columns], shares[:, columns:], ranks[:, columns:])
        rows[:, 13:] = np.concatenate(told, axis=1)
        return table

    def _remaining(self, items: Sequence[ItemView]) -> FloatArray:
        table = np.zeros((self.config.max_items, len(ITEM_FEATURES)))
        for row, item in zip(table, items, strict=False):
            box = float(item.extents.prod())
            row[:8] = [1.0, *item.extents, item.volume, item.mass, item.volume / box, item.deferred]
            bears = min(item.limits.bears, HEAVIEST_ITEM)  # infinite where there is no limit
            row[8:] = [math.radians(item.limits.tilt_deg), bears, item.refused]
        return table


def _box(low: FloatArray, high: FloatArray) -> spaces.Box:
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
