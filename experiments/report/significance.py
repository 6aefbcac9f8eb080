"""Many tests at once: p-values that allow for it."""

from __future__ import annotations

import math
from collections.abc import Sequence


def holm(chances: Sequence[float]) -> list[float]:
    """P-values adjusted after Holm (1979): then one table in 20, not one line in 20, errs at 0.05.

    Args:
        chances: p-values of one table; NaN where nothing was tested, which stays NaN and does not count.

    Returns:
        the adjusted ones, in the same order, each at least the given one and at most 1.
    """
    adjusted = [math.nan] * len(chances)
    tested = sorted((p, k) for k, p in enumerate(chances) if not math.isnan(p))
    least = 0.0
    for rank, (p, k) in enumerate(tested):
        least = max(least, min(1.0, p * (len(tested) - rank)))
        adjusted[k] = least
    return adjusted
