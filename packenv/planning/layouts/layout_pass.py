"""One layout on its way into a container: its pieces are lowered to their places, the rest is the planner's."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from packenv.planning.inquiry import Inquiry
from packenv.planning.packing_pass import PackingPass
from packenv.planning.search.container_map import PolyphaseMap
from packenv.planning.search.places import PlaceList, listed, lowered
from packenv.planning.sequence import Piece
from packenv.planning.tiers import Tier
from packenv.types import FloatArray, OrientedItem

_ASIDE = 3
"""Cells along x and y by which a piece may come to lie beside its place."""


@dataclass(frozen=True, eq=False)
class Target:
    """Where a layout has a piece.

    Attributes:
        oriented: the item at its orientation.
        corner: (3,) its smallest x, y and z, m.
    """

    oriented: OrientedItem
    corner: FloatArray


@dataclass(eq=False)
class LayoutPass(PackingPass):
    """A pass in which some pieces have a place already; what cannot be placed there comes again at the end.

    Attributes:
        targets: the places.
    """

    targets: Mapping[Piece, Target] = field(default_factory=dict)

    def first_pass(self, piece: Piece) -> Counter[str] | None:
        """Straight down at the layout's place, as far as the meshes let it come, or beside it; else anywhere."""
        target = self.targets.get(piece)
        if target is None:
            return super().first_pass(piece)
        inquiry = Inquiry(self.planner.constraints, self.pile)
        if inquiry.objected(target.oriented):
            return inquiry.rejections
        for offsets in (np.zeros((1, 2)), _around(self.planner.grid.cell_size)):
            if self.place_near(piece, target, offsets, inquiry):
                return None
        return inquiry.rejections

    def place_near(self, piece: Piece, target: Target, offsets: FloatArray, inquiry: Inquiry) -> bool:
        """Place a piece where a layout has it, or a little aside, but not higher than it can be helped.

        Args:
            piece: of the order.
            target: its place.
            offsets: (n, 2) by which it may be moved, m.
            inquiry: is asked.
        """
        surface = self.pile.surface
        last = np.maximum(np.subtract(surface.container.size[:2], target.oriented.extents[:2]), 0.0)
        places = np.unique(np.clip(target.corner[:2] + offsets, 0.0, last), axis=0)
        found = lowered(PlaceList(target.oriented, PolyphaseMap(surface, 1), places, np.zeros(len(places))))
        if found is None:
            return False
        aside = np.linalg.norm(found.places - target.corner[:2], axis=1)
        scores = np.maximum(found.z - target.corner[2], 0.0) + 0.1 * aside
        candidates = listed([found], piece.item, surface.cell_size)
        worth = np.flatnonzero(inquiry.screened(candidates))
        candidates, scores = candidates.only(worth), scores[worth]
        for tier in self.planner.strategy.restart_tiers or self.planner.strategy.first:
            # A layout has no clearance to give.
            if not len(candidates) or tier.clearance:
                continue
            if self.among(candidates, scores, tier, piece, "layout", inquiry):
                return True
        return False

    def fall_back(self, piece: Piece, tiers: Sequence[Tier], rejections: Counter[str]) -> Counter[str] | None:
        """Anywhere: also where heights only grow, for its place was the only one that was tried."""
        found = super().fall_back(piece, tiers, rejections)
        if found is None or self.planner.perturbations is not None:
            return found
        return self.attempt(piece, self.orientations(piece.item), "later", found)


def _around(cell: float) -> FloatArray:
    """(n, 2) how far beside a layout's place a piece is tried, by whole cells, m."""
    steps = np.arange(-_ASIDE, _ASIDE + 1) * cell
    return np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
