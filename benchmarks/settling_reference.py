"""The reference for settling, by CVXPY: a chain of convex problems instead of one iteration of springs.

With its bounds on friction given, an item on springs moves so that an energy is least: |v − load|² / 2, of
each push K min(0, n v)² / 2, and of friction a Huber function whose slope ends at the bound. The bounds
then follow the pushes, from none, until nothing changes. It shares the model's constants with
:mod:`packenv.planning.stability.settling`, and no equation.
"""

from __future__ import annotations

import importlib
import warnings
from typing import Any

import numpy as np

from packenv.planning.stability.equilibrium import LENGTH
from packenv.planning.stability.settling import STIFFNESS
from packenv.types import Contacts, FloatArray

_FOLLOWING = 0.5
"""Share by which bounds follow: where there are several solutions, the way decides."""
_ROUNDS = 60
_ACCURACY = 1e-3
"""Of the bounds, in weights."""


def reference_motion(contacts: Contacts, com: FloatArray, new: int, mu: float) -> FloatArray:
    """(6,) the motion that is left of an item that is let go, in units of free fall.

    Args:
        contacts: of the item alone, at least one.
        com: (3,) its centre of mass, m.
        new: its body.
        mu: friction coefficient.
    """
    cp: Any = importlib.import_module("cvxpy")  # partly annotated
    k = len(contacts)
    into = contacts.normals * np.where(contacts.second == new, 1.0, -1.0)[:, None]
    arms = (contacts.points - com) / LENGTH
    at = np.zeros((k, 3, 6))
    at[:, :, :3] = np.eye(3)
    for i, (x, y, z) in enumerate(arms):
        at[i, :, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    along = np.einsum("ki,kij->kj", into, at)
    across = at - into[:, :, None] * along[:, None]
    # In K v, which is forces in weights, every term is of the same size.
    u, load = cp.Variable(6), np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
    spring = cp.Variable((k, 3))  # Huber: what the spring takes; the rest slides at the bound
    bound = cp.Parameter(k, nonneg=True)
    push = cp.neg(along @ u)
    slid = cp.vstack([part @ u for part in across]) - spring
    energy = cp.sum_squares(u) / (2.0 * STIFFNESS) - load @ u
    energy += cp.sum_squares(push) / 2 + cp.sum_squares(spring) / 2 + bound @ cp.norm(slid, axis=1)
    problem = cp.Problem(cp.Minimize(energy))
    bound.value = np.zeros(k)
    for _ in range(_ROUNDS):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "inaccurate" is said of 1e-8, and 1e-3 is asked here
            problem.solve(solver="CLARABEL")
        wanted = mu * push.value
        if np.abs(wanted - bound.value).max() < _ACCURACY:
            break
        bound.value = bound.value + _FOLLOWING * (wanted - bound.value)
    motion: FloatArray = np.asarray(u.value) / STIFFNESS
    return motion
