"""The K candidates: the best of every heuristic, no doubles, nothing asked twice."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from packenv.env.candidate_set import CandidateSet, choose
from packenv.env.observation import HEURISTIC_COLUMNS
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.inquiry import Memory
from packenv.planning.packing import Pile
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import HEURISTICS
from packenv.types import Container
from tests.env_samples import make_env

BOX = Container(0.16, 0.12, 0.10)
COLUMNS = [HEURISTICS[name] for name in HEURISTIC_COLUMNS]


class Picky(Constraint):
    """Refuses all but some candidates, by a hash of their place, and counts how often it is asked."""

    def __init__(self, share: float) -> None:
        self.share = share
        self.asked: Counter[tuple[int, int, int]] = Counter()

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        self.asked[id(trial.oriented), trial.ix, trial.iy] += 1
        return Verdict(self.likes(trial.ix, trial.iy), "" if self.likes(trial.ix, trial.iy) else "disliked")

    def likes(self, ix: int, iy: int) -> bool:
        return (ix * 7919 + iy * 104729) % 1000 < self.share * 1000


def chosen(size: int, picky: Picky, most: int = 30, step: int = 1) -> CandidateSet | None:
    env = make_env(mask="legal")
    orientations = env.unwrapped._shelf.prepared["soap_bar"].orientations
    rng = np.random.default_rng(0)
    surface = ContainerMap.empty(BOX, 0.004)
    surface.heights[:] = (rng.integers(0, 20, surface.heights.shape) * 2**-10).astype(np.float32)
    pile = Pile(surface, (None,))
    return choose(orientations, (picky,), pile, heuristics=COLUMNS, step=step, size=size, max_checked=most)


@pytest.mark.parametrize("share", [0.02, 0.3, 1.0])
@pytest.mark.parametrize("size", [5, 16, 64])
def test_every_heuristics_first_valid_candidate_is_in_the_set(size: int, share: float) -> None:
    picky = Picky(share)
    found = chosen(size, picky)
    assert found is not None
    assert len(found.chosen) == size
    assert (np.diff(found.chosen) > 0).all()
    assert max(picky.asked.values()) == 1
    candidates = found.candidates
    for column, name in enumerate(HEURISTIC_COLUMNS):
        scores = HEURISTICS[name](candidates, np.random.default_rng(0))
        order = np.argsort(scores, kind="stable")[:30]
        first = next((k for k in order if picky.likes(int(candidates.ix[k]), int(candidates.iy[k]))), None)
        if first is not None:
            row = int(np.flatnonzero(found.chosen == first)[0])
            assert found.valid[row]
            place = np.empty(len(scores), dtype=int)
            place[np.argsort(scores, kind="stable")] = np.arange(len(scores))
            np.testing.assert_array_equal(found.ranks[:, column], place[found.chosen])
    for index, valid in zip(found.chosen, found.valid, strict=True):
        assert valid == picky.likes(int(candidates.ix[index]), int(candidates.iy[index]))


def test_the_set_spreads_over_orientations_and_floor() -> None:
    found = chosen(64, Picky(1.0))
    assert found is not None
    grids = found.candidates.grid_index[found.chosen]
    assert set(grids) == set(range(len(found.candidates.grids)))
    for cells in (found.candidates.ix, found.candidates.iy):
        assert np.ptp(cells[found.chosen]) > 0.7 * np.ptp(cells)


def test_a_set_with_room_for_all_holds_all() -> None:
    found = chosen(4000, Picky(0.5), step=5)
    assert found is not None
    np.testing.assert_array_equal(found.chosen, np.arange(len(found.candidates)))


def test_nothing_legal_is_no_set() -> None:
    env = make_env(mask="legal")
    orientations = env.unwrapped._shelf.prepared["soap_bar"].orientations
    full = ContainerMap.empty(BOX, 0.004)
    full.heights[:] = 0.1
    found = choose(orientations, (), Pile(full, ()), heuristics=COLUMNS, step=5, size=8, max_checked=9)
    assert found is None


def test_what_is_remembered_is_not_asked_again_and_changes_nothing() -> None:
    env = make_env(mask="legal")
    orientations = env.unwrapped._shelf.prepared["soap_bar"].orientations
    picky, memory = Picky(0.3), Memory()
    pile = Pile(ContainerMap.empty(BOX, 0.004), (None,))
    first, second = (
        choose(
            orientations,
            (picky,),
            pile,
            heuristics=COLUMNS,
            step=1,
            size=20,
            max_checked=30,
            memory=memory,
        )
        for _ in range(2)
    )
    assert first is not None
    assert second is not None
    assert max(picky.asked.values()) == 1
    np.testing.assert_array_equal(first.chosen, second.chosen)
    np.testing.assert_array_equal(first.valid, second.valid)
    good, bad = (int(second.chosen[which][0]) for which in (second.valid, ~second.valid))
    assert [v.ok for v in second.inquiry.verdicts(second.candidates.trial(good))] == [True]
    with pytest.raises(ValueError, match="does not pass"):
        second.inquiry.verdicts(second.candidates.trial(bad))
