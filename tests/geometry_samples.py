"""Random rotations, points on an item's surface, and heightmaps by their definition."""

from __future__ import annotations

import numpy as np

from packenv.geometry.pose_groups import ANGLE_TOLERANCE, PoseComparer
from packenv.geometry.raster_kernels import clip_triangle
from packenv.types import Item


def random_rotation(seed: int) -> np.ndarray:
    """(3, 3) rotation, the same for the same seed."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def surface_samples(item: Item, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) points on the surface, mesh frame, m."""
    corners = item.vertices[item.faces[rng.integers(0, len(item.faces), count)]]
    u, v = rng.random((2, count, 1))
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    return corners[:, 0] + u * (corners[:, 1] - corners[:, 0]) + v * (corners[:, 2] - corners[:, 0])


def rasterize_by_clipping(
    vertices: np.ndarray, faces: np.ndarray, cell: float, top: np.ndarray, bottom: np.ndarray
) -> None:
    """What ``rasterize`` computes, by clipping every triangle to every cell: its definition, word for word."""
    polygons = np.empty((3, 12, 3))
    for face in faces:
        clip_triangle(np.ascontiguousarray(vertices[face]), cell, top, bottom, *polygons)


def same_pose(comparer: PoseComparer, down_a: np.ndarray, down_b: np.ndarray) -> bool:
    """Whether two support directions are near-equal, by angle or by shape."""
    return bool(down_a @ down_b >= np.cos(ANGLE_TOLERANCE)) or comparer.same_shape(down_a, down_b)
