"""A heuristic of your own: one score for each candidate, the lowest wins.

On the command line: ``robotpack pack ORDER --heuristic examples.my_heuristic:flattest``.
"""

import numpy as np

import packenv as rp


def flattest(candidates: rp.Candidates, rng: np.random.Generator) -> np.ndarray:
    """Keep the pile low: the height of the item's top, and the nearest corner where two are equal."""
    return candidates.z + candidates.extents[:, 2] + 0.01 * candidates.xy_sum


if __name__ == "__main__":
    order = rp.Order.of("cracker_box", "mug", "bowl", "banana", "soap_bar")
    heights = {}
    for heuristic in (flattest, "hm"):
        plan = rp.plan(order, rp.Container(0.32, 0.32, 0.30), heuristic=heuristic)
        assert plan.complete
        heights[heuristic] = plan.metrics["height"]
    print(f"pile {heights[flattest]:.3f} m high, with hm {heights['hm']:.3f} m")
    assert heights[flattest] <= heights["hm"]
