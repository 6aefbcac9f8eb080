"""One item on one pile: nothing is asked twice, refusals count once, and a passing candidate is placed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from packenv.config import GridConfig
from packenv.planning.constraints import Constraint, Details, Trial, Verdict
from packenv.planning.inquiry import Inquiry, Memory, objection, place
from packenv.planning.packing import Pile
from packenv.planning.planner import Planner
from packenv.planning.search.candidates import Candidates, grid_search
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import HEURISTICS
from packenv.planning.search.measured import Resting
from packenv.planning.sequence import Piece
from packenv.planning.tiers import Strategy, Tier, still_open
from packenv.types import Container, Leftover, OrientedItem, Placement, RobotPath
from tests.shapes import box
from tests.shelf_samples import shelf_of

GRID = GridConfig(cell_size=0.005, n_yaws=2)
BOX = Container(0.12, 0.10, 0.12)
SHELF = shelf_of({"brick": box(0.08, 0.06, 0.04, "brick")}, GRID)
PIECE = Piece("brick", 1)


@dataclass
class Counting(Constraint):
    """Counts what it is asked, by value; the rule is a test's. A dataclass that compares, so without a hash."""

    rule: Callable[[Trial], bool] = lambda trial: True
    called: str = "counting"
    answer: Verdict = field(default_factory=lambda: Verdict(True))
    refuses: Callable[[OrientedItem], bool] = lambda oriented: False
    asked: Counter[tuple[bytes, int, int]] = field(default_factory=Counter)
    objections: Counter[bytes] = field(default_factory=Counter)

    @property
    def name(self) -> str:
        return self.called

    def start(self, resting: Sequence[Resting] = ()) -> tuple[Trial, ...]:
        return ()

    def objection(self, oriented: OrientedItem) -> str | None:
        self.objections[oriented.rotation.tobytes()] += 1
        return "upside-down" if self.refuses(oriented) else None

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        self.asked[trial.oriented.rotation.tobytes(), trial.ix, trial.iy] += 1
        ok = self.rule(trial)
        return replace(self.answer, ok=ok, reason="" if ok else f"not-{self.called}", state=(*state, trial))


def even(trial: Trial) -> bool:
    return (trial.ix + trial.iy) % 4 == 0


def empty(*constraints: Constraint) -> Pile:
    return Pile(ContainerMap.empty(BOX, GRID.cell_size), tuple(c.start() for c in constraints))


def candidates() -> Candidates:
    return grid_search(empty().surface, SHELF.prepared["brick"].orientations, GRID.step_cells)


def trials() -> list[Trial]:
    found = candidates()
    return [found.trial(k) for k in range(len(found))]


def made_anew(trial: Trial) -> Trial:
    """The same question in other objects."""
    oriented = replace(trial.oriented, rotation=trial.oriented.rotation.copy())
    return Trial(oriented, trial.ix, trial.iy, trial.z)


# ---------------------------------------------------------------------------------- nothing twice


def test_there_is_something_to_ask() -> None:
    answers = {even(trial) for trial in trials()}
    assert answers == {True, False}
    assert len(trials()) > 8


def test_a_trial_of_a_candidate_is_where_the_candidate_is() -> None:
    found = candidates()
    for k, trial in enumerate(trials()):
        np.testing.assert_allclose(trial.corner, found.corners[k], atol=1e-12)
        np.testing.assert_array_equal(trial.oriented.extents, found.extents[k])


def test_each_candidate_is_asked_once_and_each_refusal_counts_once() -> None:
    first, second = Counting(even, "first"), Counting(lambda trial: trial.ix > 0, "second")
    inquiry = Inquiry((first, second), empty(first, second))
    for _ in range(3):
        for trial in trials():
            answer = inquiry.ask(trial)
            assert answer.ok == (even(trial) and trial.ix > 0)
            wanted = "not-first" if not even(trial) else "" if trial.ix > 0 else "not-second"
            assert answer.reason == wanted
            assert len(answer.verdicts) == (2 if answer.ok else 0)
    assert set(first.asked.values()) == set(second.asked.values()) == {1}
    assert len(first.asked) == len(trials()) == inquiry.asked
    assert len(second.asked) == sum(map(even, trials()))
    counts = Counter(inquiry.ask(trial).reason for trial in trials())
    del counts[""]
    assert inquiry.rejections == counts
    assert set(counts) == {"not-first", "not-second"}


def test_the_same_rotation_in_another_object_is_the_same_question() -> None:
    judge = Counting(even)
    inquiry = Inquiry((judge,), empty(judge))
    for trial in trials():
        answer = inquiry.ask(trial)
        assert inquiry.ask(made_anew(trial)) is answer
        assert inquiry.ask(made_anew(trial), (judge,)).ok == answer.ok
    assert set(judge.asked.values()) == {1}
    assert inquiry.rejections == {"not-counting": sum(not even(trial) for trial in trials())}


def test_another_rotation_cell_or_rule_is_another_question() -> None:
    judge = Counting(even)
    other = Counting(even, answer=judge.answer, refuses=judge.refuses)
    assert judge == other  # dataclasses of equal fields, and yet two constraints
    inquiry = Inquiry((judge,), empty(judge))
    trial = trials()[0]
    turned = replace(trial, oriented=replace(trial.oriented, rotation=trial.oriented.rotation[[1, 0, 2]]))
    for asked in (trial, turned, replace(trial, ix=trial.ix + 1), replace(trial, iy=trial.iy + 1)):
        inquiry.ask(asked)
    assert len(judge.asked) == 4
    inquiry.ask(trial, (other,))
    assert len(other.asked) == 1


def test_an_objection_is_asked_for_once_and_counts_once() -> None:
    orientations = SHELF.prepared["brick"].orientations
    judge = Counting(refuses=lambda oriented: oriented.pose_index != 1)
    inquiry = Inquiry((judge,), empty(judge))
    wanted = [o for o in orientations if o.pose_index == 1]
    again = [replace(o, rotation=o.rotation.copy()) for o in orientations]
    for oriented in orientations:
        assert not inquiry.was_objected(oriented)
    for _ in range(2):
        assert inquiry.possible(orientations) == wanted
        assert [inquiry.objected(o) for o in again] == [o.pose_index != 1 for o in again]
    assert [inquiry.was_objected(o) for o in again] == [o.pose_index != 1 for o in again]
    assert set(judge.objections.values()) == {1}
    turns = {o.rotation.tobytes() for o in orientations if o.pose_index != 1}
    assert inquiry.rejections == {"orientation-upside-down": len(turns)}
    assert objection([Counting(), judge], orientations[0]) == judge.objection(orientations[0])
    assert not judge.asked


def test_counts_go_on_from_those_of_before() -> None:
    judge = Counting(lambda trial: False)
    given = {"not-counting": 3, "other": 2}
    inquiry = Inquiry((judge,), empty(judge), rejections=given)
    inquiry.ask(trials()[0])
    assert inquiry.rejections == {"not-counting": 4, "other": 2}
    assert given == {"not-counting": 3, "other": 2}


def test_a_refusal_without_a_word_counts_under_the_constraint_s_name() -> None:
    class Silent(Constraint):
        def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
            return Verdict(False)

    inquiry = Inquiry((Silent(),), empty(Silent()))
    assert inquiry.ask(trials()[0]).reason == "Silent"
    assert inquiry.rejections == {"Silent": 1}


def test_what_one_rule_refused_is_known_and_what_it_passed_is_open() -> None:
    judge, other = Counting(even), Counting(lambda trial: trial.ix == 0, "other")
    inquiry = Inquiry((judge,), empty(judge))
    for trial in trials():
        inquiry.ask(trial)
    found = candidates()
    assert still_open(found, inquiry.refused((judge,))).tolist() == [
        k for k, trial in enumerate(trials()) if even(trial)
    ]
    assert list(inquiry.refused((other,))) == []
    assert len(list(inquiry.refused((judge, judge)))) == sum(not even(trial) for trial in trials())


@pytest.mark.parametrize("most", [3, 1000])
def test_a_second_tier_asks_again_only_what_it_replaces(most: int) -> None:
    """Of two constraints a tier replaces one: the other's answers stand, and no refusal counts twice."""
    kept, hard = Counting(even, "kept"), Counting(lambda trial: False, "rule")
    soft = Counting(lambda trial: trial.ix == trial.iy == 4 and trial.oriented.extents[2] < 0.05, "rule")
    strategy = Strategy(first=(Tier(), Tier(instead={"rule": soft})))
    planner = Planner(HEURISTICS["hm"], GRID, (kept, hard), strategy=strategy, max_checked=most)
    packing = planner.pack(["brick"], SHELF.prepared, BOX)
    assert {*kept.asked.values(), *hard.asked.values(), *soft.asked.values()} == {1}
    pieces: list[Placement | Leftover] = [*packing.placements, *packing.leftovers]
    assert len(pieces) == 1
    refusals = Counter(pieces[0].rejections)
    assert refusals["not-kept"] == sum(not even(t) for t in trials() if key(t) in kept.asked)
    assert refusals["not-rule"] == len(hard.asked) + len(soft.asked) - len(packing.placements)
    assert set(refusals) <= {"not-kept", "not-rule"}
    assert set(soft.asked) <= {key(t) for t in trials() if even(t)}
    if most == 1000:
        assert packing.complete
        assert len(kept.asked) == len(trials())
        assert packing.placements[0].checked == sum(refusals.values()) + 1


def test_a_second_tier_looks_beyond_what_the_first_was_refused() -> None:
    """N is for each tier: its turn is not taken by what is known to be refused."""
    judge = Counting(lambda trial: False)
    strategy = Strategy(first=(Tier(), Tier(), Tier()))
    planner = Planner(HEURISTICS["hm"], GRID, (judge,), strategy=strategy, max_checked=4)
    (left,) = planner.pack(["brick"], SHELF.prepared, BOX).leftovers
    assert len(judge.asked) == 12
    assert set(judge.asked.values()) == {1}
    assert left.rejections == {"not-counting": 12}


def key(trial: Trial) -> tuple[bytes, int, int]:
    return trial.oriented.rotation.tobytes(), trial.ix, trial.iy


# ------------------------------------------------------------------------------------------ memory


def test_memory_answers_as_the_constraints_did_and_asks_nothing() -> None:
    judge, memory = Counting(even), Memory()
    inquiries = [Inquiry((judge,), empty(judge), memory=memory) for _ in range(3)]
    answers = [[inquiry.ask(trial) for trial in trials()] for inquiry in inquiries]
    assert set(judge.asked.values()) == {1}
    for others in answers[1:]:
        assert [(a.ok, a.reason) for a in others] == [(a.ok, a.reason) for a in answers[0]]
        assert not any(a.verdicts for a in others)
    assert inquiries[0].rejections == inquiries[1].rejections == inquiries[2].rejections
    assert [inquiry.asked for inquiry in inquiries] == [len(trials())] * 3


def test_a_remembered_candidate_is_asked_once_more_when_it_is_placed() -> None:
    judge, memory = Counting(even), Memory()
    good, bad = (next(t for t in trials() if even(t) is ok) for ok in (True, False))
    Inquiry((judge,), empty(judge), memory=memory).ask(good)
    second = Inquiry((judge,), empty(judge), memory=memory)
    assert second.ask(good).verdicts == ()
    (verdict,) = second.verdicts(good)
    assert verdict.state == (good,)
    assert second.verdicts(good) == (verdict,)
    assert judge.asked[key(good)] == 2
    with pytest.raises(ValueError, match="does not pass"):
        second.verdicts(bad)
    assert second.rejections == {"not-counting": 1}


def test_memory_is_of_the_orientation_and_goes_with_it() -> None:
    memory, (one, *_) = Memory(), trials()
    other = made_anew(one)
    memory.of(one.oriented)[1, 2] = "no"
    assert memory.of(one.oriented) == {(1, 2): "no"}
    assert memory.of(other.oriented) == {}
    assert len(memory._reasons) == 2
    del other
    assert len(memory._reasons) == 1


# ------------------------------------------------------------------------------------------- place


def placed(*verdicts: Verdict, notes: dict[str, object] | None = None) -> tuple[Any, Pile, Trial, Pile]:
    judges = [Counting(called=f"rule-{k}", answer=verdict) for k, verdict in enumerate(verdicts)]
    before = empty(*judges)
    inquiry = Inquiry(judges, before, rejections={"earlier": 2})
    trial = trials()[3]
    placement, after = place(
        PIECE,
        trial,
        inquiry,
        inquiry.verdicts(trial),
        score=1.5,
        candidates=7,
        route="later",
        checked=4,
        notes=notes,
    )
    return placement, after, trial, before


def test_a_placement_tells_where_how_and_what_was_refused() -> None:
    placement, after, trial, _ = placed(Verdict(True, details={"a": 1}), Verdict(True), notes={"n": 2})
    assert (placement.item, placement.instance) == ("brick", 1)
    np.testing.assert_array_equal(placement.rotation, trial.oriented.rotation)
    np.testing.assert_array_equal(placement.position, trial.position)
    np.testing.assert_array_equal(placement.corner, trial.corner)
    np.testing.assert_array_equal(placement.extents, trial.oriented.extents)
    assert (placement.pose_index, placement.yaw) == (trial.oriented.pose_index, trial.oriented.yaw)
    told = (placement.score, placement.candidates, placement.route, placement.checked)
    assert told == (1.5, 7, "later", 4)
    assert placement.rejections == {"earlier": 2}
    assert placement.details == {"rule-0": {"a": 1}, "n": 2}
    assert placement.path is None
    assert after.states == ((trial,), (trial,))


def test_without_a_constraint_s_word_the_heightmap_is_that_of_the_item_in_its_place() -> None:
    for verdicts in ((), (Verdict(True),)):
        _, after, trial, before = placed(*verdicts)
        wanted = before.surface.with_item(trial.oriented, trial.ix, trial.iy, trial.z)
        np.testing.assert_array_equal(after.surface.heights, wanted.heights)
        assert not np.array_equal(after.surface.heights, before.surface.heights)


def test_the_last_constraint_that_knows_the_heightmap_has_its_way() -> None:
    one, two = (ContainerMap.empty(BOX, GRID.cell_size) for _ in range(2))
    _, after, _, _ = placed(Verdict(True, surface=one), Verdict(True, surface=two), Verdict(True))
    assert after.surface is two


def test_the_path_is_that_of_the_constraint_that_found_one() -> None:
    path = RobotPath(np.zeros(3), "flat", 1, np.zeros(3), np.zeros((3, 6)))
    placement, *_ = placed(Verdict(True), Verdict(True, path=path), Verdict(True))
    assert placement.path is path
    assert placement.details == {}


def test_figures_are_made_when_the_candidate_is_placed() -> None:
    made: list[int] = []

    def figures() -> dict[str, object]:
        made.append(1)
        return {"forces": 3}

    judge = Counting(called="rule", answer=Verdict(True, details=Details(figures)))
    inquiry = Inquiry((judge,), empty(judge))
    answers = [inquiry.ask(trial) for trial in trials()]
    assert not made
    placement, _ = place(
        PIECE, trials()[0], inquiry, answers[0].verdicts, score=0.0, candidates=1, route="", checked=1
    )
    assert placement.details == {"rule": {"forces": 3}}
    assert made == [1]
