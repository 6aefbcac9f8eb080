"""Where a convex outline fits a container: every rotation is looked at, so "none" is a proof.

Rotations are searched by subdivision: a cell of rotations is dropped once no rotation of it can fit. What is left
falls into regions; of each the rotation with most room is given, and the one at which gravity holds the item.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from packenv.config import CLEARANCE
from packenv.types import FloatArray, IntArray

_START = 1 / 6
"""Half the side of the first cells, in the coordinates of :func:`_rotations`."""

_RESOLVED = 1 / 96
"""Half the side of a cell at which regions are told apart: rotations of a cell differ by at most 2°."""

_FINEST = 1 / 3072
"""Half the side at which the search ends without an answer: 0.06°, half a millimetre at the ends of half a metre."""

_MOST_CELLS = 40_000
"""Of one level. Where more are left, the ones with the most room are looked at, and "none" is no proof."""

_MOST_REGIONS = 6
"""Those with the most room; each has four mirror places and may be kept at two rotations."""

_BATCH = 2_000_000
"""Numbers in one array of projected points."""

_DIRECTIONS = 300
"""In which the outermost vertices are kept for the search over cells; smooth scans have thousands."""

_TRIES = 48
"""Random turns tried at once, about the last rotation."""

_LEAST_TURN = 2e-5
"""Where the turns end, rad."""

_SLACK = 1e-4
"""What a leaning item leaves to the walls, m: more than rounding, and contact for force balance."""

_HALF_TURNS = np.array([np.diag(d) for d in ((1.0, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1))])
"""(4, 3, 3) about the container's axes: they change no extent."""


def regions_of_fit(points: FloatArray, com: FloatArray, size: tuple[float, float, float]) -> FloatArray:
    """Rotations at which a convex item fits a container: for every region of them, a few.

    Given are, of every region, the rotation with the lowest centre of mass, to which gravity takes the item until
    walls hold it, and the one with the most room, which leaves the robot some; and the same after half a turn about
    each axis of the container.

    Args:
        points: (n, 3) vertices of the hull, m.
        com: (3,) centre of mass, same frame, m.
        size: of the container, m.

    Returns:
        (k, 3, 3) mesh frame to container axes; none where the item fits at no rotation.
    """
    largest = np.add(size, CLEARANCE)
    points, com = points - com, np.zeros(3)
    found: list[FloatArray] = []
    for seed in _seeds(_extreme(points), largest):
        roomy = _climbed(points, seed, _room, largest)
        if _room(points, roomy[None], largest)[0] < 0.0:
            continue
        for upside in (0, 2):  # half a turn about z leaves the centre of mass at its height
            start = _HALF_TURNS[upside] @ roomy
            low = _climbed(points, start, _lowness, largest - CLEARANCE - _SLACK)
            for rotation in (low, start):
                for turn in _HALF_TURNS[:2]:
                    if not any(np.abs(turn @ rotation - other).max() < 0.01 for other in found):
                        found.append(turn @ rotation)
    return np.array(found).reshape(-1, 3, 3)


def _rotations(points: FloatArray) -> FloatArray:
    """(n, 3, 3) the rotations of (n, 3) points of the cube [-1, 1]³.

    (x, y, z) stands for the quaternion (1, x, y, z): one of the four faces of the hypercube, which half turns about
    the container's axes carry into each other. So the cube has every rotation once, but for those half turns.
    """
    q = np.column_stack([np.ones(len(points)), points])
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _turned(points: FloatArray, rotations: FloatArray) -> FloatArray:
    """(n, 3, v) coordinates of (v, 3) points at (n, 3, 3) rotations."""
    return (rotations.reshape(-1, 3) @ points.T).reshape(len(rotations), 3, -1)


_Goal = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""(v, 3) points, (n, 3, 3) rotations and a (3,) size to (n,) numbers, the larger the better."""


def _room(points: FloatArray, rotations: FloatArray, largest: FloatArray) -> FloatArray:
    room: FloatArray = (largest - np.ptp(_turned(points, rotations), axis=2)).min(axis=1)
    return room


def _lowness(points: FloatArray, rotations: FloatArray, largest: FloatArray) -> FloatArray:
    """How low the origin is over the lowest point, where the points fit."""
    turned = _turned(points, rotations)
    room = (largest - np.ptp(turned, axis=2)).min(axis=1)
    # What does not fit is worse than all that does, and the worse the less it fits.
    value: FloatArray = np.where(room >= 0.0, turned[:, 2].min(axis=1), room * 1e3 - 1e3)
    return value


def _climbed(points: FloatArray, start: FloatArray, goal: _Goal, largest: FloatArray) -> FloatArray:
    """(3, 3) a rotation near ``start`` at which a goal is best: random turns, smaller ones where none is better."""
    rng = np.random.default_rng(0)
    best, angle = start, 0.05
    radius = float(np.linalg.norm(points, axis=1).max())
    while angle > _LEAST_TURN:
        vectors = rng.standard_normal((_TRIES, 3)) * angle
        vectors *= np.minimum(1.0, 2 * angle / np.linalg.norm(vectors, axis=1, keepdims=True))
        turned = points @ best.T
        reach = 4 * angle * radius  # no other point becomes the outermost by such a turn
        outer = (turned > turned.max(axis=0) - reach) | (turned < turned.min(axis=0) + reach)
        near = points[outer.any(axis=1)]
        rotations = np.concatenate([best[None], _small_turns(vectors) @ best])
        values = goal(near, rotations, largest)
        k = int(np.argmax(values))
        best = rotations[k]
        angle *= 1.25 if k else 0.6
    return best


def _extreme(points: FloatArray) -> FloatArray:
    """(k, 3) those points that are outermost in some hundred directions: what they span, all span."""
    if len(points) <= _DIRECTIONS:
        return points
    k = np.arange(_DIRECTIONS)
    z, turn = 1 - (2 * k + 1) / _DIRECTIONS, k * math.pi * (3 - math.sqrt(5))  # a Fibonacci lattice
    directions = np.column_stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    kept: FloatArray = points[np.unique((points @ directions.T).argmax(axis=0))]
    return kept


def _small_turns(vectors: FloatArray) -> FloatArray:
    """(n, 3, 3) turns about (n, 3) vectors by their lengths, of less than half a turn; half angles by tangent."""
    lengths = np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
    return _rotations(vectors / lengths * np.tan(np.minimum(lengths, 3.0) / 2))


def _seeds(points: FloatArray, largest: FloatArray) -> list[FloatArray]:
    """Of every region of cells that may fit, the rotation with the most room, at most some regions."""
    half = _START
    axis = np.arange(-1 + half, 1, 2 * half)
    centres = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    while True:
        room, open_ = _examined(points, largest, centres, half)
        centres, room = centres[open_], room[open_]
        if len(centres) > _MOST_CELLS:
            most = np.sort(np.argsort(-room, kind="stable")[:_MOST_CELLS])
            centres, room = centres[most], room[most]
        fits = bool((room >= 0.0).any())
        if not len(centres) or half <= (_RESOLVED if fits else _FINEST):
            break
        if fits and 8 * len(centres) > _MOST_CELLS:
            break
        half /= 2
        corners = np.stack(np.meshgrid(*[[-half, half]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        centres = (centres[:, None] + corners).reshape(-1, 3)
    if not len(centres):
        return []
    labels = _regions(centres, half)
    by_room = np.argsort(-room, kind="stable")
    _, first = np.unique(labels[by_room], return_index=True)
    best = by_room[np.sort(first)[:_MOST_REGIONS]]
    return list(_rotations(centres[best]))


def _examined(
    points: FloatArray, largest: FloatArray, centres: FloatArray, half: float
) -> tuple[FloatArray, FloatArray]:
    """(n,) room at the centres of cells, m, and (n,) whether any rotation of the cell may fit.

    The two vertices p, q that span an extent e at the centre, |p - q| = d, span at least
    e cos θ - √(d² - e²) sin θ at any rotation within the angle θ.
    """
    # The cube's point v stands for (1, v) / |(1, v)|: a step of s from v turns by at most 2 s / |(1, v)| there.
    reach = half * math.sqrt(3)
    nearest = np.maximum(np.sqrt(1 + (centres**2).sum(axis=1)) - reach, 1.0)
    angle = np.minimum(2 * reach / nearest, math.pi / 2)[:, None]
    room, open_ = np.empty(len(centres)), np.empty(len(centres), dtype=bool)
    size = max(1, _BATCH // (3 * len(points)))
    for k in range(0, len(centres), size):
        part = slice(k, k + size)
        turned = _turned(points, _rotations(centres[part]))
        extents = np.ptp(turned, axis=2)
        spans = points[turned.argmax(axis=2)] - points[turned.argmin(axis=2)]
        across = np.sqrt(np.maximum((spans**2).sum(axis=2) - extents**2, 0.0))
        least = extents * np.cos(angle[part]) - across * np.sin(angle[part])
        room[part] = (largest - extents).min(axis=1)
        open_[part] = (least <= largest).all(axis=1)
    return room, open_


def _regions(centres: FloatArray, half: float) -> IntArray:
    """(n,) to which region each cell belongs; cells that share a corner are in one."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(centres).query_pairs(2.05 * half, p=np.inf, output_type="ndarray")
    n = len(centres)
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    labels: IntArray = connected_components(graph, directed=False)[1]
    return labels
