"""How far apart two poses of an item are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from packenv.sim.physics_items import PhysicsItem
from packenv.types import Pose


def pose_gap(item: PhysicsItem, a: Pose, b: Pose) -> float:
    """Largest distance between where two poses of the mesh frame put the same point of an item, m.

    Exact, since no point of a convex part is farther than its corners. Of a ball the centre alone is asked:
    how it is turned makes no difference to anything.
    """
    (r0, p0), (r1, p1) = (item.body_pose(*pose) for pose in (a, b))
    points = item.ball_centre[None] if item.radius > 0.0 else np.concatenate(item.parts)
    return float(np.linalg.norm(points @ (r0 - r1).T + (p0 - p1), axis=1).max())


def spread_mm(gaps: Sequence[float]) -> dict[str, float] | None:
    """``median``, ``p95`` and ``max`` of some gaps in mm; None where there are none."""
    if not gaps:
        return None
    return {"median": float(np.median(gaps)), "p95": float(np.quantile(gaps, 0.95)), "max": max(gaps)}
