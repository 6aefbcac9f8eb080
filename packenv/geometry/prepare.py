"""What the planner needs of an item and what depends on the item alone: poses and oriented maps."""

from __future__ import annotations

import math
from dataclasses import dataclass

from packenv.config import GridConfig
from packenv.geometry.heightmaps import orient_item
from packenv.geometry.transforms import yaw_rotation
from packenv.limits import NO_LIMITS, ItemLimits
from packenv.types import Item, OrientedItem, StablePose


@dataclass(frozen=True, eq=False)
class PreparedItem:
    """An item with its stable poses and its heightmaps at every orientation that is tried.

    Attributes:
        name: name of the item.
        sha256: hash of its mesh.
        volume: m³.
        poses: the stable poses tried, by falling probability.
        orientations: pose by pose, yaw by yaw.
        limits: what may not be done with it.
    """

    name: str
    sha256: str
    volume: float
    poses: tuple[StablePose, ...]
    orientations: tuple[OrientedItem, ...]
    limits: ItemLimits = NO_LIMITS

    @property
    def box_volume(self) -> float:
        """Volume of the bounding box at the most probable stable pose, unturned, m³.

        The paper sequences by bounding-box volume. A scan's own axes are arbitrary, so the box is taken
        at a resting pose, where it does not change when the mesh file is rotated.
        """
        return float(self.orientations[0].extents.prod())


def prepare_item(item: Item, grid: GridConfig) -> PreparedItem:
    """Compute an item's stable poses and its oriented heightmaps.

    Args:
        item: the item.
        grid: how many poses and yaws, and the cell size.
    """
    from packenv.geometry.stable_poses import stable_poses  # scipy's hull: only when nothing is cached

    poses = stable_poses(item, limit=grid.n_poses)
    orientations = tuple(
        orient_item(
            item,
            yaw_rotation(yaw) @ pose.rotation,
            cell_size=grid.cell_size,
            pose_index=index,
            yaw=yaw,
        )
        for index, pose in enumerate(poses)
        for yaw in (k * math.pi / grid.n_yaws for k in range(grid.n_yaws))
    )
    return PreparedItem(item.name, item.sha256, item.volume, poses, orientations, item.limits)
