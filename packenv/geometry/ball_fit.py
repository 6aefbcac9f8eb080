"""Whether an item is a ball, and which."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from packenv.types import FloatArray

ROUND_SHARE, ROUND = 0.035, 0.0005
"""A ball's surface is within this share of its radius of the sphere, or within so many m."""


@dataclass(frozen=True, eq=False)
class Ball:
    """A sphere that stands for an item in physics.

    Attributes:
        centre: (3,) mesh frame, m.
        radius: m.
    """

    centre: FloatArray
    radius: float


def fit_ball(vertices: FloatArray, faces: np.ndarray) -> Ball | None:
    """The sphere through an item's surface, or None where it is no ball.

    Args:
        vertices: (n, 3), m.
        faces: (m, 3).

    Returns:
        The least-squares sphere through the vertices where every vertex and the middle of every face is near
        it (:data:`ROUND_SHARE`, :data:`ROUND`) and the surface goes all the way round.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size = high - low
    if size.min() < 0.9 * size.max():
        return None
    # |p - c|² = r² is linear in c and r² - |c|² (taken about the middle for the digits).
    middle = (low + high) / 2
    points = vertices[np.unique(faces)] - middle
    system = np.column_stack([2.0 * points, np.ones(len(points))])
    solution, _, rank, _ = np.linalg.lstsq(system, np.einsum("ij,ij->i", points, points), rcond=None)
    squared = float(solution[3] + solution[:3] @ solution[:3])
    if rank < 4 or squared <= 0:
        return None
    radius = squared**0.5
    allowed = max(ROUND_SHARE * radius, ROUND)
    outward = np.linalg.norm(points - solution[:3], axis=1) - radius
    inner = np.linalg.norm((vertices[faces] - middle).mean(axis=1) - solution[:3], axis=1) - radius
    if np.abs(outward).max() > allowed or inner.min() < -allowed or inner.max() > allowed:
        return None
    if np.abs(size / 2 - radius).max() > 2 * allowed:
        return None
    return Ball(middle + solution[:3], radius)
