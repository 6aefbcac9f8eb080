"""When two resting orientations of one item count as the same pose, and grouping by that.

A polygonal cylinder rests on every one of its side facets, a scanned box on a dozen slightly different
triangles of each side. A planner that keeps "the best four" poses wants neither: it wants four shapes
that differ. Two resting orientations are near-equal where

* their support directions are within :data:`ANGLE_TOLERANCE` of one another in the mesh frame, or
* one is the other turned about the vertical, as shapes: :data:`NEAR_SHARE` of the surface of either
  lies within :data:`SHAPE_TOLERANCE` of the other, and all of it within :data:`OUTLIER_TOLERANCE`.

The second test compares the item's surface, not its hull, so that a cup upside-down is not the cup
upright; and it turns but never mirrors, so that a wrench is not its own flip side.

Why these values: 10° is less than the tilt between neighbouring faces of anything box-like, and more than
the spread of directions that scanning noise puts on a flat side. The shape tolerance is a tenth of the
item's thickness, so that a fork is not its own flip side, and at most 5 mm, half of the default step
between tried positions: what differs by less matters where items lie side by side in exact rows, and there only
to things with a few flat sides, whose heights have to be the same (:data:`SAME_HEIGHT`). A fixed 2 mm (one heightmap
cell) was tried first. It split scanned cans and balls, which are some mm off round, into as many as 54
poses, so that the most probable four were all one lying can. 5 % is what scanned rims and
seams need; the outlier bound keeps a handle or a spout, which may be less than 5 % of the surface, from
being ignored.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import KDTree

from packenv.types import FloatArray, IntArray

ANGLE_TOLERANCE = np.deg2rad(10.0)
"""Support directions closer than this are one pose, rad."""

SHAPE_TOLERANCE = 0.2
"""Surfaces are the same when closer than this times the lowest height that the centre of mass rests at."""

SHAPE_TOLERANCE_MAX = 0.005
"""Upper bound of the shape tolerance, m."""

OUTLIER_TOLERANCE = 3.0
"""No part of the surface may be off by more than this many times the shape tolerance."""

FEW_SIDES = 12
"""An item that rests on so few sides is no scan and not round: what differs in height is another pose."""

SAME_HEIGHT = 1e-5
"""Largest difference in height of poses of such an item that count as one, m."""

NEAR_SHARE = 0.95
"""Share of the surface that has to be within the shape tolerance."""

NEGLIGIBLE = 1e-4
"""Angular clusters less probable than this are not compared by shape; their mass goes to the nearest."""

COMPARISONS = 400
"""Bound on one item's shape comparisons, some milliseconds each; what is left then joins the nearest."""

_DENSE_SAMPLES = (5_000, 80_000)
_DENSE_SPACING = 0.4  # of the tolerance: blurs distances of that size by 2 %
_SPARSE_SAMPLES = 8_000
_PROBES = 1024
_COARSE_PROBES = 64
_FINE_PROBES = 128
_COARSE_YAWS = 60
_FINE_STEPS = 3
_REFINED_YAWS = 2


def sample_surface(vertices: FloatArray, faces: IntArray, count: int) -> FloatArray:
    """Spread points evenly over a surface, without random numbers.

    The faces are laid end to end by area and cut at equal intervals; the place inside the face follows
    the R2 low-discrepancy sequence (Roberts 2018).

    Args:
        vertices: (n, 3) m.
        faces: (m, 3) indices.
        count: number of points.

    Returns:
        (count, 3) points on the surface, m.
    """
    corners = vertices[faces]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    cumulated = np.cumsum(areas)
    steps = np.arange(count)
    face = np.searchsorted(cumulated, (steps + 0.5) / count * cumulated[-1])
    face = np.minimum(face, len(faces) - 1)
    plastic = 1.32471795724474602596
    u = (0.5 + steps / plastic) % 1.0
    v = (0.5 + steps / plastic**2) % 1.0
    folded = u + v > 1.0
    u = np.where(folded, 1.0 - u, u)[:, None]
    v = np.where(folded, 1.0 - v, v)[:, None]
    chosen = corners[face]
    points: FloatArray = chosen[:, 0] + u * (chosen[:, 1] - chosen[:, 0]) + v * (chosen[:, 2] - chosen[:, 0])
    return points


def upright_frame(direction: FloatArray) -> FloatArray:
    """A rotation that brings a support direction to -z, with no particular yaw.

    Args:
        direction: (3,) unit vector, mesh frame, that is to point down.

    Returns:
        (3, 3) rotation, mesh frame to resting frame.
    """
    up = -direction
    helper = np.zeros(3)
    helper[np.argmin(np.abs(up))] = 1.0
    x = np.cross(helper, up)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(up, x), up])


class _Shape:
    """The item at rest on one support direction: the frame, the probes in it, its yaw-free outline."""

    def __init__(self, direction: FloatArray, probes: FloatArray, support_points: FloatArray) -> None:
        self.frame = upright_frame(direction)
        self.height = float((support_points @ direction).max())
        self.top = float((support_points @ -direction).max()) + self.height
        self.probes = probes @ self.frame.T + [0.0, 0.0, self.height]
        levels = np.linspace(0.1, 0.9, 9)
        radius = np.hypot(self.probes[:, 0], self.probes[:, 1])
        self.radius = radius
        self.outline = np.concatenate(
            [np.quantile(self.probes[:, 2], levels), np.quantile(radius, levels)],
        )


class PoseComparer:
    """Tells whether two resting orientations of one item are the same pose up to a yaw.

    All work that depends on the item alone is done once, here.
    """

    def __init__(
        self,
        vertices: FloatArray,
        faces: IntArray,
        com: FloatArray,
        *,
        hull_points: FloatArray,
        lowest: float,
        sides: int,
    ) -> None:
        """Sample the surface and index the samples.

        Args:
            vertices: (n, 3) mesh frame, m.
            faces: (m, 3) indices.
            com: (3,) centre of mass, mesh frame, m.
            hull_points: (h, 3) vertices of the convex hull, mesh frame, m; they carry the item.
            lowest: the lowest height of the centre of mass over the plane at any orientation, m; about half
                the item's thickness, and the scale of the shape tolerance.
            sides: how many it can rest on.
        """
        centred = vertices - com
        corners = centred[faces]
        area = 0.5 * float(
            np.linalg.norm(
                np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
            ).sum()
        )
        self.tolerance = min(SHAPE_TOLERANCE * lowest, SHAPE_TOLERANCE_MAX)
        self._in_height = min(self.tolerance, SAME_HEIGHT) if sides <= FEW_SIDES else self.tolerance
        count = int(np.clip(area / (_DENSE_SPACING * self.tolerance) ** 2, *_DENSE_SAMPLES))
        self._tree = KDTree(sample_surface(centred, faces, count))
        self._sparse_tree = KDTree(sample_surface(centred, faces, _SPARSE_SAMPLES))
        self._sparse_spacing = float(np.sqrt(area / _SPARSE_SAMPLES))
        self._probes = sample_surface(centred, faces, _PROBES)
        self._support = hull_points - com
        self._shapes: dict[bytes, _Shape] = {}

    def same_shape(self, direction_a: FloatArray, direction_b: FloatArray) -> bool:
        """Whether a yaw exists that lays one resting shape onto the other.

        The shapes are compared with the centre of mass on the same vertical and on the same floor.

        Args:
            direction_a: (3,) unit vector in the mesh frame that points down in the first pose.
            direction_b: the same of the second pose.
        """
        a, b = self._shape(direction_a), self._shape(direction_b)
        limit = OUTLIER_TOLERANCE * self.tolerance
        if abs(a.height - b.height) > self._in_height or abs(a.top - b.top) > limit:
            return False
        # The radii and heights of the surface do not depend on the yaw: cheap, and it settles most pairs.
        if np.abs(a.outline - b.outline).max() > 2.0 * self.tolerance:
            return False
        return any(self._laid_over(a, b, yaw) for yaw in self._likely_yaws(a, b))

    def _shape(self, direction: FloatArray) -> _Shape:
        key = direction.tobytes()
        if key not in self._shapes:
            self._shapes[key] = _Shape(direction, self._probes, self._support)
        return self._shapes[key]

    def _distances(
        self, a: _Shape, b: _Shape, yaws: FloatArray, tree: KDTree, probes: slice, bound: float
    ) -> FloatArray:
        """(yaws, probes) distance of the turned surface of a to the surface of b; inf past the bound."""
        points = a.probes[probes]
        cos, sin = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
        turned = np.empty((len(yaws), len(points), 3))
        turned[..., 0] = cos * points[:, 0] - sin * points[:, 1]
        turned[..., 1] = sin * points[:, 0] + cos * points[:, 1]
        turned[..., 2] = points[:, 2] - b.height
        distances: FloatArray = tree.query(turned @ b.frame, distance_upper_bound=bound)[0]
        return distances

    def _likely_yaws(self, a: _Shape, b: _Shape) -> Iterator[float]:
        """The yaws that are worth an exact look, best first.

        A yaw between two steps of the coarse grid moves a point by at most its radius times half a step,
        so a grid yaw next to a match keeps the near share of its points within that bound.
        """
        step = 2.0 * np.pi / _COARSE_YAWS
        yaws: FloatArray = np.arange(_COARSE_YAWS, dtype=np.float64) * step
        every = slice(None, None, _PROBES // _COARSE_PROBES)
        slack = self.tolerance + self._sparse_spacing + 0.5 * step * a.radius[every]
        distances = self._distances(a, b, yaws, self._sparse_tree, every, float(slack.max()))
        near = (distances <= slack).mean(axis=1)
        badness = np.minimum(distances, slack).mean(axis=1)
        # So few probes scatter by some 3 % around the share that the whole surface has.
        promising = np.flatnonzero(near >= NEAR_SHARE - 0.08)
        promising = promising[np.argsort(badness[promising], kind="stable")][:_REFINED_YAWS]
        fine = np.linspace(-0.5 * step, 0.5 * step, 2 * _FINE_STEPS + 1)
        every = slice(None, None, _PROBES // _FINE_PROBES)
        bound = 2.0 * self.tolerance
        for start in yaws[promising]:
            around = start + fine
            cost = np.minimum(self._distances(a, b, around, self._sparse_tree, every, bound), bound).mean(
                axis=1
            )
            yield float(around[np.argmin(cost)])

    def _laid_over(self, a: _Shape, b: _Shape, yaw: float) -> bool:
        """Whether a turned by the yaw lies on b within the tolerances, and b on a."""
        limit = OUTLIER_TOLERANCE * self.tolerance
        far_allowed = int((1.0 - NEAR_SHARE) * _PROBES)
        # Every eighth probe first: most of what fails, fails there, and what fails there fails on all.
        for every in (slice(None, None, 8), slice(None)):
            for first, second, angle in ((a, b, yaw), (b, a, -yaw)):
                distances = self._distances(first, second, np.array([angle]), self._tree, every, limit)
                far = np.count_nonzero(distances > self.tolerance)
                if far > far_allowed or not np.isfinite(distances).all():
                    return False
        return True


def group_poses(directions: FloatArray, probabilities: FloatArray, comparer: PoseComparer) -> IntArray:
    """Group near-equal resting orientations, greedily from the most probable on.

    First by angle alone, into clusters around their most probable member: that is cheap, and bounds the
    number of shapes by the number of 10° caps that fit on a sphere. Then a cluster joins the first group
    whose representative has the same shape, or founds a group. Clusters of negligible probability, and
    the least probable ones of an item that is nearly round but not quite, join the group of the nearest
    cluster instead.

    Args:
        directions: (k, 3) unit support directions, mesh frame, by falling probability.
        probabilities: (k,) of each, not increasing.
        comparer: built from the same item.

    Returns:
        (k,) for each direction the index of its group's representative, which is the group's most
        probable member.
    """
    cluster = np.full(len(directions), -1, dtype=np.int64)
    founders: list[int] = []
    while (free := np.flatnonzero(cluster < 0)).size:
        founder = int(free[0])
        near = free[directions[free] @ directions[founder] >= np.cos(ANGLE_TOLERANCE)]
        cluster[near] = founder
        cluster[founder] = founder
        founders.append(founder)

    mass = np.bincount(cluster, weights=probabilities, minlength=len(directions))
    representative: dict[int, int] = {}
    groups: list[int] = []
    left: list[int] = []
    budget = COMPARISONS
    for founder in founders:
        if groups and (mass[founder] < NEGLIGIBLE or budget <= 0):
            left.append(founder)
            continue
        home = founder
        for group in groups:
            budget -= 1
            if comparer.same_shape(directions[founder], directions[group]):
                home = group
                break
        else:
            groups.append(founder)
        representative[founder] = home
    kept = np.array(list(representative), dtype=np.int64)
    for founder in left:
        nearest = int(kept[np.argmax(directions[kept] @ directions[founder])])
        representative[founder] = representative[nearest]
    return np.array([representative[int(c)] for c in cluster], dtype=np.int64)
