"""Equal items side by side: a heuristic that looks at one at a time mixes orientations, and leaves room at the ends."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from packenv.config import CLEARANCE
from packenv.types import OrientedItem

_MOST = 2
"""Orientations at which equal items are tried side by side; twice as many of what may nest."""


def side_by_side(
    volume: float, orientations: Sequence[OrientedItem], size: tuple[float, float, float], placed: int
) -> Iterator[OrientedItem]:
    """Orientations at which more equal items may fit than were placed, the most promising first.

    Args:
        volume: of one item, m³.
        orientations: that are tried.
        size: of the container, m.
        placed: how many of them a packing has.
    """
    room = np.add(size, CLEARANCE)
    # What is mostly hollow may nest, upright or upside down: how many then fit, its bounding box does not tell.
    hollow = volume < 0.5 * float(orientations[0].extents.prod())
    counts = {
        (*oriented.extents.round(6).tolist(), oriented.pose_index if hollow else 0): (
            int(np.prod(room // oriented.extents)),
            oriented,
        )
        for oriented in reversed(orientations)
    }
    best = sorted(counts.values(), key=lambda found: -found[0])[: 2 * _MOST if hollow else _MOST]
    return (oriented for fit, oriented in best if fit > placed or (hollow and fit))
