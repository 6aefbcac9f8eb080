"""Where a picture is taken from."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from packenv.types import FloatArray

_FIELD_OF_VIEW = math.radians(30.0)  # of the picture's longer side
_MARGIN = 0.04  # of the picture's shorter side left free on every side


def in_axes(points: FloatArray, axes: FloatArray) -> FloatArray:
    """(n, k) points along the (k, 3) rows of ``axes``.

    The product by ``@`` would start threads, which on a busy machine takes ten times as long.
    """
    turned: FloatArray = np.einsum("ij,kj->ik", points, axes)
    return turned


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera.

    Attributes:
        eye: (3,) m.
        axes: (3, 3) rows: unit vectors to the right, upwards, and from the scene back to the eye.
        focal: distance of the picture plane, px.
        size: (width, height) of the picture, px.
    """

    eye: FloatArray
    axes: FloatArray
    focal: float
    size: tuple[int, int]

    def project(self, points: FloatArray) -> FloatArray:
        """Where points appear.

        Args:
            points: (n, 3) in the container frame, m.

        Returns:
            (n, 3) column and row in px, rows downwards, and nearness = 1 / depth in 1/m; a point behind the
            eye has a nearness of 0 or less and no meaningful column and row.
        """
        local = in_axes(points - self.eye, self.axes)
        depth = -local[:, 2]
        nearness = 1.0 / np.where(np.abs(depth) < 1e-12, -1e-12, depth)
        column = self.size[0] / 2 + self.focal * local[:, 0] * nearness
        row = self.size[1] / 2 - self.focal * local[:, 1] * nearness
        return np.column_stack([column, row, nearness])

    def rays(self, samples: int) -> FloatArray:
        """The rays of view, of unit depth.

        Args:
            samples: sub-pixels along each side of a pixel.

        Returns:
            (3, 3) rows: the ray's change for a sub-pixel to the right, its change for one downwards, and the ray
            through the picture's upper left corner.
        """
        right, up, back = self.axes
        corner = -back - (right * self.size[0] - up * self.size[1]) / 2 / self.focal
        return np.stack([right / (self.focal * samples), -up / (self.focal * samples), corner])


def camera_around(
    points: FloatArray, size: tuple[int, int], azimuth: float = -58.0, elevation: float = 32.0
) -> Camera:
    """The nearest camera that sees some points from a side.

    Args:
        points: (n, 3) m.
        size: (width, height) of the picture, px.
        azimuth: of the way to the eye, degrees from +x towards +y.
        elevation: degrees above the horizon, between -90 and 90.

    Returns:
        The camera; the points fill the picture but for a small margin.

    Raises:
        ValueError: the size or the elevation is out of range.
    """
    width, height = size
    if width < 16 or height < 16:
        raise ValueError(f"size {width} x {height}: give at least 16 x 16 pixels")
    if not -90.0 <= elevation <= 90.0:
        raise ValueError(f"elevation {elevation:g}: give degrees between -90 and 90")
    turn, rise = math.radians(azimuth), math.radians(elevation)
    back = np.array([math.cos(turn) * math.cos(rise), math.sin(turn) * math.cos(rise), math.sin(rise)])
    right = np.array([-math.sin(turn), math.cos(turn), 0.0])
    axes = np.stack([right, np.cross(back, right), back])
    focal = max(size) / 2 / math.tan(_FIELD_OF_VIEW / 2)
    free = 1.0 - 2 * _MARGIN * min(size) / np.array(size)
    slopes = np.array(size) / 2 * free / focal
    corners = points @ axes.T
    # |across - shift| <= slope * (distance - near) for all corners: the two extremes give both unknowns.
    high = np.max(corners[:, :2] + slopes * corners[:, 2:], axis=0)
    low = np.max(-corners[:, :2] + slopes * corners[:, 2:], axis=0)
    distance = float(np.max((high + low) / (2 * slopes)))
    shift = (high - low) / 2
    eye = np.array([shift[0], shift[1], distance]) @ axes
    return Camera(eye=eye, axes=axes, focal=focal, size=(width, height))
