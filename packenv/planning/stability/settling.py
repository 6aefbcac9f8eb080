"""Whether gravity presses an item to where it stands, or only its contacts press against each other.

Balance (:mod:`packenv.planning.stability.equilibrium`) asks whether *some* forces carry a pile. Two facing
contacts may then press against each other without limit (prestress), and friction on them carries an item
that hangs between a wall and a bottle. No such force comes about when the item is put there and let go.

**The model.** The item is let go without speed and without any force on it; all other items are held, as they
stood before it came. Its contacts are springs of one stiffness that push and never pull, and behind their
friction, sideways, springs of the same stiffness (Coulomb: at most μ times the push). The item moves by

    v = load + Σ forces(v),    load = gravity + tilt,

the motion of one step in units of the step's free fall, turns measured at :data:`LENGTH` from the centre of
mass: v = gravity is free fall, and a force of one weight on a contact gives it way by 1 / ``STIFFNESS``. The
solution is the one that is reached *from no forces*: first without friction, then with bounds on friction
that follow the pushes (each by a share ``_FOLLOWING``, so pushes come before the friction on them). The item
*settles* where what is left of its motion is at most ``SETTLED``: ten times what one weight on one contact
gives way by. Where it hangs between two facing walls, no push ever begins, at any friction; where it is wedged
so steeply that only ten weights and more on a contact hold it, it slips.

What settles with little friction settles with more, by definition: a coefficient counts as all steps of
``_STEP`` up to it, and the item settles if it does so at one of them. Where contacts differ, each has its own or the
step, whichever is less: so this holds for more friction of the item itself and of everything at once, while more of
one neighbour alone unsettles it in 6 of 10,000 cases (docs/decisions.md). The thresholds of sliding themselves are
exact all the same, for balance is asked too. Items are taken one by one, in the sequence in which they come: a
keystone that holds up what would fall without it never finds that there.

Source: Coulomb friction has several solutions (Pang and Trinkle 2000, "Stability characterizations of rigid
body contact problems with Coulomb friction"); balance is their *weak stability*, "no force is at hand, so it
falls" the opposite choice.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.equilibrium import LENGTH
from packenv.planning.stability.margins import Margin, MarginRule
from packenv.planning.stability.settling_kernels import fill_rows, settle
from packenv.types import Contacts, FloatArray

STIFFNESS = 1000.0
"""Of a contact: weights over the item's free fall. Ten times more or less tells as well (docs/decisions.md)."""

SETTLED = 0.01
"""Largest motion, in units of free fall, that is left of an item that settles."""

_STEP = 0.05
"""Friction coefficients are looked at in these steps."""

_FOLLOWING = 0.3
"""Share by which a bound on friction follows the push in each iteration. At 1 one pile in fifty cycles."""

_ACCURACY = 0.1
"""Motion is found to this share of what one weight gives way by."""

_ITERATIONS = 200
"""Most of them; one in a hundred items, those on the edge of sliding, takes more than 50."""

_TRUSTED = 0.98
"""A tilt from force balance is confirmed at this share of it: at the very edge nothing ever stops."""

_HALVINGS = 6
"""Of a tilt that is not confirmed: to a degree."""


def contact_rows(contacts: Contacts, com: ArrayLike, new: int) -> FloatArray:
    """What a unit force at each contact does to one item.

    Args:
        contacts: of the item; contacts of others are left out.
        com: (3,) its centre of mass, m.
        new: its body.

    Returns:
        (k, 3, 6) force and torque over :data:`LENGTH`, of a push along the normal into the item and of forces
        along two tangents.
    """
    rows = np.empty((len(contacts), 3, 6))
    centre = np.asarray(com, dtype=np.float64)
    count = fill_rows(
        contacts.points, contacts.normals, contacts.first, contacts.second, new, centre, LENGTH, rows
    )
    return rows[:count]


def settles(
    checker: StabilityChecker,
    contacts: Contacts,
    com: ArrayLike,
    new: int,
    rule: MarginRule | None = None,
) -> bool:
    """Does an item stay where it is let go, all others held? See the head of this file.

    Args:
        checker: friction and gravity.
        contacts: of the item, or of the whole pile.
        com: (3,) centre of mass of the item, m.
        new: the item's body.
        rule: ask for a margin: with the rule's friction it must settle under each of its tilts, and move by half.
    """
    if rule is None:
        return _settles(checker, contacts, com, new, np.zeros((1, 3)), SETTLED)
    weak = rule.weakened(checker)
    return _settles(weak, contacts, com, new, rule.pulls(checker.gravity), SETTLED / 2.0)


def settles_with(
    checker: StabilityChecker, contacts: Contacts, com: ArrayLike, new: int, rule: MarginRule | None
) -> bool:
    """Does an item settle, and with the rule's margin too where there is a rule? As :func:`settles`."""
    return settles(checker, contacts, com, new) and (
        rule is None or settles(checker, contacts, com, new, rule)
    )


def _settles(
    checker: StabilityChecker,
    contacts: Contacts,
    com: ArrayLike,
    new: int,
    tilts: FloatArray,
    most: float,
) -> bool:
    """Under each of the horizontal pulls ``tilts``, (d, 3), in units of gravity."""
    gravity = np.asarray(checker.gravity, dtype=np.float64)
    down = gravity / np.linalg.norm(gravity)
    rows = contact_rows(contacts, com, new)
    loads = np.zeros((len(tilts), 6))
    loads[:, :3] = down + tilts
    counted = checker.coefficients(contacts)
    if isinstance(counted, float):
        top = math.ceil(counted / _STEP - 1e-9)
        mu = np.full(len(rows), top * _STEP)
    else:
        own = (contacts.first == new) | (contacts.second == new)
        steps = np.ceil(counted[own] / _STEP - 1e-9)
        top, mu = int(steps.max(initial=0.0)), steps * _STEP
    return all(_rests(rows, load, mu, top, most) for load in loads)


def _rests(rows: FloatArray, load: FloatArray, mu: FloatArray, top: int, most: float) -> bool:
    """Whether it does with these coefficients, the largest of which is ``top`` steps, or with less."""
    motion = np.empty(6)
    for cap in range(top, -1, -1):
        lower = mu if cap == top else np.minimum(mu, cap * _STEP)
        settle(rows, load, lower, STIFFNESS, _FOLLOWING, _ACCURACY / STIFFNESS, _ITERATIONS, motion)
        if np.abs(motion).max() <= most:
            return True
    return False


def settled_tilt(
    checker: StabilityChecker, contacts: Contacts, com: ArrayLike, new: int, margin: Margin
) -> float:
    """The tilt of gravity up to which balance holds and an item settles, degrees.

    Args:
        checker: friction and gravity.
        contacts: of the item, or of the whole pile.
        com: (3,) centre of mass of the item, m.
        new: the item's body.
        margin: what force balance says.

    Returns:
        The least over the margin's directions; 0 where the item does not settle without tilt.
    """
    if not margin.stable or not settles(checker, contacts, com, new):
        return 0.0
    least = margin.tilt_deg
    for direction, tilt in zip(margin.directions, margin.tilts_deg.tolist(), strict=True):
        high = min(tilt, least)

        def stays(degrees: float, way: FloatArray = direction) -> bool:
            pull = math.tan(math.radians(degrees)) * way
            return _settles(checker, contacts, com, new, pull[None], SETTLED)

        if stays(_TRUSTED * high):
            continue
        low = 0.0
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            low, high = (middle, high) if stays(middle) else (low, middle)
        least = min(least, low)
    return least
