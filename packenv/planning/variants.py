"""Fewer orientations, where a heuristic that looks at one item at a time chose badly among all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from packenv.config import CLEARANCE
from packenv.types import OrientedItem

_MOST = 2
"""Orientations at which equal items are tried side by side; twice as many of what may nest."""


def is_hollow(volume: float, orientations: Sequence[OrientedItem]) -> bool:
    """Whether an item of this volume, m³, leaves half of its bounding box or more to others."""
    return bool(orientations) and volume < 0.5 * float(orientations[0].extents.prod())


def side_by_side(
    volume: float, orientations: Sequence[OrientedItem], size: tuple[float, float, float], placed: int
) -> Iterator[OrientedItem]:
    """Orientations at which more equal items may fit than were placed, the most promising first.

    One at a time they get mixed orientations, and room is left at the ends of rows.

    Args:
        volume: of one item, m³.
        orientations: that are tried.
        size: of the container, m.
        placed: how many of them a packing has.
    """
    room = np.add(size, CLEARANCE)
    # Upright or upside down, hollow items may nest: how many then fit, the bounding box does not tell.
    hollow = is_hollow(volume, orientations)
    counts = {
        (*oriented.extents.round(6).tolist(), oriented.pose_index if hollow else 0): (
            int(np.prod(room // oriented.extents)),
            oriented,
        )
        for oriented in reversed(orientations)
    }
    best = sorted(counts.values(), key=lambda found: -found[0])[: 2 * _MOST if hollow else _MOST]
    return (oriented for fit, oriented in best if fit > placed or (hollow and fit))
