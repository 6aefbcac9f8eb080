"""Planar-stable poses of an item, with quasi-static probabilities.

Source: Goldberg, Mirtich, Zhuang, Craig, Carlisle, Canny, "Part pose statistics: estimators and
experiments", IEEE Transactions on Robotics and Automation 15(5), 1999. An item that is dropped at a
uniformly random orientation on a plane touches down on the hull facet that the vertical through its
centre of mass hits, so a facet's chance is its solid angle seen from the centre of mass over 4π. From a
facet that does not hold the centre of mass above itself the item topples over an edge onto the next
facet, until one holds it. Dynamics (bouncing, rolling on) is left out, on purpose, as in the paper.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from packenv.errors import MeshError
from packenv.geometry.pose_groups import PoseComparer, group_poses, upright_frame
from packenv.types import FloatArray, IntArray, Item, StablePose

COPLANAR_TOLERANCE = 1e-5
"""Hull triangles that meet at a smaller angle are one facet, rad. Single precision leaves about 1e-6."""

MARGIN = 1e-6
"""A facet holds the centre of mass when it is inside by this share of the item's size."""

_TIE = 6
"""Decimals to which quantities are compared where symmetry makes them equal but for rounding."""


@dataclass(frozen=True, eq=False)
class StableFacets:
    """The hull facets that an item can rest on, by falling probability.

    Attributes:
        normals: (k, 3) unit outward normals, mesh frame; each points down when the item rests on it.
        heights: (k,) height of the centre of mass over each, m.
        probabilities: (k,) quasi-static, sum 1, toppling included.
        hull_points: (h, 3) vertices of the convex hull, mesh frame, m.
        landing: (k,) share of the probability that lands on the facet itself, without toppling.
    """

    normals: FloatArray
    heights: FloatArray
    probabilities: FloatArray
    hull_points: FloatArray
    landing: FloatArray


def stable_poses(item: Item, *, limit: int | None = None) -> tuple[StablePose, ...]:
    """Find the planar-stable poses of an item, near-equal ones grouped, most probable first.

    A pose's rotation puts its support facet down and fixes the yaw so that the smallest rectangle around
    the item's outline, seen from above, lies along the axes, the longer side along x. (The paper leaves
    the yaw at whatever the mesh frame happens to be. The planner tries multiples of π/4 from here, and
    for anything box-like only a grid that starts aligned with the container's walls packs tight.)

    Of an item with a side that must be up, those poses are found at which it is; all, where it is up at none.

    Args:
        item: the item, with its ``com`` and its limits.
        limit: how many poses to return; None for all.

    Returns:
        Poses by falling probability. Those of all poses sum to 1; limits cut the list and leave the
        probabilities as they are. The same mesh gives the same poses on every run.

    Raises:
        MeshError: the mesh is flat, or its centre of mass is not inside its hull.
        ValueError: ``limit`` is less than 1.
    """
    if limit is not None and limit < 1:
        raise ValueError(f"limit is {limit}, give at least 1, or None for all poses")
    facets = stable_facets(item.vertices, item.com, name=item.name)
    comparer = pose_comparer(item, facets)
    # Before they are grouped: a can's head and foot are one pose, and only one of them may be up.
    upright = np.array([item.limits.allows(-normal) for normal in facets.normals])
    which = upright if upright.any() else ~upright
    normals, probabilities = facets.normals[which], facets.probabilities[which]
    home = group_poses(normals, probabilities, comparer)
    mass = np.bincount(home, weights=probabilities, minlength=len(home))
    members = np.bincount(home, minlength=len(home))
    founders = np.unique(home)
    # Equal masses stay in the facets' own order, which is by geometry.
    founders = founders[np.lexsort((founders, -np.round(mass[founders], 9)))][:limit]
    centred = facets.hull_points - item.com
    return tuple(
        StablePose(
            rotation=aligned_rotation(centred, normals[f]),
            probability=float(mass[f]),
            com_height=float((centred @ normals[f]).max()),
            members=int(members[f]),
        )
        for f in founders
    )


def pose_comparer(item: Item, facets: StableFacets) -> PoseComparer:
    """The comparer of resting orientations that :func:`stable_poses` groups this item's poses by.

    Args:
        item: the item.
        facets: its stable facets.
    """
    return PoseComparer(
        item.vertices,
        item.faces,
        item.com,
        hull_points=facets.hull_points,
        lowest=float(facets.heights.min()),
        sides=len(facets.normals),
    )


def stable_facets(vertices: FloatArray, com: FloatArray, *, name: str = "item") -> StableFacets:
    """Find the hull facets that hold the centre of mass, and their quasi-static probabilities.

    Args:
        vertices: (n, 3) mesh frame, m.
        com: (3,) centre of mass, mesh frame, m.
        name: the item's name, for error messages.

    Returns:
        The stable facets by falling probability, not grouped.

    Raises:
        MeshError: the vertices lie in a plane, or the centre of mass is not inside their hull.
    """
    points = np.asarray(vertices, dtype=np.float64) - com
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise MeshError(
            f"item {name}: its vertices have no convex hull of positive volume, give a closed solid mesh"
        ) from error
    size = float(np.linalg.norm(np.ptp(points[hull.vertices], axis=0)))
    if -float(hull.equations[:, 3].max()) < MARGIN * 1e-3 * size:
        raise MeshError(
            f"item {name}: its centre of mass {np.array2string(np.asarray(com), precision=4)} is not inside "
            "its convex hull, give a closed mesh whose faces are wound outwards"
        )
    facets = _merge_coplanar(points, hull)
    nxt = _topple_targets(facets, size)
    rest = _follow(nxt)
    landing = facets.solid_angles / facets.solid_angles.sum()
    probability: FloatArray = np.bincount(rest, weights=landing, minlength=len(rest)).astype(np.float64)
    stable = np.flatnonzero(rest == np.arange(len(rest)))
    order = np.lexsort(
        (
            *np.round(facets.normals[stable], _TIE).T,
            np.round(facets.heights[stable] / size, _TIE),
            -np.round(probability[stable], 9),
        )
    )
    stable = stable[order]
    return StableFacets(
        normals=facets.normals[stable],
        heights=facets.heights[stable],
        probabilities=probability[stable],
        hull_points=np.asarray(vertices, dtype=np.float64)[np.sort(hull.vertices)],
        landing=landing[stable],
    )


def aligned_rotation(hull_points: FloatArray, direction: FloatArray) -> FloatArray:
    """The rotation that puts a support direction down and the outline along the axes.

    Of the smallest-area rectangle's four yaws those with the longer side along x are left; of these the
    one with the centre of mass towards small x, then small y; for a symmetric outline the one nearest to
    the mesh frame. So the outcome hangs on the geometry and not on the order of vertices.

    Args:
        hull_points: (h, 3) hull vertices with the centre of mass at the origin, mesh axes, m.
        direction: (3,) unit vector, mesh axes, that is to point down.

    Returns:
        (3, 3) rotation, mesh frame to resting frame.
    """
    frame = upright_frame(direction)
    outline = (hull_points @ frame.T)[:, :2]
    outline = outline[ConvexHull(outline).vertices]
    edges = np.roll(outline, -1, axis=0) - outline
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    x = outline @ np.array([np.cos(angles), np.sin(angles)])
    y = outline @ np.array([-np.sin(angles), np.cos(angles)])
    areas = np.ptp(x, axis=0) * np.ptp(y, axis=0)
    smallest = angles[areas <= areas.min() * (1.0 + 10.0**-_TIE)]

    def preference(rotation: FloatArray) -> tuple[float, ...]:
        laid = hull_points @ rotation.T
        low, high = laid.min(axis=0), laid.max(axis=0)
        length, width = (high - low)[:2]
        centre = 0.5 * (low + high)[:2] / max(length, width)
        key = (length < width * (1.0 - 10.0**-_TIE), *-centre, -np.trace(rotation), *-rotation.ravel())
        # Adding 0.0 makes -0.0 and 0.0 one value.
        return tuple(round(float(k), _TIE) + 0.0 for k in key)

    candidates = [
        _turn_about_z(quarter * np.pi / 2 - angle) @ frame for angle in smallest for quarter in range(4)
    ]
    return min(candidates, key=preference)


def _turn_about_z(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class _Facets:
    """Facets of a hull whose centre of mass is the origin.

    ``owner``, ``neighbour`` and ``outside`` describe the boundary edges, each once from either side:
    the facet, the one beyond the edge, and how far the foot of the centre of mass lies beyond the edge
    in the owner's plane (negative: on the facet's side), m.
    """

    normals: FloatArray
    heights: FloatArray
    solid_angles: FloatArray
    owner: IntArray
    neighbour: IntArray
    outside: FloatArray


def _merge_coplanar(points: FloatArray, hull: ConvexHull) -> _Facets:
    """Join the hull's coplanar triangles and gather what toppling needs to know of each facet."""
    triangles = np.asarray(hull.simplices)
    corners = points[triangles]
    triangle_normals = hull.equations[:, :3]
    count = len(triangles)

    source = np.repeat(np.arange(count), 3)
    target = np.asarray(hull.neighbors).ravel()
    bend = np.linalg.norm(triangle_normals[source] - triangle_normals[target], axis=1)
    flat = bend < COPLANAR_TOLERANCE
    joins = coo_matrix((np.ones(flat.sum()), (source[flat], target[flat])), shape=(count, count))
    facet_count, facet = connected_components(joins, directed=False)

    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    # Triangles that Qhull made without any area still have their facet's normal; they may not weigh nil.
    weights = areas + 1e-12 * areas.sum()
    total = np.bincount(facet, weights=weights)

    def facet_mean(values: FloatArray) -> FloatArray:
        columns = [np.bincount(facet, weights=weights * column) / total for column in values.T]
        return np.stack(columns, axis=1)

    normals = facet_mean(triangle_normals)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    centres = facet_mean(corners.mean(axis=1))
    heights = np.full(facet_count, -np.inf)
    np.maximum.at(heights, facet, np.einsum("tcx,tx->tc", corners, normals[facet]).max(axis=1))

    edge = np.flatnonzero(facet[source] != facet[target])
    owner = facet[source[edge]]
    start = corners[source[edge], (edge % 3 + 1) % 3]
    end = corners[source[edge], (edge % 3 + 2) % 3]
    outward = np.cross(end - start, normals[owner])
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
    outward *= np.where(np.einsum("ex,ex->e", centres[owner] - start, outward) > 0.0, -1.0, 1.0)[:, None]
    return _Facets(
        normals=normals,
        heights=heights,
        solid_angles=np.bincount(facet, weights=solid_angles(corners)).astype(np.float64),
        owner=owner,
        neighbour=facet[target[edge]],
        outside=-np.einsum("ex,ex->e", start, outward),
    )


def solid_angles(corners: FloatArray) -> FloatArray:
    """Solid angles of triangles seen from the origin (Van Oosterom and Strackee 1983, eq. 8).

    Args:
        corners: (t, 3, 3) the three corners of each triangle, relative to the eye.

    Returns:
        (t,) solid angles without sign, sr.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    triple = np.einsum("tx,tx->t", a, np.cross(b, c))
    ab, ac, bc = (np.einsum("tx,tx->t", p, q) for p, q in ((a, b), (a, c), (b, c)))
    result: FloatArray = 2.0 * np.arctan2(np.abs(triple), la * lb * lc + ab * lc + ac * lb + bc * la)
    return result


def _topple_targets(facets: _Facets, size: float) -> IntArray:
    """For each facet the one that it topples onto, or itself where it is stable.

    The item turns about the edge that the foot of the centre of mass lies farthest beyond. Where the
    nearest point of the facet is on an edge this is that edge; beyond a corner it is, of the edges, the
    one about which the centre of mass falls fastest.
    """
    targets = np.arange(len(facets.heights))
    worst_first = np.lexsort((facets.neighbour, -facets.outside, facets.owner))
    owners, first = np.unique(facets.owner[worst_first], return_index=True)
    worst = worst_first[first]
    # Toppling lowers the centre of mass. Asking for it here, exactly, also rules out circles that
    # rounding could make.
    falls = (facets.outside[worst] > -MARGIN * size) & (
        facets.heights[facets.neighbour[worst]] < facets.heights[owners]
    )
    targets[owners[falls]] = facets.neighbour[worst[falls]]
    return targets


def _follow(targets: IntArray) -> IntArray:
    """Where each facet's toppling ends. Doubles the stride, so it takes log2 of the longest chain."""
    while True:
        further = targets[targets]
        if np.array_equal(further, targets):
            return targets
        targets = further
