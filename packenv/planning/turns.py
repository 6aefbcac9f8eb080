"""Whose turn it is: which candidates are put to the constraints, and in which sequence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from packenv.planning.candidates import Candidates
from packenv.planning.constraints import Constraint, Verdict
from packenv.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Tier:
    """One level of care in choosing among an item's candidates.

    Attributes:
        clearance: cells by which the item may be off sideways at the release and still meet nothing.
        constraints: asked in place of the planner's, one for each and on the same states; None asks those.
        max_checked: as the planner's, in its place; None takes that.
        each: most candidates of one orientation: the best of a heuristic are mostly neighbours of each other,
            and one failure there tells of the rest. None takes them as they come.
        risk: how bad such a placement is, on a scale of the caller's; above 0 it is makeshift: better than
            nothing, but a restart with such items first is worth trying.
    """

    clearance: int = 0
    constraints: Sequence[Constraint] | None = None
    max_checked: int | None = None
    each: int | None = None
    risk: float = 0.0


def in_tier(
    candidates: Candidates, scores: FloatArray, tier: Tier, most: int, free: IntArray
) -> Sequence[int]:
    """Indices of the candidates that a tier has checked, best first.

    Args:
        candidates: the legal ones.
        scores: theirs.
        tier: how many of them at one orientation.
        most: of them altogether.
        free: indices of those that no earlier tier's answer rules out.
    """
    if not len(free):
        return []
    if tier.each is None:
        return [int(k) for k in free[ranked(scores[free], most)]]
    left = free[np.argsort(scores[free], kind="stable")]
    grids = candidates.grid_index[left]
    # The place of each candidate among those of its orientation.
    by_grid = np.argsort(grids, kind="stable")
    starts = np.searchsorted(grids[by_grid], grids[by_grid])
    place = np.empty(len(left), dtype=np.int64)
    place[by_grid] = np.arange(len(left)) - starts
    return [int(k) for k in left[place < tier.each][:most]]


def ranked(scores: FloatArray, most: int) -> IntArray:
    """Indices of the ``most`` best candidates, best first; equal scores keep the candidates' order."""
    if most == 1:
        return np.array([np.argmin(scores)])
    n = min(most, len(scores))
    bound = np.partition(scores, n - 1)[n - 1]
    best = np.flatnonzero(scores <= bound)
    order: IntArray = best[np.argsort(scores[best], kind="stable")][:n]
    return order


def still_open(
    candidates: Candidates,
    constraints: Sequence[Constraint],
    known: Mapping[tuple[int, int, int, int], Verdict],
) -> IntArray:
    """Indices of the candidates that none of the constraints has refused yet, ascending."""
    asked = {id(constraint) for constraint in constraints}
    number = {id(grid.oriented): k for k, grid in enumerate(candidates.grids)}
    refused = [
        (number[oriented], ix, iy)
        for (constraint, oriented, ix, iy), verdict in known.items()
        if not verdict.ok and constraint in asked and oriented in number
    ]
    if not refused:
        return np.arange(len(candidates))
    side = 1 + int(max(candidates.ix.max(), candidates.iy.max(), *(max(r[1:]) for r in refused)))
    codes = (candidates.grid_index * side + candidates.ix) * side + candidates.iy
    barred = [(k * side + ix) * side + iy for k, ix, iy in refused]
    return np.flatnonzero(~np.isin(codes, barred))
