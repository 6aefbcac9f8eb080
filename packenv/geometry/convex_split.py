"""Split a solid by planes until the convex hulls of the pieces stay close to it.

A greedy relative of V-HACD (Mamou 2016) and CoACD (Wei et al. 2022). Theirs trade hull volume for a number of
parts; here the measure is the one that the planner feels: how far a hull reaches outside the item.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from packenv.geometry.outside_depth import OutsideDepth
from packenv.geometry.part_hulls import Hull, hull_of, rough_planes, surface_points
from packenv.kernels import compiled
from packenv.types import BoolArray, FloatArray, IntArray

WANTED = 0.0015
"""Pieces whose hulls reach no farther than this outside the item are not split, m."""

LOOSE = 0.003
"""They may reach out so far where they fill little (:data:`ENOUGH`), m."""

ENOUGH = 0.03
"""Share of the hull's volume that all parts together may fill outside the item."""

_LEEWAY = 0.75
"""Pieces are joined where their common hull reaches out by less than this share of the largest bulge."""

MAX_PARTS = 40
"""Parts that an item may have."""

_COARSE = 0.001
"""Planes are compared on meshes simplified by this, m."""

_LATTICE = 6000
"""Lattice points in the box of a piece: those outside the item and in a hull say what the hull fills."""

_FRACTIONS = np.linspace(0.1, 0.9, 9)
_FEW = np.array([0.35, 0.5, 0.65])
_POOR = 0.7
"""A cut that leaves more than this share of what is filled is judged by the next cuts too."""

_SKIN = 0.0003
"""Points less than this outside the item count as inside: noise of scans and of interpolation, m."""

_CRUMB = 1e-12
"""Volume below which a cut-off body is left out, m³."""

_SAMPLE = 0.002


@dataclass(frozen=True, eq=False)
class _Piece:
    """A piece of the item.

    Attributes:
        solid: manifold3d.Manifold; None after a merger.
        coarse: the same, simplified.
        hull: of the solid.
        bulge: how far the hull's surface reaches out of the item, m.
        filled: volume of the hull outside the item, m³.
    """

    solid: Any
    coarse: Any
    hull: Hull
    bulge: float
    filled: float
    serial: int = field(default_factory=itertools.count().__next__)


class _Wire(NamedTuple):
    """Vertices (n, 3), faces (m, 3) and edges (e, 2) of a piece's coarse mesh."""

    vertices: FloatArray
    faces: IntArray
    edges: IntArray


class _Void(NamedTuple):
    """Points (k, 3) of a lattice in a hull outside the item, their squared depths (k,), their volume, m³."""

    points: FloatArray
    weight: FloatArray
    volume: float


class _Pair(NamedTuple):
    """Two pieces' common hull reaches out by ``least``; joined to one piece where that is tolerable."""

    least: float
    joined: _Piece | None


class _Cut(NamedTuple):
    """A plane, normal · p = offset, and what the hulls on both sides would fill."""

    cost: float
    normal: FloatArray
    offset: float


def split_solid(solid: Any, depth: OutsideDepth, axes: FloatArray) -> list[FloatArray]:
    """Find the convex parts of a solid.

    Args:
        solid: a manifold3d.Manifold, mesh frame, m.
        depth: of the same solid.
        axes: (k, 3) unit directions that planes may always have, such as normals of the item's flat sides.

    Returns:
        (n, 3) vertices of each part's hull, m; together they contain the solid.
    """
    pieces = [_piece(body, body.simplify(_COARSE), depth) for body in solid.decompose()]
    enough = ENOUGH * float(solid.hull().volume())
    known: dict[tuple[int, int], _Pair] = {}
    while True:
        pieces = _divided(pieces, depth, axes, enough)
        tolerance = max(WANTED, _LEEWAY * max(p.bulge for p in pieces))
        merged = _merged(pieces, depth, known, tolerance)
        if len(merged) == len(pieces) or _good(merged, enough):
            return [p.hull.vertices for p in merged]
        pieces = merged


def _good(pieces: list[_Piece], enough: float) -> bool:
    """Whether no piece needs to be split any more."""
    worst = max(p.bulge for p in pieces)
    return worst <= WANTED or (worst <= LOOSE and sum(p.filled for p in pieces) <= enough)


def _divided(pieces: list[_Piece], depth: OutsideDepth, axes: FloatArray, enough: float) -> list[_Piece]:
    """Split the piece whose hull reaches out farthest until all are good or there are enough of them."""
    whole = [p for p in pieces if p.solid is None]
    pieces = [p for p in pieces if p.solid is not None]
    while pieces and len(pieces) + len(whole) < MAX_PARTS and not _good(pieces + whole, enough):
        worst = max(range(len(pieces)), key=lambda k: pieces[k].bulge)
        if pieces[worst].bulge <= WANTED:
            break
        piece = pieces.pop(worst)
        halves = _halves(piece, depth, axes)
        if halves is None:
            whole.append(piece)
        else:
            pieces += halves
    return pieces + whole


def hull_bulge(hull: Hull, depth: OutsideDepth) -> float:
    """How far a hull's surface reaches outside the item, interpolated, m."""
    return max(0.0, float(depth.quick(surface_points(hull, _SAMPLE)).max()))


def _piece(solid: Any, coarse: Any, depth: OutsideDepth) -> _Piece:
    hull = hull_of(_vertices(solid))
    return _Piece(solid, coarse, hull, hull_bulge(hull, depth), _void(hull, depth).volume)


def _vertices(solid: Any) -> FloatArray:
    return np.array(solid.to_mesh64().vert_properties[:, :3], dtype=np.float64)


def _halves(piece: _Piece, depth: OutsideDepth, axes: FloatArray) -> list[_Piece] | None:
    """The pieces on both sides of the best plane; None where no plane divides the piece."""
    void, weight, _ = _void(piece.hull, depth)
    wire = _wire(piece.coarse)
    if not len(void) or wire is None:
        return None
    whole = float(weight.sum())
    cuts = _cuts(wire, void, weight, axes, _POOR * whole)
    if not cuts:
        return None
    best = min(cuts, key=lambda c: c.cost)
    if best.cost > _POOR * whole:
        # No plane helps by itself: a tube fills as much in two halves as in one piece, but not in four.
        best = min(cuts, key=lambda c: _cost_after_next(piece.coarse, c, void, weight, axes))
    else:
        best = _shifted(best, wire, void, weight)
    sides = zip(
        piece.solid.split_by_plane(best.normal, best.offset),
        piece.coarse.split_by_plane(best.normal, best.offset),
        strict=True,
    )
    halves = [body for solid, coarse in sides for body in _bodies(solid, coarse)]
    return [_piece(s, c, depth) for s, c in halves] if len(halves) > 1 else None


def _wire(solid: Any) -> _Wire | None:
    mesh = solid.to_mesh64()
    faces = np.array(mesh.tri_verts, dtype=np.int64)
    if len(faces) < 4:
        return None
    vertices = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    return _Wire(vertices, faces, edges)


def _cuts(
    wire: _Wire,
    void: FloatArray,
    weight: FloatArray,
    axes: FloatArray,
    wanted: float,
    fractions: FloatArray = _FRACTIONS,
) -> list[_Cut]:
    """The best plane of every direction that is worth trying.

    Args:
        wire: of the piece.
        void: (k, 3) points, m.
        weight: (k,) of these.
        axes: (a, 3) unit directions to be tried besides the main axes.
        wanted: the best plane of all is enough where it costs no more than this; the others may be left out.
        fractions: (f,) of the piece's extent, where planes are tried.
    """
    reflex, how_long = _reflex_points(wire.vertices, wire.faces)
    found: list[_Cut] = []
    for normal in _directions(axes, void, weight, wire.vertices):
        along = wire.vertices @ normal
        low, high = float(along.min()), float(along.max())
        offsets = low + fractions * (high - low)
        if fractions is _FRACTIONS:
            offsets = np.concatenate([offsets, _peaks(reflex @ normal, how_long)])
        offsets = np.unique(offsets[(offsets > low + 1e-4) & (offsets < high - 1e-4)])
        bound = min((cut.cost for cut in found), default=np.inf)
        best = _best_offset(wire, along, offsets, void, weight, bound if bound <= wanted else np.inf)
        if best is not None:
            found.append(_Cut(best[0], normal, best[1]))
    return found


def _best_offset(
    wire: _Wire, along: FloatArray, offsets: FloatArray, void: FloatArray, weight: FloatArray, bound: float
) -> tuple[float, float] | None:
    """The cheapest of parallel planes, and the nearest to the middle of equally cheap ones.

    As a plane rises, the hull below it grows and the hull above it shrinks. So what a plane costs is at least
    what the next plane tried below it has below and the next tried above it has above: most are not tried.

    Args:
        wire: of the piece.
        along: (n,) places of its vertices along the planes' normal, m.
        offsets: (o,) places of the planes, ascending, m.
        void: (k, 3) points, m.
        weight: (k,) of these.
        bound: planes that cost more are of no use.

    Returns:
        Cost and offset, or None where no plane has hulls on both sides within the bound.
    """
    middle = (float(along.min()) + float(along.max())) / 2
    apart = np.abs(offsets - middle)
    below, above = np.zeros(len(offsets)), np.zeros(len(offsets))
    left = np.ones(len(offsets), np.bool_)
    best: tuple[float, float, float] | None = None
    while left.any():
        least = np.round(below + above, 9)
        k = int(np.lexsort((apart, least, ~left))[0])
        if least[k] > bound or (best is not None and (least[k], apart[k]) >= best[:2]):
            break
        left[k] = False
        height = along - offsets[k]
        lower = _weight_below(wire, height, void, weight)
        if lower is None:
            continue
        below[k:] = np.maximum(below[k:], lower)
        if best is not None and round(lower + above[k], 9) > best[0]:
            continue
        upper = _weight_below(wire, -height, void, weight)
        if upper is None:
            continue
        above[: k + 1] = np.maximum(above[: k + 1], upper)
        found = (round(lower + upper, 9), float(apart[k]), float(offsets[k]))
        if lower + upper <= bound and (best is None or found < best):
            best = found
    return None if best is None else (best[0], best[2])


def _cost_after_next(coarse: Any, cut: _Cut, void: FloatArray, weight: FloatArray, axes: FloatArray) -> float:
    """What the four pieces would fill after the best next cut on both sides."""
    total = 0.0
    for side in coarse.split_by_plane(cut.normal, cut.offset):
        wire = _wire(side)
        if wire is None:
            return np.inf
        held = _held(wire.vertices, void)
        if held is None or not held.any():
            continue
        own, own_weight = np.ascontiguousarray(void[held]), weight[held]
        cuts = _cuts(wire, own, own_weight, axes, np.inf, _FEW)
        total += min((c.cost for c in cuts), default=float(own_weight.sum()))
    return total


def _shifted(cut: _Cut, wire: _Wire, void: FloatArray, weight: FloatArray) -> _Cut:
    """The cut moved along its normal as long as that helps."""
    along = wire.vertices @ cut.normal
    step = float(np.ptp(along)) * 0.05
    while step > 0.0005:
        for offset in (cut.offset - step, cut.offset + step):
            trial = _Cut(_cost(wire, along - offset, void, weight), cut.normal, offset)
            if trial.cost < cut.cost * (1 - 1e-6):
                cut = trial
                break
        else:
            step /= 2
    return cut


def _bodies(solid: Any, coarse: Any) -> list[tuple[Any, Any]]:
    """The separate bodies of one side of a cut; each is coarsened anew where there are several."""
    bodies = [b for b in solid.decompose() if b.volume() > _CRUMB]
    if len(bodies) == 1 and not coarse.is_empty():
        return [(bodies[0], coarse)]
    return [(b, b.simplify(_COARSE)) for b in bodies]


def _void(hull: Hull, depth: OutsideDepth) -> _Void:
    low, high = hull.vertices.min(axis=0), hull.vertices.max(axis=0)
    spacing = float(np.prod(high - low) / _LATTICE) ** (1 / 3)
    ticks = [np.arange(a + spacing / 2, b, spacing) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    deep = depth.quick(points)
    points, deep = points[deep > _SKIN], deep[deep > _SKIN]
    inside = np.zeros(len(points), np.bool_)
    _inside(points, hull.planes, inside)
    return _Void(np.ascontiguousarray(points[inside]), deep[inside] ** 2, float(inside.sum()) * spacing**3)


def _cost(wire: _Wire, height: FloatArray, void: FloatArray, weight: FloatArray) -> float:
    """The weight of the void points that are in the hulls of both sides of a plane."""
    sides = (_weight_below(wire, way * height, void, weight) for way in (1.0, -1.0))
    return sum(np.inf if side is None else side for side in sides)


def _weight_below(wire: _Wire, height: FloatArray, void: FloatArray, weight: FloatArray) -> float | None:
    """The weight of the void points in the hull of what is below a plane; None where that has no volume."""
    a, b = height[wire.edges[:, 0]], height[wire.edges[:, 1]]
    cut = (a < 0) != (b < 0)
    share = a[cut] / (a[cut] - b[cut])
    start, end = wire.vertices[wire.edges[cut, 0]], wire.vertices[wire.edges[cut, 1]]
    crossing = start + share[:, None] * (end - start)
    held = _held(np.concatenate([wire.vertices[height < 0], crossing]), void)
    return None if held is None else float(weight[held].sum())


def _held(points: FloatArray, void: FloatArray) -> BoolArray | None:
    """(k,) which of the void points are in the hull of the points; None where that has no volume."""
    if len(points) < 4 or np.ptp(points, axis=0).min() < 1e-7:
        return None
    held = np.zeros(len(void), np.bool_)
    try:
        _inside(void, rough_planes(points), held)
    except ValueError:
        return None
    return held


@compiled
def _inside(points, planes, inside):  # type: ignore[no-untyped-def]
    """Whether each of (k, 3) points is on the inner side of all (m, 4) planes; filled in place."""
    last = 0
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        # Points that are near each other fail at the same plane.
        if planes[last, 0] * x + planes[last, 1] * y + planes[last, 2] * z + planes[last, 3] > 0.0:
            continue
        inside[k] = True
        for j in range(len(planes)):
            if planes[j, 0] * x + planes[j, 1] * y + planes[j, 2] * z + planes[j, 3] > 0.0:
                inside[k] = False
                last = j
                break


def _directions(
    axes: FloatArray, void: FloatArray, weight: FloatArray, vertices: FloatArray
) -> list[FloatArray]:
    """Normals worth trying: the item's own, and the main axes of the piece and of what its hull fills."""
    kept: list[FloatArray] = []
    for direction in [*axes, *_main_axes(vertices, np.ones(len(vertices))), *_main_axes(void, weight)]:
        if all(abs(direction @ other) < 0.996 for other in kept):
            kept.append(direction)
    return kept


def _main_axes(points: FloatArray, weight: FloatArray) -> FloatArray:
    centred = points - (weight @ points) / weight.sum()
    _, axes = np.linalg.eigh((centred * weight[:, None]).T @ centred)
    rows: FloatArray = axes.T
    return rows


def _reflex_points(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Middles of the edges where the surface turns inward, and their lengths times that turn."""
    corner = vertices[faces]
    normals = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    owner = np.repeat(np.arange(len(faces)), 3)
    forward = np.argsort(start * len(vertices) + end, kind="stable")
    backward = np.argsort(end * len(vertices) + start, kind="stable")
    f, g = owner[forward], owner[backward]
    way = vertices[end[forward]] - vertices[start[forward]]
    turn = np.einsum("ij,ij->i", np.cross(normals[f], normals[g]), way)
    strong = turn < -0.3 * np.linalg.norm(way, axis=1)
    middle = (vertices[start[forward]] + vertices[end[forward]]) / 2
    return middle[strong], -turn[strong]


def _peaks(along: FloatArray, weight: FloatArray) -> FloatArray:
    """The (up to) four places where most of the weight is, m."""
    if not len(along):
        return np.empty(0)
    cell = np.floor(along / 0.001).astype(np.int64)
    _, inverse = np.unique(cell, return_inverse=True)
    sums = np.bincount(inverse.reshape(-1), weight)
    top = np.argsort(-sums, kind="stable")[:4]
    return np.array([np.average(along[inverse == k], weights=weight[inverse == k]) for k in top])


def _merged(
    pieces: list[_Piece], depth: OutsideDepth, known: dict[tuple[int, int], _Pair], tolerance: float
) -> list[_Piece]:
    """Join pieces as long as a pair's common hull stays within the tolerance, the best pair first.

    Args:
        pieces: to be joined.
        depth: of the item.
        known: what pairs became, by their serial numbers; filled in place.
        tolerance: m.
    """
    pieces = list(pieces)
    while True:
        best: tuple[float, int, int, _Piece] | None = None
        for i, a in enumerate(pieces):
            for j in range(i + 1, len(pieces)):
                key = (a.serial, pieces[j].serial)
                pair = known.get(key)
                if pair is None or (pair.joined is None and pair.least <= tolerance):
                    pair = known[key] = _joined(a, pieces[j], depth, tolerance)
                if (
                    pair.joined is not None
                    and pair.least <= tolerance
                    and (best is None or pair.least < best[0])
                ):
                    best = (pair.least, i, j, pair.joined)
        if best is None:
            return pieces
        _, i, j, joined = best
        pieces = [p for k, p in enumerate(pieces) if k not in (i, j)] + [joined]


def _joined(a: _Piece, b: _Piece, depth: OutsideDepth, tolerance: float) -> _Pair:
    p, q = a.hull.vertices, b.hull.vertices
    if (np.maximum(p.min(axis=0), q.min(axis=0)) > np.minimum(p.max(axis=0), q.max(axis=0)) + 1e-6).any():
        return _Pair(np.inf, None)
    # Points between the two are in their common hull: a cheap necessary test before it is made.
    count = max(len(p), len(q))
    between = (p[np.arange(count) % len(p)] + q[np.arange(count) * 7 % len(q)]) / 2
    least = float(depth.quick(between).max())
    if least > tolerance:
        return _Pair(least, None)
    hull = hull_of(np.concatenate([p, q]))
    bulge = hull_bulge(hull, depth)
    return _Pair(
        bulge, _Piece(None, None, hull, bulge, _void(hull, depth).volume) if bulge <= tolerance else None
    )
