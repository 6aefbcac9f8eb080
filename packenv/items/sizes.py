"""Items so much larger or smaller than the others that their unit may be wrong."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

OUTLIER = 8.0
"""Times the median of the others, or a share of one over it: a centimetre is 10 mm, an inch 25.4.

The 94 scans lie within 0.27 and 2.6 of the median of their longest sides, the built-in items within 0.23 and 2.4.
"""


def suspicious_sizes(longest: Mapping[str, float]) -> dict[str, str]:
    """Say which items are far larger or smaller than the others.

    Args:
        longest: longest side of each item, m, by its name.

    Returns:
        What to say, by name; of two items it is said of both, and of one nothing.
    """
    sizes = np.array(list(longest.values()))
    if len(sizes) < 2:
        return {}
    others = "other's size" if len(sizes) == 2 else "others' median"
    said = {}
    for k, (name, size) in enumerate(longest.items()):
        median = float(np.median(np.delete(sizes, k)))
        times = max(size / median, median / size)
        if times >= OUTLIER:
            than = "longer" if size > median else "shorter"
            said[name] = (
                f"suspicious: {size:.3g} m, {times:.0f} times {than} than the {others} "
                f"of {median:.3g} m; is its unit right?"
            )
    return said
