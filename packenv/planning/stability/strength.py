"""What the piles of a packing sequence withstand: the largest tilt, and the largest push on any item.

Both are linear programs over the contact forces of the whole pile, every item free to move, with all the friction
that there is: the most of a horizontal load that leaves the pile in balance, in the worst of eight directions.

Items that do not touch each other, neither straight nor by way of others, know nothing of each other. So a new item
asks only for those that it is joined with; for all others the figures of the step before hold.
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
from packenv.types import Contacts

MOST = 1.0
"""Horizontal loads beyond this, in weights, are not told apart: a tilt of 45°, a push of the item's weight."""


@dataclass(frozen=True)
class Strength:
    """What a pile withstands.

    Attributes:
        tilt_deg: gravity may be tilted by this in the worst direction; 0 where the pile does not stand, 45 also
            where it withstands more.
        push: sideways force on the centre of mass of any one item, in its weights; 0 and 1 likewise.
    """

    tilt_deg: float
    push: float


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
    groups: list[tuple[frozenset[int], tuple[float, float]]] = []
    strengths = []
    for new, own in enumerate(found, start=1):
        touched = {*own.first.tolist(), *own.second.tolist()} - {0, new}
        apart = [group for group in groups if not group[0] & touched]
        joined = frozenset({new}.union(*(group[0] for group in groups if group[0] & touched)))
        free = np.array(sorted(joined))
        eq = checker.build(join([found[body - 1] for body in free.tolist()]), masses, coms, free)
        groups = [*apart, (joined, _withstood(eq))]
        pull, push = (min(kind) for kind in zip(*(loads for _, loads in groups), strict=True))
        strengths.append(Strength(math.degrees(math.atan(pull)), push))
    return tuple(strengths)


def _withstood(eq: Equilibrium) -> tuple[float, float]:
    """The least pull on all items together and the least push on one, in weights, over all directions.

    What withstands as much as the worst so far is not followed further. The newest items come first: they are
    mostly the weakest.
    """
    untilted = solve_highs(eq)
    if untilted.status != "stable":
        return 0.0, 0.0
    program = LoadProgram(eq, untilted.basis)
    items, directions = len(eq.free), tilt_directions(eq.gravity)
    pull = push = MOST
    for direction in directions:
        pull = program.largest(level_load(items, range(items), direction), pull)
    for item in reversed(range(items)):
        for direction in directions:
            push = program.largest(level_load(items, [item], direction), push)
    return pull, push
