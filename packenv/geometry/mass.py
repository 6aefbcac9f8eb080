"""Mass properties of a closed surface, and the rule for items whose mass nobody weighed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from packenv.types import FloatArray, IntArray

TYPICAL_DENSITY = 370.0
"""kg/m³ over the geometric mean of an item's volume and its hull's volume; see :func:`estimated_mass`."""

TYPICAL_ERROR = 2.0
"""Half of the estimated masses are wrong by at most this factor."""


@dataclass(frozen=True, eq=False)
class SolidProperties:
    """What a closed surface encloses, at density 1 kg/m³.

    Attributes:
        volume: m³; negative where the faces point inward.
        com: (3,) centroid, m.
        inertia: (3, 3) about the centroid, mesh axes, m⁵ (times density: kg m²).
    """

    volume: float
    com: FloatArray
    inertia: FloatArray


def signed_volume(vertices: FloatArray, faces: IntArray) -> float:
    """Volume that a closed surface encloses, m³; negative where its faces point inward."""
    a, b, c = _corners(vertices - _middle(vertices), faces)
    return float(_determinants(a, b, c).sum() / 6.0)


def area(vertices: FloatArray, faces: IntArray) -> float:
    """Area of a surface, m²."""
    a, b, c = _corners(vertices, faces)
    (ux, uy, uz), (vx, vy, vz) = (b - a).T, (c - a).T
    squares = (uy * vz - uz * vy) ** 2 + (uz * vx - ux * vz) ** 2 + (ux * vy - uy * vx) ** 2
    return float(np.sqrt(squares).sum() / 2.0)


def solid_properties(vertices: FloatArray, faces: IntArray) -> SolidProperties:
    """Integrate volume, centroid and inertia exactly over the tetrahedra from one point to every face.

    Where a closed surface runs through itself, the part inside twice counts twice.

    Args:
        vertices: (n, 3), m.
        faces: (m, 3), closed, counter-clockwise seen from outside.

    Returns:
        Properties at unit density.

    Raises:
        ValueError: the surface encloses no volume.
    """
    middle = _middle(vertices)
    a, b, c = _corners(vertices - middle, faces)
    sixfold = _determinants(a, b, c)
    volume = float(sixfold.sum() / 6.0)
    if volume == 0.0 or not math.isfinite(volume):
        raise ValueError(f"the surface encloses a volume of {volume:g}")
    total = a + b + c
    com = sixfold @ total / (24.0 * volume)
    # For a tetrahedron (0, a, b, c): 120/det · integral of x xᵀ = aaᵀ + bbᵀ + ccᵀ + (a+b+c)(a+b+c)ᵀ.
    second = sum(((x * sixfold[:, None]).T @ x for x in (a, b, c, total)), np.zeros((3, 3))) / 120.0
    second -= volume * np.outer(com, com)
    inertia = np.trace(second) * np.eye(3) - second
    return SolidProperties(volume, com + middle, (inertia + inertia.T) / 2)


def hull_volume(vertices: FloatArray) -> float:
    """Volume of the convex hull, m³.

    Args:
        vertices: (n, 3), not all in one plane.
    """
    from scipy.spatial import ConvexHull

    return float(ConvexHull(vertices).volume)


def estimated_mass(volume: float, hull: float) -> float:
    """Mass of an item that nobody weighed: 370 kg/m³ × √(volume × hull volume).

    A box of cereal is mostly air, a bowl is a thin dense shell in a large hull: over the hull volume,
    shells are light and fillings heavy, over their own volume the other way round. The geometric mean
    of both sits between. The density is the median over the 62 single household items of
    the YCB and APC 2015 sets whose mass is published (marbles, toy bricks and other assemblies, whose
    masses are shares of a set's, left out). Half of those 62 are estimated within a factor of 2.0, 90 %
    within 3.9; by volume alone it would be 2.1 and 8.2, by hull volume alone 2.6 and 4.0.

    Args:
        volume: of the item, m³.
        hull: of its convex hull, m³.

    Returns:
        kg.
    """
    return TYPICAL_DENSITY * math.sqrt(volume * hull)


def _middle(vertices: FloatArray) -> FloatArray:
    """Centre of the bounding box: integrals about it lose no digits where the mesh is far from its origin."""
    middle: FloatArray = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return middle


def _corners(points: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]


def _determinants(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """(m,) a · (b × c). Written out: ten times as fast as np.cross."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = a.T, b.T, c.T
    determinants: FloatArray = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    return determinants
