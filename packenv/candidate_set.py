"""The K candidates that an agent chooses among, and which of them are valid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from packenv.planning.candidates import Candidates, grid_search
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.packing import Pile
from packenv.planning.scores import HEURISTICS
from packenv.planning.turns import ranked
from packenv.types import BoolArray, FloatArray, IntArray, OrientedItem

_TILES = 4
"""The spread takes the best candidate of each of so many by so many tiles of the floor, by orientation."""

_NO_DRAW = np.random.default_rng(0)
"""Heuristics take a generator; those of the columns draw nothing."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What the constraints say of a candidate.

    Attributes:
        ok: whether it may be placed.
        reason: the first objection, a word for programs; empty where there is none.
        verdicts: one for each constraint, in their order; empty unless ``ok``, and where the answer was
            remembered.
    """

    ok: bool
    reason: str
    verdicts: tuple[Verdict, ...]


class Memory:
    """Objections to candidates on one pile that comes again and again, such as the empty container."""

    def __init__(self) -> None:
        """Remember nothing yet."""
        self._reasons: WeakKeyDictionary[OrientedItem, dict[tuple[int, int], str]] = WeakKeyDictionary()

    def of(self, oriented: OrientedItem) -> dict[tuple[int, int], str]:
        """Why a translation, in cells, is no valid candidate; an empty word where it is one. May grow."""
        return self._reasons.setdefault(oriented, {})


class Asker:
    """Puts candidates to the constraints, each once."""

    def __init__(
        self,
        candidates: Candidates,
        constraints: Sequence[Constraint],
        pile: Pile,
        memory: Memory | None = None,
    ) -> None:
        """Ask nothing yet.

        Args:
            candidates: the legal ones of one item.
            constraints: in any order; a candidate must pass all.
            pile: what the container holds.
            memory: of this pile.
        """
        self._candidates, self._pile, self._memory = candidates, pile, memory
        self._constraints = list(zip(constraints, pile.states, strict=True))
        self.answers: dict[int, Answer] = {}

    def trial(self, index: int) -> Trial:
        """A candidate as the constraints want it."""
        found = self._candidates
        oriented = found.grids[found.grid_index[index]].oriented
        return Trial(oriented, int(found.ix[index]), int(found.iy[index]), float(found.z[index]))

    def passes(self, index: int) -> bool:
        """Whether no constraint objects."""
        known = self.answers.get(index)
        if known is None:
            known = self.answers[index] = self._remembered(self.trial(index))
        return known.ok

    def verdicts(self, index: int) -> tuple[Verdict, ...]:
        """What each constraint says of a candidate that passes."""
        if not self.passes(index):
            raise ValueError(f"candidate {index} passes not all constraints")
        if len(self.answers[index].verdicts) < len(self._constraints):
            self.answers[index] = self._ask(self.trial(index))
        return self.answers[index].verdicts

    def _remembered(self, trial: Trial) -> Answer:
        if self._memory is None:
            return self._ask(trial)
        reasons, place = self._memory.of(trial.oriented), (trial.ix, trial.iy)
        if place in reasons:
            return Answer(not reasons[place], reasons[place], ())
        answer = self._ask(trial)
        reasons[place] = answer.reason
        return answer

    def _ask(self, trial: Trial) -> Answer:
        verdicts: list[Verdict] = []
        for constraint, state in self._constraints:
            verdict = constraint.check(trial, self._pile.surface, state)
            if not verdict.ok:
                return Answer(False, verdict.reason, ())
            verdicts.append(verdict)
        return Answer(True, "", tuple(verdicts))


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """What is offered of one item on one pile.

    Attributes:
        candidates: all legal ones whose orientation no constraint objects to.
        chosen: (m,) int64, m ≤ K, indices into ``candidates``, ascending.
        scores: (m, h) raw scores of the chosen ones, a column for each heuristic.
        ranks: (m, h) int64, place among all candidates, equal scores in candidate order.
        valid: (m,) whether they pass the constraints.
        asker: knows their answers.
    """

    candidates: Candidates
    chosen: IntArray
    scores: FloatArray
    ranks: IntArray
    valid: BoolArray
    asker: Asker


def possible(
    orientations: Sequence[OrientedItem], constraints: Sequence[Constraint]
) -> tuple[OrientedItem, ...]:
    """The orientations that no constraint rules out wherever the item would lie."""
    return tuple(o for o in orientations if all(c.objection(o) is None for c in constraints))


def choose(
    orientations: Sequence[OrientedItem],
    constraints: Sequence[Constraint],
    pile: Pile,
    *,
    heuristics: Sequence[str],
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
        heuristics: by name; none of them draws.
        step: cells between tried translations.
        size: K.
        max_checked: the paper's N.
        memory: of this pile, where it comes again and again.

    Returns:
        the set; None where nothing is legal.
    """
    allowed = possible(orientations, constraints)
    if not allowed:
        return None
    candidates = grid_search(pile.surface, allowed, step)
    if not len(candidates):
        return None
    scores = np.column_stack([HEURISTICS[name](candidates, _NO_DRAW) for name in heuristics])
    asker = Asker(candidates, constraints, pile, memory)
    chosen = np.array(_chosen(candidates, scores, asker, size, max_checked), dtype=np.int64)
    chosen.sort()
    valid = np.array([asker.passes(int(k)) for k in chosen], dtype=np.bool_)
    return CandidateSet(candidates, chosen, scores[chosen], _ranks(scores, chosen), valid, asker)


def _chosen(
    candidates: Candidates, scores: FloatArray, asker: Asker, size: int, max_checked: int
) -> list[int]:
    """Indices of the set, without doubles."""
    total, columns = scores.shape
    kept: dict[int, None] = {}
    walks = [ranked(scores[:, column], max(max_checked, size)) for column in range(columns)]
    after = []
    for walk in walks:
        first = next((k for k, index in enumerate(walk[:max_checked].tolist()) if asker.passes(index)), None)
        if first is not None and len(kept) < size:
            kept[int(walk[first])] = None
        after.append(0 if first is None else first + 1)
    if total <= size:
        return list(range(total))
    for index in _in_turn([walk[start:] for walk, start in zip(walks, after, strict=True)]):
        if len(kept) >= (size + len(walks)) // 2:
            break
        kept[index] = None
    spread = _spread(candidates, scores[:, 0])
    for index in spread[np.linspace(0, len(spread) - 1, size - len(kept)).astype(np.int64)].tolist():
        kept[index] = None
    for index in _in_turn(walks):
        if len(kept) >= size:
            break
        kept[index] = None
    return list(kept)


def _in_turn(walks: Sequence[IntArray]) -> Iterator[int]:
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
