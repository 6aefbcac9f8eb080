"""Compiled part of settling: one item on springs with Coulomb friction."""

from __future__ import annotations

import math

import numpy as np

from packenv.geometry.distance_kernels import compiled

_SOFT = 10.0
"""Stiffness that the search for the pushes begins with; it then grows by as much each time."""

_ROUNDS = 40
"""Iterations after which the pushes without friction are taken as they are."""


@compiled
def settle(rows, load, mu, stiffness, following, accuracy, most, motion):  # type: ignore[no-untyped-def]
    """The motion that is left of an item that is let go on its contacts, from no forces.

    Each iteration solves 6 equations: contacts that are pressed act as springs; friction as a spring that is
    the weaker, the faster the contact slides, so that it holds by as much as its bound.

    Args:
        rows: (k, 3, 6) wrench of a unit push and of unit forces along two tangents.
        load: (6,) what drives the item; its motion without contacts.
        mu: friction coefficient.
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
    speed = np.empty(3)
    spring = np.empty(3)
    stiff = min(_SOFT, stiffness)
    rubbing = False
    motion[:] = load
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
                bound[i] += following * (mu * push - bound[i])
                slide = math.sqrt(speed[1] ** 2 + speed[2] ** 2)
                spring[1] = stiff if slide * stiff <= bound[i] else bound[i] / slide
            spring[2] = spring[1]
            for d in range(3):
                if spring[d] > 0.0:
                    for a in range(6):
                        for b in range(6):
                            matrix[a, b] += spring[d] * rows[i, d, a] * rows[i, d, b]
        moved = np.linalg.solve(matrix, load)
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
