"""What the piles of a packing sequence withstand: the largest tilt, and the largest push on the newest item.

Both are linear programs over the contact forces of the whole pile, every item free to move, with all the friction
that there is: the most of a horizontal load that leaves the pile in balance, in the worst of eight directions.

Items that do not touch each other, neither straight nor by way of others, know nothing of each other. So a new item
asks only for those that it is joined with; for all others the tilt of the step before holds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contacts import join
from packenv.planning.stability.equilibrium import Equilibrium
from packenv.planning.stability.margins import LoadProgram, level_load, tilt_directions
from packenv.planning.stability.solvers import solve_highs
from packenv.types import Contacts, IntArray

MOST = 1.0
"""Horizontal loads beyond this, in weights, are not told apart: a tilt of 45°, a push of the item's weight."""


@dataclass(frozen=True)
class Strength:
    """What a pile withstands.

    Attributes:
        tilt_deg: gravity may be tilted by this in the worst direction; 0 where the pile does not stand, 45 also
            where it withstands more.
        push: sideways force on the centre of mass of the newest item, in its weights; 0 and 1 likewise.
    """

    tilt_deg: float
    push: float


@dataclass(frozen=True, eq=False)
class _Group:
    """Items that are joined by contacts.

    Attributes:
        bodies: of the items.
        stands: whether they are in balance.
        pull: that leaves them in balance in the worst direction, in weights; 0 where they are not.
        columns: of their equilibrium that mattered for it.
    """

    bodies: frozenset[int]
    stands: bool
    pull: float
    columns: IntArray


def measure_strength(
    checker: StabilityChecker, found: Sequence[Contacts], masses: ArrayLike, coms: ArrayLike
) -> tuple[Strength, ...]:
    """The strength of every pile of a sequence.

    Args:
        checker: friction and solvers.
        found: contacts of each item with the container and the items before it.
        masses: (n,) kg.
        coms: (n, 3) m.

    Returns:
        One for each item, of the pile with it on top.
    """
    groups: list[_Group] = []
    strengths = []
    for new, own in enumerate(found, start=1):
        touched = {*own.first.tolist(), *own.second.tolist()} - {0, new}
        beneath = [group for group in groups if group.bodies & touched]
        free = np.array(sorted({new}.union(*(group.bodies for group in beneath))))
        eq = checker.build(join([found[body - 1] for body in free.tolist()]), masses, coms, free)
        joined, push = _withstood(eq, beneath)
        groups = [*(group for group in groups if group not in beneath), joined]
        least = min(group.pull for group in groups)
        stands = all(group.stands for group in groups)
        strengths.append(Strength(math.degrees(math.atan(least)), push if stands else 0.0))
    return tuple(strengths)


def _withstood(eq: Equilibrium, beneath: Sequence[_Group]) -> tuple[_Group, float]:
    """The least pull on all items together and the least push on the last one, in weights, over all directions.

    What withstands as much as the worst direction so far is not followed further.

    Args:
        eq: the newest item and all that it is joined with.
        beneath: the groups that it joins.
    """
    bodies = frozenset(eq.free.tolist())
    untilted = solve_highs(eq)
    if untilted.status != "stable":
        return _Group(bodies, False, 0.0, untilted.basis), 0.0
    # On one group the newest item only adds columns, behind those that were there.
    known = beneath[0].columns if len(beneath) == 1 else untilted.basis
    program = LoadProgram(eq, np.union1d(known, untilted.basis))
    items, directions = len(eq.free), tilt_directions(eq.gravity)
    pull = push = MOST
    for direction in directions:
        pull = program.largest(level_load(items, range(items), direction), pull)
    for direction in directions:
        push = program.largest(level_load(items, [items - 1], direction), push)
    return _Group(bodies, True, pull, program.columns), push
