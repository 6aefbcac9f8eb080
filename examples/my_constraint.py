"""A constraint of your own: it is asked about every candidate that is free of overlap.

On the command line: ``robotpack pack ORDER --constraint examples.my_constraint:KeepCornerFree``.
"""

from typing import Any

import packenv as rp

SIDE = 0.10
"""Of the corner that stays free, m."""


class KeepCornerFree(rp.Constraint):
    """Leave the far corner of the box to an ice pack."""

    def check(self, trial: rp.Trial, surface: Any, state: Any) -> rp.Verdict:
        """Refuse what reaches into the corner, seen from above."""
        far = trial.corner + trial.oriented.extents
        length, width, _ = surface.container.size
        clear = far[0] <= length - SIDE or far[1] <= width - SIDE
        return rp.Verdict(bool(clear), reason="needs-the-corner")


if __name__ == "__main__":
    box = rp.Container(0.32, 0.32, 0.30)
    order = rp.Order.of("cracker_box", "mug", "bowl", "banana", "soap_bar", "soup_can")
    plan = rp.plan(order, box, own_constraints=[KeepCornerFree()])
    assert plan.placements
    for placement in plan.placements:
        reach = placement.corner + placement.extents
        assert reach[0] <= 0.22 + 1e-9 or reach[1] <= 0.22 + 1e-9
    print(f"packed {len(plan.placements)} of {len(order.names)} items beside the ice pack")
