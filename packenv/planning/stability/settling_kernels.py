"""Compiled parts of settling: one item on springs with Coulomb friction."""

from __future__ import annotations

import math

import numpy as np

from packenv.kernels import compiled

_SOFT = 10.0
"""Stiffness that the search for the pushes begins with; it then grows by as much each time."""

_ROUNDS = 40
"""Iterations after which the pushes without friction are taken as they are."""


@compiled
def fill_rows(points, normals, first, second, new, com, length, rows):  # type: ignore[no-untyped-def]
    """Wrenches of unit forces at the contacts of one item, one along the normal and two across it.

    Args:
        points: (k, 3) contacts, m.
        normals: (k, 3) unit, into ``second``.
        first: (k,) bodies.
        second: (k,) bodies.
        new: the item's body.
        com: (3,) its centre of mass, m.
        length: that torques are measured by, m.
        rows: (k, 3, 6) filled from the front.

    Returns:
        number of its contacts.
    """
    count = 0
    for k in range(len(points)):
        if first[k] != new and second[k] != new:
            continue
        row = rows[count]
        axis = np.argmin(np.abs(normals[k]))
        size = math.sqrt(1.0 - normals[k, axis] ** 2)
        for a in range(3):
            row[0, a] = normals[k, a] if second[k] == new else -normals[k, a]
            row[1, a] = ((1.0 if a == axis else 0.0) - normals[k, axis] * normals[k, a]) / size
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            row[2, a] = row[0, b] * row[1, c] - row[0, c] * row[1, b]
        for d in range(3):
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                arm_b, arm_c = (points[k, b] - com[b]) / length, (points[k, c] - com[c]) / length
                row[d, 3 + a] = arm_b * row[d, c] - arm_c * row[d, b]
        count += 1
    return count


@compiled
def settle(rows, load, mu, stiffness, following, accuracy, most, motion):  # type: ignore[no-untyped-def]
    """The motion that is left of an item that is let go on its contacts, from no forces.

    Each iteration solves 6 equations: contacts that are pressed act as springs; friction as a spring that is
    the weaker, the faster the contact slides, so that it holds by as much as its bound.

    Args:
        rows: (k, 3, 6) wrench of a unit push and of unit forces along two tangents.
        load: (6,) what drives the item; its motion without contacts.
        mu: (k,) coefficient of friction of each contact.
        stiffness: of every contact, in push and in friction.
        following: share by which each bound on friction follows its push.
        accuracy: change of the motion at which it is found.
        most: iterations.
        motion: (6,) filled.
    """
    k = len(rows)
    pressed = np.zeros(k, dtype=np.bool_)
    bound = np.zeros(k)
    matrix = np.empty((6, 6))
    moved = np.empty(6)
    speed = np.empty(3)
    spring = np.empty(3)
    stiff = min(_SOFT, stiffness)
    rubbing = False
    for a in range(6):
        motion[a] = load[a]
    for iteration in range(most):
        matrix[:] = 0.0
        for a in range(6):
            matrix[a, a] = 1.0
        changed = False
        for i in range(k):
            for d in range(3):
                speed[d] = 0.0
                for a in range(6):
                    speed[d] += rows[i, d, a] * motion[a]
            now = speed[0] < 0.0
            changed = changed or now != pressed[i]
            pressed[i] = now
            spring[0] = stiff if now else 0.0
            spring[1] = 0.0
            if rubbing:
                push = -stiff * speed[0] if now else 0.0
                bound[i] += following * (mu[i] * push - bound[i])
                slide = math.sqrt(speed[1] ** 2 + speed[2] ** 2)
                spring[1] = stiff if slide * stiff <= bound[i] else bound[i] / slide
            spring[2] = spring[1]
            for d in range(3):
                if spring[d] > 0.0:
                    for a in range(6):
                        for b in range(6):
                            matrix[a, b] += spring[d] * rows[i, d, a] * rows[i, d, b]
        _solve(matrix, load, moved)
        change = 0.0
        for a in range(6):
            change = max(change, abs(moved[a] - motion[a]))
            motion[a] = moved[a]
        if rubbing:
            if change < accuracy:
                break
        elif (iteration and not changed) or iteration > _ROUNDS:
            if stiff < stiffness:
                stiff = min(_SOFT * stiff, stiffness)
            else:
                rubbing = True


@compiled
def _solve(matrix, load, found):  # type: ignore[no-untyped-def]
    """Solve symmetric, positive definite equations by Cholesky's factors, which overwrite the lower triangle."""
    n = len(load)
    for a in range(n):
        for b in range(a + 1):
            rest = matrix[a, b]
            for c in range(b):
                rest -= matrix[a, c] * matrix[b, c]
            matrix[a, b] = rest / matrix[b, b] if b < a else math.sqrt(rest)
        rest = load[a]
        for c in range(a):
            rest -= matrix[a, c] * found[c]
        found[a] = rest / matrix[a, a]
    for a in range(n - 1, -1, -1):
        for c in range(a + 1, n):
            found[a] -= matrix[c, a] * found[c]
        found[a] /= matrix[a, a]
