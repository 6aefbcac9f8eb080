"""Fewer contacts with the same effect: the corners of every flat patch.

Forces at points inside a flat patch with one normal are sums of forces at the corners of its convex hull, so
leaving them out changes no answer. Averaging contacts over cells, as the paper does, moves the hull inwards,
and an item that stands safely seems to fall.

What is kept is some of the contacts as they were, so whatever is stable on them is stable on all.
"""

from __future__ import annotations

import math

import numpy as np

from packenv.kernels import compiled
from packenv.types import Contacts

ANGLE = math.radians(8.0)
"""Normals this close to a patch's first one belong to the patch, rad."""

FLAT = 0.75e-3
"""Points this close to the plane of a patch belong to it, m."""

HULL = 0.2e-3
"""A corner that stands out by less than this from the hull of the others is left out, m."""


def thin(contacts: Contacts, *, angle: float = ANGLE, flat: float = FLAT, hull: float = HULL) -> Contacts:
    """Keep only the corners of each flat patch of contacts between the same two bodies.

    Args:
        contacts: any.
        angle: rad, how far normals in one patch may differ.
        flat: m, how far points of one patch may be off its plane.
        hull: m, how far the hull of what is kept may stay behind the hull of all.

    Returns:
        Some of the contacts, unchanged and in their sequence.
    """
    if not len(contacts):
        return contacts
    keep = np.zeros(len(contacts), np.bool_)
    _mark_corners(
        contacts.points,
        contacts.normals,
        contacts.first,
        contacts.second,
        math.cos(angle),
        flat,
        hull,
        keep,
    )
    return contacts.take(keep)


@compiled
def _mark_corners(points, normals, first, second, cosine, flat, hull, keep):  # type: ignore[no-untyped-def]
    """Set ``keep`` for the corners of all patches.

    A patch is what lies close to the plane through its first contact. Its directions are taken from its own
    points, so that a pile that is moved as a whole keeps the same contacts.
    """
    n = len(points)
    done = np.zeros(n, np.bool_)
    members = np.empty(n, np.int64)
    ends = np.empty((n + 2, 2), np.int64)
    for seed in range(n):
        if done[seed]:
            continue
        m = 0
        for j in range(seed, n):
            if done[j] or first[j] != first[seed] or second[j] != second[seed]:
                continue
            same, off = 0.0, 0.0
            for axis in range(3):
                same += normals[j, axis] * normals[seed, axis]
                off += (points[j, axis] - points[seed, axis]) * normals[seed, axis]
            if same >= cosine and abs(off) <= flat:
                done[j] = True
                members[m] = j
                m += 1
        a = _farthest(points, members, m, seed)
        b = _farthest(points, members, m, a)
        keep[a] = True
        width = 0.0
        for axis in range(3):
            width += (points[a, axis] - points[b, axis]) ** 2
        if width <= hull * hull:
            continue
        keep[b] = True
        ends[0, 0], ends[0, 1] = a, b
        ends[1, 0], ends[1, 1] = b, a
        depth = 2
        nx, ny, nz = normals[seed, 0], normals[seed, 1], normals[seed, 2]
        while depth > 0:
            depth -= 1
            p, q = ends[depth, 0], ends[depth, 1]
            ux, uy, uz = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1], points[q, 2] - points[p, 2]
            vx, vy, vz = uy * nz - uz * ny, uz * nx - ux * nz, ux * ny - uy * nx
            length = math.sqrt(vx * vx + vy * vy + vz * vz)
            if length < 1e-12:
                continue
            most, at = hull * length, -1
            for i in range(m):
                j = members[i]
                # The two farthest need not be corners; around one that lies inside, corners would come again for ever.
                if keep[j]:
                    continue
                out = (
                    (points[j, 0] - points[p, 0]) * vx
                    + (points[j, 1] - points[p, 1]) * vy
                    + (points[j, 2] - points[p, 2]) * vz
                )
                if out > most:
                    most, at = out, j
            if at >= 0:
                keep[at] = True
                ends[depth, 0], ends[depth, 1] = p, at
                ends[depth + 1, 0], ends[depth + 1, 1] = at, q
                depth += 2


@compiled
def _farthest(points, members, m, start):  # type: ignore[no-untyped-def]
    """The member that is farthest from the contact ``start``."""
    best, most = start, -1.0
    for i in range(m):
        j = members[i]
        d = 0.0
        for axis in range(3):
            d += (points[j, axis] - points[start, axis]) ** 2
        if d > most:
            best, most = j, d
    return best


TOUCHING = 5e-5
"""Contacts of one pair and one side whose gap is within this of a nearer one's touch together with it, m."""

ROCKING = 0.03
"""Tangent of the angle by which an item may rock until its next contact touches: 1.7°."""


def tighten(contacts: Contacts, *, slack: float = TOUCHING, rocking: float = ROCKING) -> Contacts:
    """Keep, of each pair of bodies and each side, the contacts that can touch together.

    Everything within the contact threshold of 1.5 mm gives a ball a foot of several millimetres, on which it
    withstands a tilt that no ball withstands. Rigid bodies touch where the gap is smallest, then rock by the
    gap over the distance until the next contact touches. So a contact stays unless another one is nearer by
    more than ``slack`` and more than they could make up for by rocking. A box on an uneven bed keeps its
    corners; a ball of any size keeps a foot that is seen from its centre under about the angle of rocking, so
    a margin of some more tilt rejects it. Sides are told apart by the dominant axis of the normal, so a
    nested item keeps its contacts all around.

    Args:
        contacts: with their gaps.
        slack: difference of gaps that means nothing, m.
        rocking: further difference for each metre of distance.

    Returns:
        a subset of the contacts, in their sequence.
    """
    if not len(contacts):
        return contacts
    axis = np.abs(contacts.normals).argmax(axis=1)
    sign = contacts.normals[np.arange(len(contacts)), axis] > 0
    bodies = int(max(contacts.first.max(), contacts.second.max())) + 1
    groups = ((contacts.first * bodies + contacts.second) * 3 + axis) * 2 + sign
    keep = np.zeros(len(contacts), np.bool_)
    order = np.lexsort((contacts.gaps, groups))
    _mark_touching(order, groups, contacts.points, contacts.gaps, slack, rocking, keep)
    return contacts.take(keep)


@compiled
def _mark_touching(order, groups, points, gaps, slack, rocking, keep):  # type: ignore[no-untyped-def]
    """Set ``keep`` for contacts that no nearer one of their group excludes.

    By the triangle inequality what an excluded contact excludes is excluded by a kept one as well, so only
    kept ones are asked, nearest first.
    """
    kept = np.empty(len(order), np.int64)
    count = 0
    for place in range(len(order)):
        i = order[place]
        if place == 0 or groups[i] != groups[order[place - 1]]:
            count = 0
        touching = True
        for m in range(count):
            j = kept[m]
            excess = gaps[i] - gaps[j] - slack
            if excess <= 0.0:
                break
            d = 0.0
            for axis in range(3):
                d += (points[i, axis] - points[j, axis]) ** 2
            if excess * excess > rocking * rocking * d:
                touching = False
                break
        if touching:
            keep[i] = True
            kept[count] = i
            count += 1
