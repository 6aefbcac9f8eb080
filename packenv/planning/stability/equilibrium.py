"""Static equilibrium of a pile as linear conditions on contact forces (paper Sec. III-A).

A pile stands where forces exist, one at each contact and each inside its friction cone, that balance the
weight of every item. With an inscribed pyramid for each cone this is: are there x ≥ 0 with A x = b? This file
builds A and b and says what counts as an answer; :mod:`packenv.planning.stability.solvers` finds it.

Units. Row blocks of A are the items' force balance over their weight and their torque balance, about the
centre of mass, over weight × length; column blocks are the contacts' forces over the weight of the lighter of
the two items. So A and b have no unit, do not depend on the scale of the masses, and a residual of 1e-6 means
a millionth of an item's weight.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packenv import config
from packenv.planning.stability.equilibrium_kernels import add_wrenches, fill_columns, first_refuted
from packenv.types import Contacts, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

GRAVITY = (0.0, 0.0, -config.GRAVITY)
"""Acceleration of gravity in the container frame, m/s²."""

TOLERANCE = 1e-6
"""Largest residual of a force balance over weight, and of a torque balance over weight × length."""

LENGTH = 0.1
"""The length that torques are measured by, m: the order of size of an item. A millionth of it is 0.1 µm."""

_PROOF_FORCE = 1e4
"""A proof that no forces exist must hold for forces up to this many times the lighter item's weight."""


def tangents(normals: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit tangents of each contact, the first one uphill.

    With an edge of the friction pyramid uphill, an item on a ramp slides at the true friction angle, at every
    yaw. Where the contact is level no direction is uphill, and the first tangent follows the container's x
    axis (or, where ``up`` is not z, the axis that is farthest from ``up``).

    Args:
        normals: (k, 3) unit.
        up: (3,) unit, against gravity.

    Returns:
        Two (k, 3) arrays; with the normal each pair makes a right-handed frame.
    """
    first = up - (normals @ up)[:, None] * normals
    level = np.einsum("ij,ij->i", first, first) < 1e-12
    if level.any():
        axis = np.zeros(3)
        axis[int(np.argmin(np.abs(up)))] = 1.0
        first[level] = axis - (normals[level] @ axis)[:, None] * normals[level]
    first /= np.sqrt(np.einsum("ij,ij->i", first, first))[:, None]
    return first, _cross(normals, first)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """The question "are there x ≥ 0 with A x = b?" for a pile, or for some of its items.

    A is kept in compressed columns. Rows 6 i to 6 i + 5 are force (x, y, z) and torque (x, y, z) of the i-th
    free item; column ``sides`` k + s is the s-th edge of contact k.

    Attributes:
        start: (columns + 1,) int32 where each column begins in ``index`` and ``value``.
        index: int32 row of each entry.
        value: entries, without unit.
        rhs: (6 n,) b, without unit.
        edges: (k, sides, 3) of the pyramids, normal component 1.
        units: (k,) force that a column's x is measured in, N.
        contacts: the contacts, as given.
        weights: (n,) of the free items, N.
        coms: (n, 3) of the free items, m.
        free: (n,) body numbers of the items whose balance is asked; all others are held, as the container is.
        mu: (k,) coefficient of friction of each contact.
        gravity: (3,) m/s², nominal: it fixes weights and pyramids. ``rhs`` is what is to be balanced.
        length: m, that torques are measured by.
        tolerance: largest residual of a row that counts as balanced.
    """

    start: NDArray[np.int32]
    index: NDArray[np.int32]
    value: FloatArray
    rhs: FloatArray
    edges: FloatArray
    units: FloatArray
    contacts: Contacts
    weights: FloatArray
    coms: FloatArray
    free: IntArray
    mu: FloatArray
    gravity: FloatArray
    length: float = LENGTH
    tolerance: float = TOLERANCE

    @property
    def n_rows(self) -> int:
        """Rows of A: six for each free item."""
        return len(self.rhs)

    @property
    def n_columns(self) -> int:
        """Columns of A: one for each edge of each pyramid."""
        return len(self.start) - 1

    @property
    def sides(self) -> int:
        """Edges of each pyramid."""
        return int(self.edges.shape[1])

    @cached_property
    def matrix(self) -> csc_matrix:
        """A, (6 n, k · sides), as a SciPy sparse matrix."""
        from scipy.sparse import csc_matrix

        return csc_matrix((self.value, self.index, self.start), shape=(self.n_rows, self.n_columns))

    @cached_property
    def dense(self) -> FloatArray:
        """A as a dense array."""
        dense = np.zeros((self.n_rows, self.n_columns))
        dense[self.index, np.repeat(np.arange(self.n_columns), np.diff(self.start))] = self.value
        return dense

    @property
    def up(self) -> FloatArray:
        """(3,) unit vector against nominal gravity."""
        up: FloatArray = -self.gravity / np.linalg.norm(self.gravity)
        return up

    def tilted(self, tilt: FloatArray, aside: float = 0.0) -> Equilibrium:
        """The same pile and the same pyramids with a horizontal pull added to gravity.

        Equilibrium does not depend on the size of gravity, so this is the pile on a tilted table.

        Args:
            tilt: (3,) pull in units of gravity; ``tan(angle)`` times a horizontal unit vector.
            aside: how far centres of mass are off in the direction of the pull, m.
        """
        rhs = self.rhs.copy().reshape(-1, 6)
        rhs[:, :3] -= tilt
        rhs[:, 3:] += off_centre(self.up, tilt[None], aside) / self.length
        return replace(self, rhs=rhs.ravel())

    def with_rhs(self, rhs: FloatArray) -> Equilibrium:
        """The same columns with another right-hand side, (6 n,): what the forces have to balance."""
        return replace(self, rhs=rhs)

    def forces(self, x: FloatArray) -> FloatArray:
        """Contact forces of a solution: (k, 3) N, on the contact's second body."""
        scaled = x.reshape(self.edges.shape[:2]) * self.units[:, None]
        forces: FloatArray = np.einsum("ks,ksj->kj", scaled, self.edges)
        return forces

    def balanced(self, x: FloatArray) -> bool:
        """True where ``x`` proves stability: no negative entry, and every row within the tolerance."""
        if not (np.isfinite(x).all() and (x >= 0.0).all()):
            return False
        return bool(np.abs(self._apply(x) - self.rhs).max(initial=0.0) <= self.tolerance * (1.0 + 1e-3))

    def refuted_by(self, ray: FloatArray) -> bool:
        """True where ``ray`` proves instability (Farkas' lemma).

        A ray y is a small motion of the items. If no contact force can do work against it (Aᵀ y ≤ 0) while
        gravity drives it (bᵀ y > 0), the pile moves. The tolerance of the rows is allowed for, and so are
        rounding errors of Aᵀ y, up to forces of ten thousand weights.

        Args:
            ray: (6 n,) y, in the units of the rows.
        """
        size = np.abs(ray).sum()
        if not np.isfinite(size) or size == 0.0:
            return False
        ray = ray / size
        gap = float(self.rhs @ ray) - self.tolerance
        worst = float(self.work(ray).max(initial=0.0))
        return gap > 0.0 and worst * _PROOF_FORCE <= gap

    def columns(self, which: IntArray) -> tuple[NDArray[np.int32], NDArray[np.int32], FloatArray]:
        """Some columns of A: where each begins, rows, entries, as ``start``, ``index`` and ``value``."""
        lengths = self.start[which + 1] - self.start[which]
        start = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
        entry = np.arange(start[-1]) + np.repeat(self.start[which] - start[:-1], lengths)
        return start, self.index[entry], self.value[entry]

    def _apply(self, x: FloatArray) -> FloatArray:
        """A x."""
        columns = np.repeat(x, np.diff(self.start))
        product: FloatArray = np.bincount(
            self.index, weights=self.value * columns, minlength=self.n_rows
        ).astype(np.float64)
        return product

    def work(self, y: FloatArray) -> FloatArray:
        """Aᵀ y: the work of each edge's force against a motion; no column is empty."""
        if not self.n_columns:
            return np.empty(0)
        sums: FloatArray = np.add.reduceat(self.value * y[self.index], self.start[:-1])
        return sums


def build_equilibrium(
    contacts: Contacts,
    masses: ArrayLike,
    coms: ArrayLike,
    *,
    mu: FloatArray | float = 0.7,
    sides: int = 8,
    gravity: ArrayLike = GRAVITY,
    free: ArrayLike | None = None,
    length: float = LENGTH,
    tolerance: float = TOLERANCE,
) -> Equilibrium:
    """Force and torque balance of every item (paper Sec. III-A, eqs. 1 and 2).

    Args:
        contacts: of the pile; ``normals`` point into ``second``.
        masses: (n,) of items 1 to n, kg.
        coms: (n, 3) their centres of mass, container frame, m.
        mu: friction coefficient of all contacts, or (k,) of each.
        sides: edges of each friction pyramid, at least 3. It is inscribed in the cone ‖f_t‖ ≤ μ f_n (paper eq. 4, made
            linear), so its "stable" is also the cone's; its first edge points uphill (:func:`tangents`).
        gravity: (3,) m/s².
        free: body numbers of the items whose balance is asked; the others are held as the container is, and
            their contacts with each other are left out. All items where None.
        length: that torques are measured by, m.
        tolerance: largest residual of a row that counts as balanced.

    Returns:
        The linear conditions. Contacts between two held bodies are not in it.

    Raises:
        ValueError: a mass is not positive, gravity is zero, ``mu`` is negative or not finite, ``sides`` is below
            3, or a contact names a body that does not exist.
    """
    mass = np.asarray(masses, dtype=np.float64).reshape(-1)
    com = np.asarray(coms, dtype=np.float64).reshape(-1, 3)
    pull = np.asarray(gravity, dtype=np.float64)
    g = float(np.linalg.norm(pull))
    n = len(mass)
    _check(contacts, mass, com, g)

    bodies = np.arange(1, n + 1) if free is None else np.asarray(free, dtype=np.int64).reshape(-1)
    slot = np.full(n + 1, -1, dtype=np.int64)
    slot[bodies] = np.arange(len(bodies))
    if free is not None:
        asked = (slot[contacts.first] >= 0) | (slot[contacts.second] >= 0)
        if not asked.all():
            contacts = contacts.take(asked)
            if isinstance(mu, np.ndarray):
                mu = mu[asked]

    weight = np.concatenate([[np.inf], mass * g])
    held = weight.copy()
    held[slot < 0] = np.inf
    units = np.minimum(held[contacts.first], held[contacts.second])
    coefficients = np.empty(len(contacts))
    coefficients[:] = mu
    _check_friction(mu, sides)
    up, level = _upward(pull)
    room = len(contacts) * sides
    edges = np.empty((len(contacts), sides, 3))
    start, index = np.empty(room + 1, dtype=np.int32), np.empty(12 * room, dtype=np.int32)
    value = np.empty(12 * room)
    entries = fill_columns(
        contacts.points,
        contacts.normals,
        contacts.first,
        contacts.second,
        slot,
        units,
        weight,
        np.concatenate([np.zeros((1, 3)), com]),
        length,
        coefficients,
        up,
        level,
        _wheel(sides),
        edges,
        start,
        index,
        value,
    )
    index, value = index[:entries], value[:entries]

    rhs = np.zeros((len(bodies), 6))
    rhs[:, :3] = -pull / g
    return Equilibrium(
        start=start,
        index=index,
        value=value,
        rhs=rhs.ravel(),
        edges=edges,
        units=units,
        contacts=contacts,
        weights=weight[bodies],
        coms=com[bodies - 1],
        free=bodies,
        mu=coefficients,
        gravity=pull,
        length=length,
        tolerance=tolerance,
    )


def falls_alone(
    contacts: Contacts,
    com: FloatArray,
    body: int,
    tilts: FloatArray,
    *,
    aside: float = 0.0,
    mu: FloatArray | float = 0.7,
    sides: int = 8,
    gravity: ArrayLike = GRAVITY,
    length: float = LENGTH,
    tolerance: float = TOLERANCE,
) -> FloatArray | None:
    """A motion that proves that one item falls under one of several tilts, everything else held.

    It is what least squares of :func:`build_equilibrium` leaves, put to the test of :meth:`Equilibrium.refuted_by`,
    all in one kernel: most candidates of a plan are refuted here.

    Args:
        contacts: all those of the item, and no others.
        com: (3,) its centre of mass, m.
        body: its number.
        tilts: (d, 3) horizontal pulls in units of gravity, the most likely to refute it first.
        aside: how far its centre of mass is off in the direction of the pull, m.
        mu: as in :func:`build_equilibrium`.
        sides: likewise.
        gravity: likewise.
        length: likewise.
        tolerance: likewise.

    Returns:
        (6,) the motion in row units, summing to 1 in size; None where none is found.
    """
    pull = np.asarray(gravity, dtype=np.float64)
    up, level = _upward(pull)
    loads = np.zeros((len(tilts), 6))
    loads[:, :3] = up - tilts
    loads[:, 3:] = off_centre(up, tilts, aside) / length
    coefficients = np.empty(len(contacts))
    coefficients[:] = mu
    motion = np.empty(6)
    refuted = first_refuted(
        contacts.points,
        contacts.normals,
        contacts.second == body,
        com,
        length,
        coefficients,
        up,
        level,
        _wheel(sides),
        loads,
        tolerance,
        _PROOF_FORCE,
        motion,
    )
    return motion if refuted >= 0 else None


def off_centre(up: FloatArray, tilts: FloatArray, aside: float) -> FloatArray:
    """(d, 3) m, torques per weight of what carries an item whose centre of mass is off the way of each pull.

    Args:
        up: (3,) unit vector against gravity.
        tilts: (d, 3) horizontal pulls in units of gravity; one of none moves nothing.
        aside: how far it is off, m.
    """
    if not aside:
        return np.zeros_like(tilts)
    sizes = np.linalg.norm(tilts, axis=1, keepdims=True)
    ways = tilts / np.where(sizes == 0.0, 1.0, sizes)
    return _cross(aside * ways, up - tilts)


def _upward(gravity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(3,) against gravity, unit, and the (3,) axis that the first tangent of a level contact follows."""
    up = -gravity / np.linalg.norm(gravity)
    level = np.zeros(3)
    level[int(np.argmin(np.abs(up)))] = 1.0
    return up, level


@lru_cache(maxsize=16)
def _wheel(sides: int) -> FloatArray:
    """(sides, 2) cosine and sine of each edge's angle."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    return np.column_stack([np.cos(angles), np.sin(angles)])


def residuals(
    contacts: Contacts,
    forces: FloatArray,
    masses: ArrayLike,
    coms: ArrayLike,
    *,
    gravity: ArrayLike = GRAVITY,
    length: float = LENGTH,
) -> FloatArray:
    """What given forces leave unbalanced (paper eqs. 1 and 2), without any matrix.

    Args:
        contacts: of the pile.
        forces: (k, 3) N, on each contact's second body.
        masses: (n,) kg.
        coms: (n, 3) m.
        gravity: (3,) m/s².
        length: that torques are measured by, m.

    Returns:
        (n, 6) force over weight and torque over weight × length of each item.
    """
    mass = np.asarray(masses, dtype=np.float64).reshape(-1)
    com = np.asarray(coms, dtype=np.float64).reshape(-1, 3)
    pull = np.asarray(gravity, dtype=np.float64)
    n = len(mass)
    total = np.zeros((n + 1, 6))
    total[1:, :3] = mass[:, None] * pull
    centre = np.concatenate([np.zeros((1, 3)), com])
    add_wrenches(contacts.points, forces, contacts.first, contacts.second, centre, length, total)
    out: FloatArray = total[1:] / (mass * np.linalg.norm(pull))[:, None]
    return out


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product over the last axis; written out, since np.cross costs as much as the whole matrix."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def _check_friction(mu: FloatArray | float, sides: int) -> None:
    """Refuse what is no friction pyramid."""
    for one in (mu,) if isinstance(mu, float | int) else (mu.min(initial=0.0), mu.max(initial=0.0)):
        if not 0.0 <= one < np.inf:
            raise ValueError(f"friction coefficient {one:g}: give a finite number, 0 or more")
    if sides < 3:
        raise ValueError(f"friction pyramid of {sides} sides: give 3 or more")


def _check(contacts: Contacts, mass: FloatArray, com: FloatArray, g: float) -> None:
    """Refuse what would make a wrong matrix in silence."""
    if len(com) != len(mass):
        raise ValueError(f"{len(mass)} masses but {len(com)} centres of mass")
    if not (np.isfinite(mass).all() and (mass > 0.0).all()):
        raise ValueError("every mass must be finite and above 0 kg")
    if not (np.isfinite(g) and g > 0.0):
        raise ValueError("gravity must be finite and not zero")
    if len(contacts):
        if not (np.isfinite(contacts.points).all() and np.isfinite(contacts.normals).all()):
            raise ValueError("contact points and normals must be finite")
        if int(contacts.first.min()) < 0 or int(contacts.second.min()) < 0:
            raise ValueError("contact bodies are numbered from 0, the container")
        if max(int(contacts.first.max()), int(contacts.second.max())) > len(mass):
            raise ValueError(f"a contact names a body above {len(mass)}, the number of items")
        if (contacts.first == contacts.second).any():
            raise ValueError("a contact needs two different bodies")
