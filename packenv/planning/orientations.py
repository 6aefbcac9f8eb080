"""Perturbed orientations: the roll and pitch grid of the paper's fallback (Alg. 4)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from packenv.config import GridConfig
from packenv.geometry.heightmaps import orient_item
from packenv.geometry.transforms import axis_rotation, yaw_rotation
from packenv.types import FloatArray, Item, OrientedItem, StablePose

PERTURBATION = math.pi / 4
"""Δr of the paper, for roll and pitch."""


def euler_zyx(rotation: FloatArray) -> tuple[float, float, float]:
    """Angles (γ, φ, ψ) of a (3, 3) rotation R_z(γ) R_y(φ) R_x(ψ), rad.

    γ first, the others from what is left after it is turned back: so they fit together at the poles too,
    where γ alone is arbitrary.
    """
    gamma = math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))
    left = axis_rotation(2, -gamma) @ rotation
    phi = math.atan2(-float(left[2, 0]), float(left[0, 0]))
    psi = math.atan2(-float(left[1, 2]), float(left[1, 1]))
    return gamma, phi, psi


def perturbations(
    item: Item, poses: Sequence[StablePose], grid: GridConfig, size: tuple[float, float, float]
) -> Iterator[tuple[OrientedItem, ...]]:
    """Yield, for each roll and pitch offset of Alg. 4, the item at all poses and yaws, maps included.

    The first offset is (0, 0): the stable poses themselves. An orientation that an earlier offset had
    already (the grid of Euler angles covers most rotations twice) is left out.

    Args:
        item: the item.
        poses: its stable poses that are tried.
        grid: yaws and cell size.
        size: of the container, m: an orientation whose bounding box does not fit it gets no maps and is left
            out, but its offset is still yielded.
    """
    angles = [k * PERTURBATION for k in range(round(2 * math.pi / PERTURBATION))]
    seen: set[bytes] = set()
    from scipy.spatial import ConvexHull  # a third of a second, and most plans need no fallback

    outline = item.vertices[ConvexHull(item.vertices).vertices]
    largest = np.add(size, 1e-9)
    for roll in angles:
        for pitch in angles:
            oriented = []
            for index, pose in enumerate(poses):
                gamma, phi, psi = euler_zyx(pose.rotation)
                tilted = axis_rotation(1, phi + roll) @ axis_rotation(0, psi + pitch)
                for k in range(grid.n_yaws):
                    yaw = k * math.pi / grid.n_yaws
                    rotation = yaw_rotation(yaw + gamma) @ tilted
                    key = (np.round(rotation, 6) + 0.0).tobytes()
                    if key in seen:
                        continue
                    seen.add(key)
                    if np.any(np.ptp(outline @ rotation.T, axis=0) > largest):
                        continue
                    oriented.append(
                        orient_item(item, rotation, cell_size=grid.cell_size, pose_index=index, yaw=yaw)
                    )
            yield tuple(oriented)
