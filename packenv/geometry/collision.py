"""Exact mesh-mesh overlap of two posed items, on python-fcl.

Nothing here knows of heightmaps: this is the geometry of the audit, which must not share a code path with
the planner's own legality test.

What counts as overlap
----------------------
FCL reports exact face contact as a collision, and two items that rest on each other do touch. So a
*clearance* c is stated (20 µm by default), and items *overlap* only where none of these separates them:

1. as they are: no triangles meet and no body of one lies inside the other;
2. both surfaces drawn inwards by c / 2: every vertex moves by c / 2 along its normal, so every surface
   point moves by at most c / 2, and items that are then apart are nowhere deeper in each other than c;
3. one item moved by c along one of the tried directions: then c bounds the translational depth.

Each of these is sound (what they call touching is at most c deep); none is needed to be complete, because
a deeper contact than c is what they must never excuse.

FCL pitfalls that are dealt with: a mesh wholly inside another gives no collision (winding numbers decide),
and contact depths between meshes are unreliable (depth is measured by moving one item away).
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import cached_property, partial
from typing import Any, Generic, TypeVar

import fcl
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from packenv.config import CLEARANCE
from packenv.types import FloatArray, IntArray, Item, Pose

DEFAULT_CLEARANCE = CLEARANCE
"""Depth up to which contact is touching, not overlap, m."""

_BEYOND = 1.0 + 1e-6  # a move by exactly the clearance would leave boxes of that depth in exact contact
_DEPTH_RESOLUTION = 0.005
_CONTACTS = 128
_DIRECTIONS_PER_KIND = 6

_T = TypeVar("_T")


def _hemisphere() -> FloatArray:
    """(n, 3) unit vectors with z >= 0: the axes, 16 level ones and an even spread over the rest."""
    level = np.arange(16) * (np.pi / 8.0)
    count = 112
    height = (np.arange(count) + 0.5) / count
    turn = np.arange(count) * (np.pi * (3.0 - np.sqrt(5.0)))
    ring = np.sqrt(1.0 - height**2)
    ring_xy = np.stack([np.cos(level), np.sin(level), np.zeros(16)], axis=1)
    # Exact zeros for the axes: a direction with z = -1e-17 would not be sound for the upward sweep.
    ring_xy[np.abs(ring_xy) < 1e-15] = 0.0
    spread = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
    directions: FloatArray = np.concatenate([ring_xy, [[0.0, 0.0, 1.0]], spread])
    return directions


UPWARD = _hemisphere()
"""(n, 3) directions along which separating planes are tried; none points down."""


class BoundedCache(Generic[_T]):
    """A least-recently-used store of at most ``size`` values."""

    def __init__(self, size: int) -> None:
        """Start empty."""
        self._size = size
        self._values: OrderedDict[Hashable, _T] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], _T], valid: Callable[[_T], bool]) -> _T:
        """The stored value where there is one and it is ``valid``, else what ``make`` returns."""
        value = self._values.get(key)
        if value is None or not valid(value):
            value = make()
        self._values[key] = value
        self._values.move_to_end(key)
        while len(self._values) > self._size:
            self._values.popitem(last=False)
        return value

    def clear(self) -> None:
        """Forget everything."""
        self._values.clear()


IDENTITY = Pose(np.eye(3), np.zeros(3))


class Surface:
    """Triangles prepared for FCL: the bounding-volume hierarchy is built once, in their own frame.

    Attributes:
        vertices: (n, 3) m.
        faces: (m, 3) vertex indices.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        """Build the hierarchy: about 6 µs and 600 bytes a triangle."""
        self.vertices = vertices
        self.faces = faces
        self._model = fcl.BVHModel()
        self._model.beginModel(len(faces), len(vertices))
        self._model.addSubModel(np.ascontiguousarray(vertices), np.ascontiguousarray(faces))
        self._model.endModel()

    @cached_property
    def normals(self) -> FloatArray:
        """(m, 3) unit normals; zero for a triangle without area."""
        return unit(_cross_products(self.vertices, self.faces))

    def posed(self, pose: Pose) -> Any:
        """The FCL object of this surface at ``pose``."""
        return fcl.CollisionObject(self._model, fcl.Transform(pose.rotation, pose.position))


def surfaces_meet(a: Surface, pose_a: Pose, b: Surface, pose_b: Pose) -> bool:
    """Whether a triangle of ``a`` meets a triangle of ``b``, exact contact included."""
    request = fcl.CollisionRequest(num_max_contacts=1, enable_contact=False)
    return bool(fcl.collide(a.posed(pose_a), b.posed(pose_b), request, fcl.CollisionResult()) > 0)


def contact_directions(a: Surface, pose_a: Pose, b: Surface, pose_b: Pose) -> FloatArray:
    """Unit directions, container frame, along which moving ``b`` may part two surfaces that meet.

    They are the face normals of the triangles that meet and FCL's own contact normals, both ways. The
    latter are edge-edge products: right where edges meet and wrong elsewhere, so they are only tried.

    Returns:
        (n, 3), n at most 36.
    """
    request = fcl.CollisionRequest(num_max_contacts=_CONTACTS, enable_contact=True)
    result = fcl.CollisionResult()
    fcl.collide(a.posed(pose_a), b.posed(pose_b), request, result)
    if not result.contacts:
        return np.zeros((0, 3))
    of_a = a.normals[[contact.b1 for contact in result.contacts]] @ pose_a.rotation.T
    of_b = b.normals[[contact.b2 for contact in result.contacts]] @ pose_b.rotation.T
    of_fcl = np.array([contact.normal for contact in result.contacts])
    chosen: list[FloatArray] = []
    for normals in (of_a, of_b, of_fcl):
        limit = len(chosen) + _DIRECTIONS_PER_KIND
        for normal in normals:
            if len(chosen) < limit and normal @ normal > 0.5 and all(abs(normal @ c) < 0.999 for c in chosen):
                chosen.append(normal)
    one_way = np.array(chosen).reshape(-1, 3)
    return np.concatenate([one_way, -one_way])


def winding_number(vertices: FloatArray, faces: IntArray, point: FloatArray) -> float:
    """Generalised winding number of a triangle surface about a point (van Oosterom and Strackee 1983).

    1 inside a body whose faces are counter-clockwise from outside, 0 outside it and inside its cavities.
    Unlike ray parity it has no bad directions, and it stays right where bodies overlap.

    Args:
        vertices: (n, 3) m.
        faces: (m, 3).
        point: (3,) m, not on the surface.
    """
    corners = (vertices - point)[faces]
    length = np.sqrt(np.einsum("ijk,ijk->ij", corners, corners))
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = length[:, 0], length[:, 1], length[:, 2]
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    dot_ab, dot_bc, dot_ca = (np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    solid_angle = 2.0 * np.arctan2(volume, la * lb * lc + dot_ab * lc + dot_bc * la + dot_ca * lb)
    return float(solid_angle.sum() / (4.0 * np.pi))


class Solid:
    """The exact surface of one item, with what the audit's tests need of it, in the mesh frame.

    Attributes:
        source: the item's own arrays, kept to recognise them again.
        clearance: m.
        vertices: (n, 3) m, no two equal.
        shrunk: (n, 3) the same, each drawn inwards by half the clearance along its normal, m.
        faces: (m, 3) vertex indices.
        bodies: one row of three vertex indices, far apart from each other, for each connected body.
        hull: (h, 3) vertices of the convex hull, m.
        neighbours: (m, 3) for each face the face across its edge from corner i to corner i + 1; -1 where
            there is not exactly one.
    """

    def __init__(self, item: Item, clearance: float) -> None:
        """Merge equal vertices (a seam would tear open when shrunk) and derive everything else."""
        self.source = (item.vertices, item.faces)
        self.clearance = clearance
        every = np.asarray(item.vertices, float) + 0.0  # no negative zeros
        self.vertices, inverse = np.unique(every, axis=0, return_inverse=True)
        self.faces: IntArray = inverse.reshape(-1)[np.asarray(item.faces, np.int64)]
        self.shrunk = self.vertices - 0.5 * clearance * _vertex_normals(self.vertices, self.faces)
        self.bodies = _body_representatives(self.vertices, self.faces)
        self.hull = _hull_vertices(self.vertices)
        self.neighbours = _neighbours(self.faces)

    def made_of(self, item: Item) -> bool:
        """Whether this is the solid of ``item``: same numbers, not only the same digest."""
        vertices, faces = self.source
        if vertices is item.vertices and faces is item.faces:
            return True
        return np.array_equal(vertices, item.vertices) and np.array_equal(faces, item.faces)

    def points(self, shrunk: bool) -> FloatArray:
        """The shrunk or the exact vertices."""
        return self.shrunk if shrunk else self.vertices

    def surface(self, shrunk: bool) -> Surface:
        """The shrunk or the exact surface, from a bounded cache."""
        points = self.points(shrunk)
        make = partial(Surface, points, self.faces)
        return _SURFACES.get((id(self), shrunk), make, lambda s: s.vertices is points)


# A solid takes about 1 MB, a surface with its hierarchy about 10 MB, and only pairs that interlock or
# overlap ever need the latter.
_SOLIDS: BoundedCache[Solid] = BoundedCache(128)
_SURFACES: BoundedCache[Surface] = BoundedCache(48)


def solid_of(item: Item, clearance: float = DEFAULT_CLEARANCE) -> Solid:
    """The item's solid, from a bounded cache keyed by the mesh's digest.

    Args:
        item: mesh frame, m.
        clearance: depth up to which contact is touching, m.
    """
    return _SOLIDS.get((item.sha256, clearance), lambda: Solid(item, clearance), lambda s: s.made_of(item))


class Posed:
    """A solid at a pose, with what is derived from both worked out once.

    Attributes:
        solid: mesh frame.
        pose: mesh frame to container frame.
    """

    def __init__(self, solid: Solid, pose: Pose) -> None:
        """Keep both."""
        self.solid = solid
        self.pose = pose

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, 3) smallest and largest x, y, z over all exact vertices, container frame, m."""
        placed = self.pose.apply(self.solid.vertices)
        return np.stack([placed.min(axis=0), placed.max(axis=0)])

    @cached_property
    def span(self) -> FloatArray:
        """(2, n) smallest and largest extent along each direction of :data:`UPWARD`, m."""
        along = self.pose.apply(self.solid.hull) @ UPWARD.T
        return np.stack([along.min(axis=0), along.max(axis=0)])

    @cached_property
    def centre(self) -> FloatArray:
        """(3,) mean of the hull's vertices, container frame, m."""
        centre: FloatArray = self.pose.apply(self.solid.hull.mean(axis=0, keepdims=True))[0]
        return centre

    def moved(self, offset: FloatArray) -> Posed:
        """The same solid, moved by ``offset`` (3,), m."""
        return Posed(self.solid, self.pose.moved(offset))


def overlap_depth(a: Posed, b: Posed) -> float:
    """How deep two posed solids are in each other.

    Args:
        a: one solid.
        b: the other, made with the same clearance.

    Returns:
        0.0 where they are apart or touch, by the rule in the module's docstring. Otherwise the length of
        the shortest tried translation that separates them, m: an upper bound of the translational
        penetration depth, exact (to 0.5 %) where that depth is along a normal of faces that meet, as
        between boxes.
    """
    clearance = a.solid.clearance
    slide = np.concatenate([a.span[1] - b.span[0], b.span[1] - a.span[0]])
    if float(slide.min()) <= clearance:
        return 0.0
    if not solids_meet(a, b) or not solids_meet(a, b, shrunk=True):
        return 0.0
    directions = _parting_directions(a, b)
    for direction in directions:
        if not solids_meet(a, b.moved(clearance * _BEYOND * direction)):
            return 0.0
    depth = _shortest_escape(a, b, directions, known=float(slide.min()))
    if depth <= 2.0 * clearance:
        # So close to the limit, the few directions above might decide by which triangles FCL met first.
        for direction in np.concatenate([UPWARD, -UPWARD]):
            if not solids_meet(a, b.moved(clearance * _BEYOND * direction)):
                return 0.0
    return depth


def solids_meet(a: Posed, b: Posed, shrunk: bool = False) -> bool:
    """Whether two posed solids share a point: surfaces that meet, or one body inside the other solid."""
    surface_a, surface_b = a.solid.surface(shrunk), b.solid.surface(shrunk)
    if surfaces_meet(surface_a, a.pose, surface_b, b.pose):
        return True
    return _holds_a_body(a, b, shrunk) or _holds_a_body(b, a, shrunk)


def _holds_a_body(outer: Posed, inner: Posed, shrunk: bool) -> bool:
    """Whether a body of ``inner`` lies inside ``outer``, given that their surfaces do not meet."""
    surface, faces = outer.solid.points(shrunk), outer.solid.faces
    # One vertex stands for its body: where the surfaces do not meet, all are on the same side.
    vertices = inner.solid.points(shrunk)[inner.solid.bodies[:, 0]]
    points = outer.pose.invert(inner.pose.apply(vertices))
    low, high = surface.min(axis=0), surface.max(axis=0)
    near = np.all((points >= low) & (points <= high), axis=1)
    return any(winding_number(surface, faces, point) > 0.5 for point in points[near])


def _parting_directions(a: Posed, b: Posed) -> FloatArray:
    """(n, 3) directions to move ``b`` in: contact normals, the centre line, the axes, both ways each."""
    line = unit((b.centre - a.centre)[None, :])
    axes = np.eye(3)
    met = contact_directions(a.solid.surface(False), a.pose, b.solid.surface(False), b.pose)
    directions = np.concatenate([met, line, -line, axes, -axes])
    kept: FloatArray = directions[np.einsum("ij,ij->i", directions, directions) > 0.5]
    return kept


def _shortest_escape(a: Posed, b: Posed, directions: FloatArray, known: float) -> float:
    """Length of the shortest translation of ``b`` found that separates it from ``a``, m.

    Args:
        a: stays.
        b: is moved; meets ``a`` now, and still does after a move by the clearance in each direction.
        directions: (n, 3) unit.
        known: a length that separates them, from separating planes, m.
    """
    best = known
    for direction in directions:
        low = a.solid.clearance
        high = 2.0 * low
        # Growing steps first: for hollow shapes a longer move may meet again what a shorter one had left.
        while high < best and solids_meet(a, b.moved(high * direction)):
            low, high = high, 2.0 * high
        if high >= best:
            high = best * (1.0 - _DEPTH_RESOLUTION)
            if high <= low or solids_meet(a, b.moved(high * direction)):
                continue
        while high - low > _DEPTH_RESOLUTION * high:
            middle = 0.5 * (low + high)
            if solids_meet(a, b.moved(middle * direction)):
                low = middle
            else:
                high = middle
        best = high
    return best


def unit(vectors: FloatArray) -> FloatArray:
    """(n, 3) vectors scaled to length 1; zero stays zero."""
    length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]
    scaled: FloatArray = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)
    return scaled


def _cross_products(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(m, 3) twice each triangle's area along its normal, m²."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    return np.cross(b - a, c - a)


def _vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """(n, 3) unit normals weighted by corner angle, so that how a flat face is cut does not matter."""
    normals = unit(_cross_products(vertices, faces))
    total = np.zeros_like(vertices)
    for corner in range(3):
        here = vertices[faces[:, corner]]
        towards = unit(vertices[faces[:, (corner + 1) % 3]] - here)
        back = unit(vertices[faces[:, (corner + 2) % 3]] - here)
        angle = np.arccos(np.clip(np.einsum("ij,ij->i", towards, back), -1.0, 1.0))
        for axis in range(3):
            weights = angle * normals[:, axis]
            total[:, axis] += np.bincount(faces[:, corner], weights=weights, minlength=len(vertices))
    return unit(total)


def _body_representatives(vertices: FloatArray, faces: IntArray) -> IntArray:
    """(n_bodies, 3) vertices of each connected body, the largest along x, y and z."""
    count = len(vertices)
    rows = np.concatenate([faces[:, 0], faces[:, 1]])
    columns = np.concatenate([faces[:, 1], faces[:, 2]])
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    used = np.unique(faces)
    bodies = []
    for label in np.unique(labels[used]):
        members = used[labels[used] == label]
        bodies.append(members[np.argmax(vertices[members], axis=0)])
    return np.array(bodies, dtype=np.int64)


def _neighbours(faces: IntArray) -> IntArray:
    """(m, 3) the face on the other side of each half-edge, -1 where there is not exactly one."""
    start = faces.reshape(-1)
    end = np.roll(faces, -1, axis=1).reshape(-1)
    edge = np.minimum(start, end) * (int(faces.max()) + 1) + np.maximum(start, end)
    order = np.argsort(edge, kind="stable")
    ordered = edge[order]
    same = ordered[1:] == ordered[:-1]
    first = same & ~np.append(False, same[:-1]) & ~np.append(same[1:], False)
    a, b = order[:-1][first], order[1:][first]
    across = np.full(len(edge), -1, dtype=np.int64)
    across[a], across[b] = b // 3, a // 3
    return across.reshape(-1, 3)


def _hull_vertices(vertices: FloatArray) -> FloatArray:
    """(h, 3) vertices of the convex hull; all of them where the hull has no volume."""
    try:
        hull: FloatArray = vertices[ConvexHull(vertices).vertices]
    except QhullError:
        return vertices
    return hull
