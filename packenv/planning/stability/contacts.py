"""Contacts between a placed item and items, walls and floor (paper Sec. III-A).

The paper scales geometry by 1.03 about its centre and takes what then overlaps, which is 4.5 mm on an item of
30 cm and 0.45 mm on one of 3 cm. Here surfaces touch where they are at most a stated gap apart and face each
other: samples of each surface against the exact faces of the other. :mod:`packenv.planning.stability.paper_contacts` is
the paper's rule, kept for comparison.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from packenv.geometry.distance_grids import REACH, SPACING, SurfaceField
from packenv.planning.stability.contact_kernels import CROSSING_WAY, touches, touches_container
from packenv.types import Contacts, Container, FloatArray

THRESHOLD = 1.5e-3
"""Largest gap between surfaces that touch, m. Conservative heightmaps leave 0 to 1.5 mm, mostly 0.5 mm."""

LARGEST_THRESHOLD = float(np.sqrt(REACH**2 - CROSSING_WAY**2))
"""Larger gaps are beyond the band of the distance grids, m."""


@dataclass(frozen=True, eq=False)
class Body:
    """A surface at a pose: p_container = rotation @ p_mesh + position.

    Attributes:
        field: the surface, mesh frame.
        rotation: (3, 3) proper rotation.
        position: (3,) m.
        box: (2, 3) smallest and largest x, y, z of the item at this pose, m, where they are known.
        friction: coefficient of the surface, where it has its own.
    """

    field: SurfaceField
    rotation: FloatArray
    position: FloatArray
    box: FloatArray | None = None
    friction: float | None = None

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, 3) a box around the item, m: its own where that is known, else that of the mesh frame's box."""
        if self.box is not None:
            return self.box
        low, high = self.field.bounds
        centre = self.rotation @ ((low + high) / 2) + self.position
        half = np.abs(self.rotation) @ ((high - low) / 2)
        return np.stack([centre - half, centre + half])


def no_contacts() -> Contacts:
    """Contacts of nothing with nothing."""
    numbers = np.zeros(0, np.int64)
    return Contacts(np.zeros((0, 3)), np.zeros((0, 3)), numbers, numbers, np.zeros(0))


def join(parts: Sequence[Contacts]) -> Contacts:
    """All contacts of several records in one, in sequence."""
    if not parts:
        return no_contacts()
    return Contacts(
        np.concatenate([p.points for p in parts]),
        np.concatenate([p.normals for p in parts]),
        np.concatenate([p.first for p in parts]),
        np.concatenate([p.second for p in parts]),
        np.concatenate([p.gaps for p in parts]),
        None
        if all(p.mu is None for p in parts)
        else np.concatenate([np.full(len(p), np.nan) if p.mu is None else p.mu for p in parts]),
    )


def with_friction(contacts: Contacts, bodies: Sequence[Body], mu: float) -> Contacts:
    """Contacts that know their coefficient of friction: the lesser one of the two surfaces that touch.

    Tables of friction are of pairs; of two surfaces with one coefficient each, the lesser is what the pair can be
    relied on for: a slippery item slides on everything.

    Args:
        contacts: of a pile.
        bodies: items 1 to n of the pile.
        mu: coefficient of the container, and of items without their own.

    Returns:
        The same where no item has its own.
    """
    if all(body.friction is None for body in bodies):
        return contacts
    own = np.array([mu, *(mu if body.friction is None else body.friction for body in bodies)])
    return replace(contacts, mu=np.minimum(own[contacts.first], own[contacts.second]))


def item_contacts(
    new: Body, others: Sequence[Body], container: Container, *, index: int, threshold: float = THRESHOLD
) -> Contacts:
    """Contacts of one item with the items before it, the walls and the floor.

    Points and normals are those of a touched face: of the container, or of whichever of two items has a face
    (not an edge or corner) there. Where sharp edges cross, the normal is perpendicular to both.

    Args:
        new: the item.
        others: items 1 to ``index - 1``, in packing sequence.
        container: the box.
        index: number of ``new`` in the packing sequence, from 1.
        threshold: largest gap, m; at most :data:`LARGEST_THRESHOLD`.

    Returns:
        Contacts whose ``second`` is ``index`` and ``first`` the earlier item or 0, unthinned: see
        :func:`packenv.planning.stability.contact_patches.thin`.

    Raises:
        ValueError: the index does not follow ``others``, or the threshold is out of range.
    """
    if index != len(others) + 1:
        raise ValueError(f"index is {index}, give {len(others) + 1}: one more than the items before it")
    if not 0.0 < threshold <= LARGEST_THRESHOLD:
        raise ValueError(
            f"threshold is {threshold:g} m, give metres above 0 and up to {LARGEST_THRESHOLD:.4f}"
        )
    parts, bodies = [_with_container(new, container, threshold)], [0]
    if others:
        low, high = new.bounds[0] - threshold, new.bounds[1] + threshold
        boxes = np.array([b.bounds for b in others])
        close = np.all((boxes[:, 0] <= high) & (boxes[:, 1] >= low), axis=1)
        for i in np.flatnonzero(close).tolist():
            parts += _one_way(new, others[i], 1.0, threshold), _one_way(others[i], new, -1.0, threshold)
            bodies += i + 1, i + 1
    rows = np.concatenate(parts)
    return Contacts(
        rows[:, :3].copy(),
        rows[:, 3:6].copy(),
        np.repeat(bodies, [len(part) for part in parts]),
        np.full(len(rows), index, np.int64),
        rows[:, 6].copy(),
    )


_local = threading.local()


def _room(rows: int) -> FloatArray:
    """(``rows`` or more, 7) this thread's, to be filled: a new array of some megabytes costs half of a search."""
    room: FloatArray | None = getattr(_local, "room", None)
    if room is None or len(room) < rows:
        room = _local.room = np.empty((rows, 7))
    return room


def _with_container(new: Body, container: Container, threshold: float) -> FloatArray:
    """(k, 7) points on the container, normals into the body, gaps, m."""
    field = new.field
    # A sample in a corner touches three planes.
    rows = _room(3 * len(field.records))
    count = touches_container(
        field.records,
        field.kinds,
        field.starts,
        field.spheres,
        np.ascontiguousarray(new.rotation, np.float64),
        np.asarray(new.position, np.float64),
        np.array(container.size),
        threshold,
        rows,
    )
    return rows[:count].copy()


def _one_way(samples: Body, surface: Body, sign: float, threshold: float) -> FloatArray:
    """(k, 7) contacts of one body's samples with another's faces: points, normals by ``sign``, gaps, m."""
    one, other = samples.field, surface.field
    # A sample touches one face or crosses up to three edges.
    rows = _room(3 * len(one.records))
    low, high = surface.bounds - surface.position
    count = touches(
        one.records,
        one.kinds,
        one.starts,
        one.spheres,
        np.ascontiguousarray(surface.rotation.T @ samples.rotation, np.float64),
        surface.rotation.T @ (samples.position - surface.position),
        low,
        high,
        surface.rotation,
        other.vertices,
        other.faces,
        other.normals,
        other.neighbours,
        other.boxes,
        other.origin,
        SPACING,
        other.distance,
        threshold,
        rows,
    )
    found = rows[:count].copy()
    if count:
        found[:, :3] = rows[:count, :3] @ surface.rotation.T + surface.position
        found[:, 3:6] = sign * (rows[:count, 3:6] @ surface.rotation.T)
    return found
