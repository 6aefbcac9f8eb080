"""How careful a planner is: which candidates are put to which constraints, and what comes if that fails."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from packenv.planning.constraints import Constraint
from packenv.planning.inquiry import Question
from packenv.planning.search.candidates import Candidates, place_code, place_codes, ranked
from packenv.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Tier:
    """One level of care in choosing among an item's candidates.

    Attributes:
        clearance: cells by which the item may be off sideways at the release and still meet nothing.
        instead: constraints that are asked in place of the planner's of the same name, on the same states.
        max_checked: as the planner's, in its place; None takes that.
        each: most candidates of one orientation: the best of a heuristic are mostly neighbours of each other,
            and one failure there tells of the rest. None takes them as they come.
        risk: how bad such a placement is, on a scale of the caller's; from 1 it is makeshift: better than
            nothing, but a restart with such items first is worth trying.
        shaky: what is placed so may not stay where it is put; where it has clearance, that is a risk only for what
            comes after the first of its kind.
        apart: how far aside from items that may not stay a candidate is, m.
        leaning: in the fallback perturbed poses are tried, too.
    """

    clearance: int = 0
    instead: Mapping[str, Constraint] = field(default_factory=dict)
    max_checked: int | None = None
    each: int | None = None
    risk: float = 0.0
    shaky: bool = False
    apart: float = 0.0
    leaning: bool = True

    def rules(self, constraints: Sequence[Constraint]) -> tuple[Constraint, ...]:
        """The constraints that this tier asks, one for each of the planner's."""
        return tuple(self.instead.get(constraint.name, constraint) for constraint in constraints)


@dataclass(frozen=True, eq=False)
class Strategy:
    """What a planner tries, the most careful first.

    Attributes:
        first: tiers of the first pass; a later one is tried where an earlier one leaves no packable candidate.
            The paper has one, without clearance.
        fallback: tiers of the fallback, one set after another: each is tried on the stable poses, its last
            tier also on the perturbed ones. None makes one pass with those of the first.
        restarts: how often an incomplete order is planned again with its leftovers first; the paper: 0.
        restart_tiers: tiers of the first pass of such a restart while the packing is incomplete; None takes ``first``.
        last_resorts: tiers of more plans, with restarts of their own, of the sequence as it was given: one
            after another until one has placed every item, where restarts are allowed and none did. Such a
            plan has to place more items than those before it.
        clearance: cells that were asked for; where it is not 0, each placement tells what it got.
        roomy: is tried before all else, in one pass, and decides where that places every item; None where
            nothing is.
        trial: a pass only finds out whether the order fits: it ends with the first item that has no candidate
            even without clearance, and tries no exact places, where items stand flush.
    """

    first: Sequence[Tier] = (Tier(),)
    fallback: Sequence[Sequence[Tier]] | None = None
    restarts: int = 0
    restart_tiers: Sequence[Tier] | None = None
    last_resorts: Sequence[Sequence[Tier]] = ()
    clearance: int = 0
    roomy: Strategy | None = None
    trial: bool = False


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


def still_open(candidates: Candidates, refused: Iterable[Question]) -> IntArray:
    """Indices of the candidates that are not among the refused ones, ascending."""
    asked = list(refused)
    if not asked:
        return np.arange(len(candidates))
    numbers: dict[bytes, int] = {}
    own = place_codes(candidates, numbers)
    barred = [place_code(numbers[rotation], x, y) for rotation, x, y in asked if rotation in numbers]
    return np.flatnonzero(~np.isin(own, barred))
