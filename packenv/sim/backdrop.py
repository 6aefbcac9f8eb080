"""Where a picture is taken from, and what stands behind everything in it: table and wall.

The table fills most pixels: to compute it once spares a third of the time of every picture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pybullet
from numpy.typing import NDArray

from packenv.types import FloatArray

_TABLE = np.array([0.925, 0.91, 0.88])
_WALL = np.array([[0.83, 0.87, 0.91], [0.96, 0.97, 0.98]])
"""Above and below."""
_AROUND = 0.9
"""The table ends so far from the container's origin and beyond the robot, m."""
_DARKENED = 0.3
"""Share of light that is lost on the table at the foot of a thing."""
_FADES = 0.035
"""Over what distance the light comes back, m."""


@dataclass(frozen=True, eq=False)
class View:
    """A camera in the container frame.

    Attributes:
        eye: (3,) where it is, m.
        target: (3,) where it looks, m.
        field: vertical field of view, degrees.
    """

    eye: FloatArray
    target: FloatArray
    field: float

    @property
    def distance(self) -> float:
        """From eye to target, m."""
        return float(np.linalg.norm(self.eye - self.target))

    @property
    def yaw_and_pitch(self) -> tuple[float, float]:
        """As PyBullet's window has them, degrees."""
        x, y, z = (self.eye - self.target) / self.distance
        return math.degrees(math.atan2(x, -y)), -math.degrees(math.asin(z))

    @property
    def matrix(self) -> tuple[float, ...]:
        """(16,) view matrix for PyBullet."""
        view: tuple[float, ...] = pybullet.computeViewMatrix(
            self.eye.tolist(), self.target.tolist(), [0.0, 0.0, 1.0]
        )
        return view

    def projection(self, aspect: float) -> tuple[float, ...]:
        """(16,) projection matrix for PyBullet; ``aspect`` is width over height."""
        matrix: tuple[float, ...] = pybullet.computeProjectionMatrixFOV(
            self.field, aspect, self.distance * 0.1, self.distance * 6.0
        )
        return matrix

    def rays(self, size: tuple[int, int]) -> FloatArray:
        """(height, width, 3) directions through the middle of every pixel, not of unit length.

        Args:
            size: width and height, pixels.
        """
        width, height = size
        forward = (self.target - self.eye) / self.distance
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        half = math.tan(math.radians(self.field) / 2)
        down, across = np.mgrid[0:height, 0:width] + 0.5
        x, y = (2 * across / width - 1) * half * width / height, (1 - 2 * down / height) * half
        rays: FloatArray = forward + x[..., None] * right + y[..., None] * up
        return rays


@dataclass(frozen=True)
class Standing:
    """Something on the table: a rectangle with rounded corners.

    Attributes:
        low: its smallest x and y without the rounding, m.
        high: its largest x and y without the rounding, m.
        radius: of the rounding, m.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    radius: float

    def distance(self, points: FloatArray) -> FloatArray:
        """(...,) from it to (..., 2) points outside it, m; 0 inside."""
        beyond = np.maximum(np.maximum(np.subtract(self.low, points), np.subtract(points, self.high)), 0.0)
        apart: FloatArray = np.maximum(np.linalg.norm(beyond, axis=-1) - self.radius, 0.0)
        return apart


def backdrop(view: View, size: tuple[int, int], standing: Sequence[Standing]) -> NDArray[np.uint8]:
    """The table at z = 0, darker around what stands on it, and the wall behind it.

    Args:
        view: the camera.
        size: width and height, pixels.
        standing: what stands on the table.

    Returns:
        (height, width, 3) red, green, blue.
    """
    rays = view.rays(size)
    down = np.minimum(rays[..., 2], -1e-9)
    ground = view.eye[:2] - rays[..., :2] * (view.eye[2] / down)[..., None]
    low = np.min([thing.low for thing in standing], axis=0) - _AROUND
    high = np.max([thing.high for thing in standing], axis=0) + _AROUND
    on_table = (rays[..., 2] < 0) & ((low <= ground) & (ground <= high)).all(axis=-1)
    light = np.ones(ground.shape[:2])
    for thing in standing:
        light *= 1.0 - _DARKENED * np.exp(-thing.distance(ground) / _FADES)
    share = np.linspace(0.0, 1.0, size[1])[:, None, None]
    wall = _WALL[0] * (1.0 - share) + _WALL[1] * share
    colours = np.where(on_table[..., None], light[..., None] * _TABLE, wall)
    picture: NDArray[np.uint8] = np.rint(colours * 255.0).astype(np.uint8)
    return picture
