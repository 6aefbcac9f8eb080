"""Convex solids as point clouds: a part is the convex hull of its points.

Every function works in millimetres and returns either one part, an (n, 3) array of points, or a list of
parts. Curves are sampled; a shape whose surface must be concave (the inside of a cup) is split into parts
whose inner faces are planar, so that the union of the hulls is the item itself and not a fattened copy.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Points: TypeAlias = NDArray[np.float64]
Parts: TypeAlias = list[Points]
Profile: TypeAlias = Sequence[tuple[float, float]]
Band: TypeAlias = tuple[Profile, tuple[tuple[float, float], tuple[float, float]]]


def angles(n: int) -> Points:
    """(n,) angles of a regular n-gon that starts on the x axis, rad."""
    return 2.0 * np.pi * np.arange(n) / n


def turned(radius: float, z: float, theta: ArrayLike) -> Points:
    """Points at one radius and height at the angles ``theta``; the axis point alone where the radius is 0."""
    if radius <= 0.0:
        return np.array([[0.0, 0.0, z]])
    t = np.asarray(theta, dtype=np.float64)
    return np.column_stack((radius * np.cos(t), radius * np.sin(t), np.full(t.shape, z)))


def ring(radius: float, z: float, n: int = 96) -> Points:
    """(n, 3) points of a circle about the z axis."""
    return turned(radius, z, angles(n))


def oval(a: float, b: float, z: float, n: int = 96, power: float = 2.0) -> Points:
    """(n, 3) points of the superellipse |x/a|^power + |y/b|^power = 1 at height z (half-axes a and b)."""
    t = angles(n)
    c, s = np.cos(t), np.sin(t)
    x = a * np.sign(c) * np.abs(c) ** (2.0 / power)
    y = b * np.sign(s) * np.abs(s) ** (2.0 / power)
    return np.column_stack((x, y, np.full(n, z)))


def rounded_rectangle(width: float, depth: float, radius: float, z: float, steps: int = 8) -> Points:
    """Points of a rectangle with rounded corners, centred on the z axis."""
    quarter = np.linspace(0.0, np.pi / 2.0, steps + 1)
    corners = []
    for k, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        t = quarter + k * np.pi / 2.0
        x = sx * (width / 2.0 - radius) + radius * np.cos(t)
        y = sy * (depth / 2.0 - radius) + radius * np.sin(t)
        corners.append(np.column_stack((x, y, np.full(t.shape, z))))
    return np.concatenate(corners)


def joined(*clouds: Points) -> Points:
    """One part from several point clouds."""
    return np.concatenate(clouds)


def lathe(profile: Profile, n: int = 96) -> Points:
    """One convex body of revolution about z from (radius, z) pairs."""
    return joined(*(ring(r, z, n) if r > 0 else turned(0.0, z, 0.0) for r, z in profile))


def box(size: ArrayLike, chamfer: float = 0.8, center: ArrayLike = (0.0, 0.0, 0.0)) -> Points:
    """(24, 3) corners of a box with chamfered edges."""
    half = np.asarray(size, dtype=np.float64) / 2.0
    points = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            for sz in (-1, 1):
                corner = np.array((sx, sy, sz)) * half
                for axis in range(3):
                    inset = np.full(3, chamfer)
                    inset[axis] = 0.0
                    points.append(corner - np.sign(corner) * inset)
    return np.array(points) + np.asarray(center, dtype=np.float64)


def rounded_box(
    size: ArrayLike, radius: float, center: ArrayLike = (0.0, 0.0, 0.0), steps: int = 4
) -> Points:
    """Points of a box whose edges and corners are rounded by one radius."""
    half = np.asarray(size, dtype=np.float64) / 2.0 - radius
    octant = []
    for i in range(steps + 1):
        polar = np.pi / 2.0 * i / steps
        for j in range(steps + 1) if i else range(1):
            turn = np.pi / 2.0 * j / steps
            octant.append((np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)))
    cap = np.array(octant) * radius
    signs = [(sx, sy, sz) for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]
    return joined(*((cap + half) * sign for sign in signs)) + np.asarray(center, dtype=np.float64)


def geodesic(radius: float, frequency: int = 10) -> Points:
    """10 f^2 + 2 points of a sphere, spread evenly; exactly ±radius on all three axes for even f."""
    phi = (1.0 + 5.0**0.5) / 2.0
    corners = np.array(
        [p for a in (-1, 1) for b in (-phi, phi) for p in ((0, a, b), (a, b, 0), (b, 0, a))], dtype=np.float64
    )
    gaps = np.linalg.norm(corners[:, None] - corners[None], axis=2)
    near = np.abs(gaps - 2.0) < 1e-6
    points = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(j + 1, 12):
                if near[i, j] and near[j, k] and near[i, k]:
                    for u in range(frequency + 1):
                        for v in range(frequency + 1 - u):
                            w = frequency - u - v
                            points.append((u * corners[i] + v * corners[j] + w * corners[k]) / frequency)
    sphere = np.array(points)
    sphere *= radius / np.linalg.norm(sphere, axis=1, keepdims=True)
    return np.unique(np.round(sphere, 6), axis=0)


def puck(x: float, y: float, radius: float, z0: float, z1: float, bevel: float = 0.8, n: int = 32) -> Points:
    """A disc from z0 to z1 with bevelled edges, centred at (x, y)."""
    profile = ((radius - bevel, z0), (radius, z0 + bevel), (radius, z1 - bevel), (radius - bevel, z1))
    return lathe(profile, n) + np.array((x, y, 0.0))


def stroke(
    path: Iterable[tuple[float, float, float]], z0: float, z1: float, bevel: float = 0.8, n: int = 32
) -> Parts:
    """Parts of a flat bar drawn along (x, y, radius) points: the hull of each two neighbouring pucks."""
    pucks = [puck(x, y, r, z0, z1, bevel, n) for x, y, r in path]
    return [joined(a, b) for a, b in pairwise(pucks)]


def slab(outline: Sequence[tuple[float, float]], z0: float, z1: float, bevel: float = 0.8) -> Points:
    """A convex outline in the xy plane made solid from z0 to z1, its edges bevelled towards the centroid."""
    flat = np.asarray(outline, dtype=np.float64)
    middle = flat.mean(axis=0)
    reach = np.linalg.norm(flat - middle, axis=1, keepdims=True)
    inner = flat + (middle - flat) * np.minimum(bevel / reach, 0.9)
    layers = ((inner, z0), (flat, z0 + bevel), (flat, z1 - bevel), (inner, z1))
    return joined(*(np.column_stack((xy, np.full(len(xy), z))) for xy, z in layers))


def sweep(
    path: ArrayLike,
    radii: ArrayLike,
    *,
    up: ArrayLike = (0.0, 0.0, 1.0),
    n: int = 24,
    power: float = 2.0,
    caps: tuple[bool, bool] = (True, True),
) -> Parts:
    """Parts of a bar with superelliptic section along a polyline.

    Args:
        path: (k, 3) centre line, mm.
        radii: (k, 2) half-axes of the section, the first across ``up`` and the path, the second along ``up``;
            a number or a pair for all.
        up: direction that the section's second axis keeps to.
        n: points of a section.
        power: exponent of the superellipse, 2 for an ellipse.
        caps: whether the first and the last end are rounded off (by half of the smaller half-axis).

    Returns:
        k - 1 parts; neighbours share a section.
    """
    line = np.asarray(path, dtype=np.float64)
    half = np.broadcast_to(np.asarray(radii, dtype=np.float64), (len(line), 2))
    direction = np.gradient(line, axis=0)
    steps = np.diff(line, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    direction[0], direction[-1] = steps[0], steps[-1]
    direction[1:-1] = steps[:-1] + steps[1:]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    side = np.cross(np.asarray(up, dtype=np.float64), direction)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    lift = np.cross(direction, side)

    def section(i: int, scale: float = 1.0, shift: float = 0.0) -> Points:
        flat = oval(half[i, 0] * scale, half[i, 1] * scale, 0.0, n, power)
        return line[i] + shift * direction[i] + flat[:, :1] * side[i] + flat[:, 1:2] * lift[i]

    def cap(i: int, sign: float) -> Points:
        depth = sign * 0.5 * float(half[i].min())
        quarter = (np.pi / 6.0, np.pi / 3.0, np.pi / 2.0 - 0.15)
        return joined(*(section(i, 0.5 + 0.5 * np.cos(t), depth * np.sin(t)) for t in quarter))

    parts = [joined(section(i), section(i + 1)) for i in range(len(line) - 1)]
    if caps[0]:
        parts[0] = joined(parts[0], cap(0, -1.0))
    if caps[1]:
        parts[-1] = joined(parts[-1], cap(len(line) - 1, 1.0))
    return parts


def shell(bands: Iterable[Band], sectors: int = 24, per_sector: int = 6) -> Parts:
    """Wedges of a hollow body of revolution: finely curved outside, one plane a wedge inside.

    Args:
        bands: from the bottom up, (outer profile of (radius, z), ((radius, z), (radius, z)) of the lower and
            the upper inner edge). A band's outer profile must be convex. Neighbouring bands share their
            seam's two points.
        sectors: wedges around. The inner surface is a prism or pyramid of this many sides whose corners lie
            on the stated inner radius, so the wall is nowhere thinner than stated.
        per_sector: chords of the outer circle in a wedge.

    Returns:
        sectors parts a band. Each reaches a little into the next one around, well inside of the wall: two
        that only touched could leave a slit as wide as the rounding of their coordinates.
    """
    parts = []
    for outer, inner in bands:
        section = np.array([outer[0], outer[-1], *inner])
        core = section.mean(axis=0) + 0.5 * (section - section.mean(axis=0))
        for k in range(sectors):
            # Integer numerators make a seam's angle the same number on both of its sides.
            theta = 2.0 * np.pi * np.arange(k * per_sector, (k + 1) * per_sector + 1) / (sectors * per_sector)
            theta = np.mod(theta, 2.0 * np.pi)
            clouds = [turned(r, z, theta) for r, z in outer]
            clouds += [turned(r, z, theta[[0, -1]]) for r, z in inner]
            beyond = 2.0 * np.pi * ((k + 1) * per_sector + 0.5) / (sectors * per_sector)
            clouds += [turned(r, z, [beyond]) for r, z in core]
            parts.append(joined(*clouds))
    return parts


def orange_slices(profile: Profile, sectors: int = 16, per_sector: int = 4) -> Parts:
    """Sectors of a solid of revolution with dimples at the poles; the profile starts and ends on the axis."""
    parts = []
    for k in range(sectors):
        theta = 2.0 * np.pi * np.arange(k * per_sector, (k + 1) * per_sector + 1) / (sectors * per_sector)
        theta = np.mod(theta, 2.0 * np.pi)
        parts.append(joined(*(turned(r, z, theta) for r, z in profile)))
    return parts


def tube(
    inner: float,
    outer: float,
    z0: float,
    z1: float,
    bevel: float = 0.5,
    sectors: int = 24,
    per_sector: int = 4,
) -> Parts:
    """Wedges of a straight tube about the z axis, bevelled outside."""
    profile = ((outer - bevel, z0), (outer, z0 + bevel), (outer, z1 - bevel), (outer - bevel, z1))
    return shell([(profile, ((inner, z0), (inner, z1)))], sectors, per_sector)


def rotation(axis: str, degrees: float) -> Points:
    """(3, 3) rotation about x, y or z; exact for multiples of 90 degrees."""
    quarter = round(degrees / 90.0)
    if abs(degrees - 90.0 * quarter) < 1e-12:
        c, s = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarter % 4]
    else:
        c, s = float(np.cos(np.radians(degrees))), float(np.sin(np.radians(degrees)))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = c, -s, s, c
    return matrix


def placed(
    parts: Points | Iterable[Points],
    at: ArrayLike = (0.0, 0.0, 0.0),
    turn: Sequence[tuple[str, float]] = (),
    scale: ArrayLike = (1.0, 1.0, 1.0),
) -> Parts:
    """Parts scaled, turned by each (axis, degrees) in sequence, then moved."""
    matrix = np.diag(np.asarray(scale, dtype=np.float64))
    for axis, degrees in turn:
        matrix = rotation(axis, degrees) @ matrix
    group = [parts] if isinstance(parts, np.ndarray) else parts
    return [points @ matrix.T + np.asarray(at, dtype=np.float64) for points in group]


def mirrored(parts: Iterable[Points], axis: int) -> Parts:
    """Parts reflected in the plane through the origin across one axis."""
    sign = np.ones(3)
    sign[axis] = -1.0
    return [points * sign for points in parts]


def arc_path(
    center: tuple[float, float], radius: float | tuple[float, float], start: float, stop: float, count: int
) -> list[tuple[float, float]]:
    """``count`` points of a circular or elliptic arc, angles in degrees."""
    a, b = radius if isinstance(radius, tuple) else (radius, radius)
    t = np.radians(np.linspace(start, stop, count))
    return [(float(center[0] + a * np.cos(v)), float(center[1] + b * np.sin(v))) for v in t]
