"""Meshes of things that nest, and how far apart they nest, in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import trimesh

from packenv.types import FloatArray, Item

Ring: TypeAlias = Callable[[float], FloatArray]
"""Outline of a cross-section (n, 2), m, counter-clockwise, by its size: the radius of a polygon's corners, or how far
a rectangle is larger than its core on each side."""

SIDES = 48
"""Of a round cross-section: a multiple of 8, so that facets of items at yaws of 45 degrees are aligned."""


def polygon(radius: float, sides: int = SIDES) -> FloatArray:
    """A regular polygon with this radius of its corners, one of them on the x axis."""
    angles = np.arange(sides) * (2.0 * math.pi / sides)
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def rectangle(x: float, y: float) -> Ring:
    """Rectangles that are larger than ``x`` × ``y`` by as much on all sides."""

    def ring(size: float) -> FloatArray:
        signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
        return signs * np.array([0.5 * x + size, 0.5 * y + size])

    return ring


@dataclass(frozen=True)
class Shell:
    """An open vessel: its walls rise outward from a flat floor, inside and outside, to a flat rim.

    Attributes:
        outside: (size, z) from the edge of the underside up to the rim, both rising, m.
        inside: (size, z) from the edge of the inner floor up to the rim, both rising, m.
        ring: cross-section of a size.
    """

    outside: Sequence[tuple[float, float]]
    inside: Sequence[tuple[float, float]]
    ring: Ring = polygon

    @property
    def height(self) -> float:
        """Of the rim, m."""
        return self.outside[-1][1]

    @property
    def pitch(self) -> float:
        """How far above an equal one the next stands, both upright and aligned, m.

        The inner surface of the lower one must nowhere be above the outer surface of the upper one; of two lines in
        pieces, the largest difference is at an end of a piece.
        """
        outside, inside = np.array(self.outside), np.array(self.inside)
        sizes = np.concatenate([[inside[0, 0]], outside[:, 0], inside[:, 0]])
        sizes = sizes[sizes <= inside[-1, 0]]
        lower = np.interp(sizes, inside[:, 0], inside[:, 1])
        upper = np.interp(sizes, outside[:, 0], outside[:, 1])
        return float((lower - upper).max())

    def item(self, name: str) -> Item:
        """It as an item that stands on z = 0."""
        profile = [*self.outside, *reversed(self.inside)]
        rings = [self.ring(size) for size, _ in profile]
        n = len(rings[0])
        points = [np.column_stack([ring, np.full(n, z)]) for ring, (_, z) in zip(rings, profile, strict=True)]
        middles = np.array([[0.0, 0.0, profile[0][1]], [0.0, 0.0, profile[-1][1]]])
        this, next_ = np.arange(n), np.roll(np.arange(n), -1)
        faces = []
        for k in range(len(rings) - 1):
            a, b, c, d = k * n + this, k * n + next_, (k + 1) * n + next_, (k + 1) * n + this
            faces += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
        under, floor = len(rings) * n, len(rings) * n + 1
        faces.append(np.column_stack([next_, this, np.full(n, under)]))
        faces.append(np.column_stack([under - n + this, under - n + next_, np.full(n, floor)]))
        return as_item(np.vstack([*points, middles]), np.vstack(faces), name)


def cup(
    foot: float, height: float, half_angle: float, wall: float, floor: float, ring: Ring = polygon
) -> Shell:
    """A conical cup, or a tray with walls as steep on all sides: the pitch is wall / sin(half angle), or the floor.

    Args:
        foot: size of the underside, m.
        height: m.
        half_angle: of the walls from the vertical, rad.
        wall: thickness across the wall, m.
        floor: thickness, m; less than the height.
        ring: its cross-section.
    """
    slope, across = math.tan(half_angle), wall / math.cos(half_angle)
    outside = [(foot, 0.0), (foot + height * slope, height)]
    inside = [(foot + floor * slope - across, floor), (foot + height * slope - across, height)]
    return Shell(outside, inside, ring)


def bowl(radius: float, wall: float, opening: float, facets: int = 12) -> Shell:
    """A bowl between two concentric spheres, cut where they meet the rim, with a flat foot.

    Smooth ones nest at sqrt(c² + R² - r²) - c, with c the height of the centre above the rim; these are in
    facets, and :attr:`Shell.pitch` knows that.

    Args:
        radius: of the outer sphere, m.
        wall: thickness, m.
        opening: angle of the rim from straight down, seen from the centre, rad; below a right angle.
        facets: from foot to rim.
    """
    start = 0.25 * opening
    rim = -radius * math.cos(opening)
    low = -radius * math.cos(start)

    def arc(r: float) -> list[tuple[float, float]]:
        end = math.acos(-rim / r)
        angles = np.linspace(math.acos(-(low + radius - r) / r), end, facets + 1)
        return [(r * math.sin(a), -r * math.cos(a) - low) for a in angles]

    outside, inside = arc(radius), arc(radius - wall)
    # both end in the plane of the rim to the last bit
    height = outside[-1][1]
    return Shell(outside, [*inside[:-1], (inside[-1][0], height)])


def plate(foot: float, rim: float, height: float, wall: float) -> Shell:
    """A plate with a flat middle and a border that rises to the rim, as thick everywhere straight up.

    So it nests at just that thickness, or at that of the floor, which is the same.
    """
    slope = (rim - foot) / (height - wall)
    outside = [(foot, 0.0), (rim, height - wall), (rim + wall * slope, height)]
    inside = [(foot, wall), (rim, height)]
    return Shell(outside, inside)


def sleeve(size: float, bore: float, height: float, name: str, *, round_bore: bool = False) -> Item:
    """A square block with a bore from top to bottom, square or round; about the z axis, on z = 0."""
    hole = polygon(0.5 * bore) if round_bore else rectangle(bore, bore)(0.0)
    n = SIDES if round_bore else 4
    directions = np.arctan2(hole[:, 1], hole[:, 0])
    reach = np.maximum(np.abs(np.cos(directions)), np.abs(np.sin(directions)))
    outer = 0.5 * size * np.column_stack([np.cos(directions), np.sin(directions)]) / reach[:, None]
    layers = [(outer, 0.0), (outer, height), (hole, height), (hole, 0.0)]
    points = np.vstack([np.column_stack([ring, np.full(n, z)]) for ring, z in layers])
    this, next_ = np.arange(n), np.roll(np.arange(n), -1)
    faces = []
    for k in range(4):
        a, b = k * n + this, k * n + next_
        d, c = (k + 1) % 4 * n + this, (k + 1) % 4 * n + next_
        faces += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    return as_item(points, np.vstack(faces), name)


def prism(ring: FloatArray, height: float, name: str) -> Item:
    """A column of this cross-section (n, 2) on z = 0."""
    n = len(ring)
    points = np.vstack([np.column_stack([ring, np.full(n, z)]) for z in (0.0, height)])
    middles = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, height]])
    a, b = np.arange(n), np.roll(np.arange(n), -1)
    faces = [
        np.column_stack([a, b, n + b]),
        np.column_stack([a, n + b, n + a]),
        np.column_stack([b, a, np.full(n, 2 * n)]),
        np.column_stack([n + a, n + b, np.full(n, 2 * n + 1)]),
    ]
    return as_item(np.vstack([points, middles]), np.vstack(faces), name)


def block(x: float, y: float, z: float, name: str) -> Item:
    """A box with its smallest corner at the origin, no number of it rounded."""
    mesh = trimesh.creation.box(extents=(1.0, 1.0, 1.0))
    return as_item((mesh.vertices + 0.5) * np.array([x, y, z]), mesh.faces, name)


def as_item(points: FloatArray, faces: FloatArray, name: str) -> Item:
    """A mesh in metres as an item."""
    return Item.from_trimesh(trimesh.Trimesh(points, faces, process=False), name)
