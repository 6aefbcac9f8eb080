"""Where the vacuum cup can take an item: a grasp generator on the top heightmap (paper Sec. V-C).

The paper takes every item "at the center of the object's top surface", the gripper's axis along z, whatever
the surface is like there. A real cup must seal, so by default a grasp is asked to be a place on which the cup
lies.

===========  ==========================  ====================  ==========================================
kind         cup on the footprint        slope of best plane   heights above that plane, high less low
===========  ==========================  ====================  ==========================================
``centre``   wholly                      at most 10°           at most 2 mm
``flat``     wholly                      at most 10°           at most 2 mm
``rough``    at least 90 % of its cells  at most 20°           at most 5 mm
===========  ==========================  ====================  ==========================================

These bounds are assumptions about soft cups of 2 cm: 2 mm is what a thin lip takes up, 5 mm and 20° what
a cup with bellows does. They were not measured on a real cup. *Wholly* is to within a cell: the
footprint counts every cell that the item touches, so up to one cell's width (2 mm) of the lip may hang over.
The plane is the least-squares plane through the cells under the cup.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal, TypeAlias

import numpy as np

from packenv.planning.manipulation import cup_kernels
from packenv.planning.options import GraspRule
from packenv.robot.gripper import CUP_RADIUS
from packenv.types import FloatArray, IntArray, OrientedItem

Kind: TypeAlias = Literal["centre", "flat", "rough"]

FLAT_RELIEF: Final = 0.002
"""Largest height above the best plane less the smallest, for ``flat`` and ``centre``, m."""
FLAT_SLOPE: Final = math.tan(math.radians(10.0))
"""Steepest best plane for ``flat`` and ``centre``."""
ROUGH_RELIEF: Final = 0.005
"""As ``FLAT_RELIEF``, for ``rough``, m."""
ROUGH_SLOPE: Final = math.tan(math.radians(20.0))
"""As ``FLAT_SLOPE``, for ``rough``."""
ROUGH_COVER: Final = 0.9
"""Share of the cells under the cup that the footprint must hold, for ``rough``."""

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True, eq=False)
class Grasp:
    """A place for the cup, its axis along z.

    Attributes:
        point: (3,) centre of the cup's lip in the oriented frame, m. Its height is that of the highest
            cell under the cup, so a stiff tube that stands on it meets no other part of the item.
        kind: ``centre`` of the top surface, another ``flat`` spot, or ``rough`` (see the module).
        tilt: angle between z and the normal of the best plane under the cup, rad; NaN where it is unknown.
        relief: largest height above that plane less the smallest, m; NaN where it is unknown.
    """

    point: FloatArray
    kind: Kind
    tilt: float
    relief: float


def generate_grasps(
    oriented: OrientedItem, *, rule: GraspRule = "seal", radius: float = CUP_RADIUS, limit: int = 8
) -> tuple[Grasp, ...]:
    """Places where the cup can take an item, the best first.

    Depends on the item alone: keep the answer beside the oriented item.

    Args:
        oriented: the item at its orientation.
        rule: ``flat``: the centre of the top surface (of the bounding box from above) if it is flat, then
            further flat spots, nearest to the centre of mass first, ``radius`` or more apart.
            ``seal``: the same, and where there is none, rough spots, the best seal first.
            ``paper``: the centre alone, whatever is there. Where the item has a hole there, wider than the
            cup, its height is the item's: the paper's assumption, kept for comparison.
        radius: of the cup, m.
        limit: largest number of grasps, at least 1.

    Returns:
        the grasps; none is an answer: the cup cannot take the item in this orientation.

    Raises:
        ValueError: the rule is unknown, or a number is not positive.
    """
    if rule not in ("seal", "flat", "paper"):
        raise ValueError(f"rule is {rule!r}, give 'seal', 'flat' or 'paper'")
    if not (radius > 0.0 and limit >= 1):
        raise ValueError(f"radius is {radius:g} and limit {limit}, give radius > 0 and limit ≥ 1")
    top, bottom, cell = oriented.top, oriented.bottom, oriented.cell_size
    spots = np.empty((limit, 5))
    x, y = (float(e) / 2.0 for e in oriented.extents[:2])
    cells, offsets = _under_cup(x, y, radius, cell)
    if rule == "paper":
        covered, highest, slope, relief = cup_kernels.seal(top, bottom, 0, 0, cells, offsets, 0, math.inf)
        point = np.array([x, y, highest if covered else oriented.height])
        known = math.isfinite(relief)
        tilt = math.atan(slope) if known else math.nan
        return (Grasp(point, "centre", tilt, relief if known else math.nan),)
    covered, highest, slope, relief = cup_kernels.seal(
        top, bottom, 0, 0, cells, offsets, len(cells), FLAT_RELIEF
    )
    central = covered == len(cells) and slope <= FLAT_SLOPE and relief <= FLAT_RELIEF
    if central:
        spots[0] = x, y, highest, slope, relief
    order = cup_kernels.by_distance(bottom, oriented.com[0] / cell, oriented.com[1] / cell)
    cells, offsets = _under_cup(0.5 * cell, 0.5 * cell, radius, cell)
    found = cup_kernels.flat_spots(
        top, bottom, order, cells, offsets, cell, FLAT_RELIEF, FLAT_SLOPE, radius, spots, int(central)
    )
    kind: Kind = "flat"
    if not found and rule == "seal":
        kind = "rough"
        least = math.ceil(ROUGH_COVER * len(cells))
        found = cup_kernels.rough_spots(
            top, bottom, order, cells, offsets, cell, radius, ROUGH_RELIEF, ROUGH_SLOPE, least, radius, spots
        )
    return tuple(
        Grasp(spot[:3].copy(), "centre" if central and k == 0 else kind, math.atan(spot[3]), float(spot[4]))
        for k, spot in enumerate(spots[:found])
    )


@lru_cache(maxsize=256)
def _under_cup(x: float, y: float, radius: float, cell: float) -> tuple[IntArray, FloatArray]:
    """Cells under a cup at (x, y), and where their centres are from its own (see ``cup_kernels``)."""
    room = (math.ceil(2.0 * radius / cell) + 2) ** 2
    cells, offsets = np.empty((room, 2), dtype=np.int64), np.empty((room, 2))
    count = cup_kernels.disc_cells(x, y, radius, cell, cells, offsets)
    # The lip first, in jumps around it: that is where an uneven spot shows soonest.
    angle = np.arctan2(offsets[:count, 1], offsets[:count, 0])
    inner = np.linalg.norm(offsets[:count], axis=1) <= radius - cell
    jumps = np.argsort(np.argsort(angle)) * _GOLDEN % 1.0
    order = np.lexsort((jumps, inner))
    return np.ascontiguousarray(cells[:count][order]), np.ascontiguousarray(offsets[:count][order])
