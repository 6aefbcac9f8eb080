"""One layout on its way into a container: its pieces are lowered to their places, the rest is the planner's."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from packenv.planning.inquiry import Inquiry
from packenv.planning.packing_pass import PackingPass
from packenv.planning.search.container_map import PolyphaseMap
from packenv.planning.search.places import PlaceList, listed, lowered
from packenv.planning.sequence import Piece
from packenv.types import OrientedItem


@dataclass(frozen=True, eq=False)
class Target:
    """Where a layout has a piece.

    Attributes:
        oriented: the item at its orientation.
        x: its smallest x, m.
        y: its smallest y, m.
    """

    oriented: OrientedItem
    x: float
    y: float


@dataclass(eq=False)
class LayoutPass(PackingPass):
    """A pass in which some pieces have a place already; what cannot be placed there comes again at the end.

    Attributes:
        targets: the places.
    """

    targets: Mapping[Piece, Target] = field(default_factory=dict)

    def first_pass(self, piece: Piece) -> Counter[str] | None:
        """Straight down at the layout's place, as far as the meshes let it come; elsewhere without such a place."""
        target = self.targets.get(piece)
        if target is None:
            return super().first_pass(piece)
        planner, surface = self.planner, self.pile.surface
        inquiry = Inquiry(planner.constraints, self.pile)
        if inquiry.objected(target.oriented):
            return inquiry.rejections
        places = np.array([[target.x, target.y]])
        found = lowered(PlaceList(target.oriented, PolyphaseMap(surface, 1), places, np.zeros(1)))
        if found is None:
            return inquiry.rejections
        candidates = listed([found], piece.item, surface.cell_size)
        scores = planner.heuristic(candidates, self.rng)
        worth = np.flatnonzero(inquiry.screened(candidates))
        candidates, scores = candidates.only(worth), scores[worth]
        for tier in planner.strategy.restart_tiers or planner.strategy.first:
            # A layout has no clearance to give.
            if not len(candidates) or tier.clearance:
                continue
            if self.among(candidates, scores, tier, piece, "layout", inquiry):
                return None
        return inquiry.rejections

    def fall_back(self, piece: Piece, rejections: Counter[str]) -> Counter[str] | None:
        """Anywhere: also where heights only grow, for its place was the only one that was tried."""
        found = super().fall_back(piece, rejections)
        if found is None or self.planner.perturbations is not None:
            return found
        return self.attempt(piece, self.orientations(piece.item), "later", found)
