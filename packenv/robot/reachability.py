"""How much of a container the robot can serve from above, wherever the container stands.

With the cup pointing down, the arm's posture depends on the cup's height and on its distance r from joint 1's
axis alone: joint 1 turns the whole picture about the axis, and joint 6 takes the yaw. One map over (r, z)
therefore answers for every place around the robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from packenv.robot.cell import RIM_CLEARANCE, Cell, CellSetup
from packenv.robot.protocol import Robot
from packenv.types import BoolArray, Container, FloatArray

TALLEST_ITEM = 0.30
"""Tallest item that may hang below the cup, m (the paper's container is 0.30 m high)."""

LOWEST_CUP = 0.005
"""Lowest final height of the cup in the map: the thickness of the thinnest item worth packing, m."""


@dataclass(frozen=True, eq=False)
class ReachMap:
    """Which final cup positions the robot reaches by a top-down path, for one rim height.

    Attributes:
        rim: height of the rim above the base frame's z = 0, m.
        radii: (n,) distances of the cup from joint 1's axis, evenly spaced, m.
        heights: (h,) final heights of the cup, from ``LOWEST_CUP`` to the rim, m.
        reachable: (n, h).
    """

    rim: float
    radii: FloatArray
    heights: FloatArray
    reachable: BoolArray


def reach_map(robot: Robot, rim: float, radii: FloatArray, levels: int = 13) -> ReachMap:
    """Try the whole path to every cell of the map.

    The path to a cup height z begins where an item as tall as possible, that is min(z, ``TALLEST_ITEM``),
    hangs ``RIM_CLEARANCE`` above the rim. A cell counts where one continuous branch stays within the limits,
    with links 2 to 6 above the rim and the arm off itself, from there to z.

    Args:
        robot: with its gripper.
        rim: height of the rim above the base frame's z = 0, m.
        radii: (n,) distances from joint 1's axis, m.
        levels: number of heights.

    Returns:
        the map.
    """
    heights = np.linspace(LOWEST_CUP, rim, levels)
    cell = Cell(CellSetup(robot), Container(0.1, 0.1, rim), (0.0, 0.0, 0.0))
    reachable = np.zeros((len(radii), levels), dtype=np.bool_)
    for i, r in enumerate(radii):
        for j, z in enumerate(heights):
            lift = rim + RIM_CLEARANCE + min(float(z), TALLEST_ITEM) - float(z)
            path = cell.top_down_path(np.array([r, 0.0, z]), lift)
            reachable[i, j] = len(cell.clear_branches(path)) > 0
    return ReachMap(rim, np.asarray(radii, dtype=np.float64), heights, reachable)


def share(reach: ReachMap, container: Container, corner: tuple[float, float], spacing: float = 0.02) -> float:
    """Share of a container's inner volume that the cup reaches, the container standing at a corner.

    Args:
        reach: map for the container's height.
        container: the box.
        corner: (x, y) of its inner corner in the base frame, m; axes parallel to the base's.
        spacing: of the sampled positions in x and y, m; the walls' inner faces are sampled too.

    Returns:
        0 to 1. A position counts where the map's cells on both sides of its distance are reachable.
    """
    x, y = (points + start for points, start in zip(_across(container, spacing), corner, strict=True))
    return _share_at(reach, np.hypot(x[:, None], y[None, :]).ravel())


@lru_cache(maxsize=256)
def share_of_cell(cell: Cell) -> float:
    """Roughly the share of its container's inner volume that a cell's robot reaches, in 10 ms."""
    across = np.meshgrid(*_across(cell.container, 0.04), 0.0)
    points = cell.to_base(np.stack(across, axis=-1).reshape(-1, 3))
    distances = np.hypot(points[:, 0], points[:, 1])
    radii = np.linspace(distances.min() - 1e-9, distances.max() + 1e-9, 14)
    return _share_at(reach_map(cell.robot, cell.rim, radii, levels=8), distances)


def _across(container: Container, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Positions along x and along y, m, the walls' inner faces included."""
    x, y = (np.linspace(0.0, size, int(np.ceil(size / spacing)) + 1) for size in container.size[:2])
    return x, y


def _share_at(reach: ReachMap, distance: FloatArray) -> float:
    """Share of the positions at these distances (n,), and of the map's heights, that are reachable."""
    above = np.searchsorted(reach.radii, distance)
    known = (above >= 1) & (above < len(reach.radii))
    above = np.clip(above, 1, len(reach.radii) - 1)
    both = reach.reachable[above] & reach.reachable[above - 1] & known[:, None]
    return float(both.mean())


def corner_distances(container: Container, corner: tuple[float, float]) -> tuple[float, float]:
    """Smallest and largest distance of a container's inside from joint 1's axis, m."""
    x = np.array([corner[0], corner[0] + container.length])
    y = np.array([corner[1], corner[1] + container.width])
    nearest = np.hypot(np.clip(0.0, x[0], x[1]), np.clip(0.0, y[0], y[1]))
    return float(nearest), float(np.hypot(np.abs(x).max(), np.abs(y).max()))
