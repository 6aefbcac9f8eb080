"""The K candidates that an agent chooses among, and which of them are valid."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from packenv.planning.constraints import Constraint
from packenv.planning.inquiry import Inquiry, Memory
from packenv.planning.packing import Pile
from packenv.planning.search.candidates import Candidates, grid_search, ranked
from packenv.planning.search.heuristics import Heuristic
from packenv.types import BoolArray, FloatArray, IntArray, OrientedItem

_TILES = 4
"""The spread takes the best candidate of each of so many by so many tiles of the floor, by orientation."""


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """What is offered of one item on one pile.

    Attributes:
        candidates: all legal ones whose orientation no constraint objects to.
        chosen: (m,) int64, m ≤ K, indices into ``candidates``, ascending.
        scores: (m, h) raw scores of the chosen ones, a column for each heuristic.
        ranks: (m, h) int64, place among all candidates, equal scores in candidate order.
        valid: (m,) whether they pass the constraints.
        inquiry: knows their answers.
    """

    candidates: Candidates
    chosen: IntArray
    scores: FloatArray
    ranks: IntArray
    valid: BoolArray
    inquiry: Inquiry


def choose(
    orientations: Sequence[OrientedItem],
    constraints: Sequence[Constraint],
    pile: Pile,
    *,
    heuristics: Sequence[Heuristic],
    step: int,
    size: int,
    max_checked: int,
    memory: Memory | None = None,
) -> CandidateSet | None:
    """Choose the candidates of an item: the first valid one of every heuristic, and a spread.

    Each heuristic's ranks are walked down, at most ``max_checked``, to the first candidate that passes. It is
    in the set wherever there is room. Then come the next ranks of the heuristics in turn, for half of what is
    left, and the best by the first heuristic in tiles of the floor, orientation by orientation.

    Args:
        orientations: of the item.
        constraints: what a valid candidate must pass.
        pile: what the container holds.
        heuristics: those of the columns; one that draws draws the same every time.
        step: cells between tried translations.
        size: K.
        max_checked: the paper's N.
        memory: of this pile, where it comes again and again.

    Returns:
        the set; None where nothing is legal, or all that is would lie on what bears nothing.
    """
    inquiry = Inquiry(constraints, pile, memory=memory)
    allowed = inquiry.possible(orientations)
    if not allowed:
        return None
    candidates = grid_search(pile.surface, allowed, step)
    if not len(candidates):
        return None
    # A generator that is always the same: an own heuristic that draws must not differ from copy to copy.
    found = (heuristic(candidates, np.random.default_rng(0)) for heuristic in heuristics)
    scores = np.column_stack(tuple(found))
    worth = np.flatnonzero(inquiry.screened(candidates))
    if not len(worth):
        return None
    candidates, scores = candidates.only(worth), scores[worth]

    def passes(index: int) -> bool:
        return inquiry.ask(candidates.trial(index)).ok

    chosen = np.array(_chosen(candidates, scores, passes, size, max_checked), dtype=np.int64)
    chosen.sort()
    valid = np.array([passes(int(k)) for k in chosen], dtype=np.bool_)
    return CandidateSet(candidates, chosen, scores[chosen], _ranks(scores, chosen), valid, inquiry)


def _chosen(
    candidates: Candidates,
    scores: FloatArray,
    passes: Callable[[int], bool],
    size: int,
    max_checked: int,
) -> list[int]:
    """Indices of the set, without doubles."""
    total, columns = scores.shape
    kept: dict[int, None] = {}
    walks = [ranked(scores[:, column], max(max_checked, size)) for column in range(columns)]
    after = []
    for walk in walks:
        first = next((k for k, index in enumerate(walk[:max_checked].tolist()) if passes(index)), None)
        if first is not None and len(kept) < size:
            kept[int(walk[first])] = None
        after.append(0 if first is None else first + 1)
    if total <= size:
        return list(range(total))
    for index in _interleaved([walk[start:] for walk, start in zip(walks, after, strict=True)]):
        if len(kept) >= (size + len(walks)) // 2:
            break
        kept[index] = None
    spread = _spread(candidates, scores[:, 0])
    for index in spread[np.linspace(0, len(spread) - 1, size - len(kept)).astype(np.int64)].tolist():
        kept[index] = None
    for index in _interleaved(walks):
        if len(kept) >= size:
            break
        kept[index] = None
    return list(kept)


def _interleaved(walks: Sequence[IntArray]) -> Iterator[int]:
    """The first of each walk, the second of each, and so on."""
    for k in range(max(map(len, walks), default=0)):
        for walk in walks:
            if k < len(walk):
                yield int(walk[k])


def _spread(candidates: Candidates, scores: FloatArray) -> IntArray:
    """The candidate of the lowest score in each tile of the floor, orientation by orientation."""
    across, along = (int(cells.max()) + 1 for cells in (candidates.ix, candidates.iy))
    tile = candidates.ix * _TILES // across * _TILES + candidates.iy * _TILES // along
    key = candidates.grid_index * _TILES**2 + tile
    order = np.lexsort((scores, key))
    _, first = np.unique(key[order], return_index=True)
    best: IntArray = order[first]
    return best


def _ranks(scores: FloatArray, chosen: IntArray) -> IntArray:
    """(m, h) place of the chosen ones among all, ties in candidate order."""
    ranks = np.empty((len(chosen), scores.shape[1]), dtype=np.int64)
    for column in range(scores.shape[1]):
        values = scores[:, column]
        ordered = np.sort(values)
        low = np.searchsorted(ordered, values[chosen], side="left")
        high = np.searchsorted(ordered, values[chosen], side="right")
        for row in np.flatnonzero(high - low > 1).tolist():
            index = chosen[row]
            low[row] += np.count_nonzero(values[:index] == values[index])
        ranks[:, column] = low
    return ranks
