"""The planner under constraints: what they may change, the paper's fallback, counts, and real constraints."""

from __future__ import annotations

import dataclasses
import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from packenv.config import GridConfig
from packenv.geometry.prepare import PreparedItem
from packenv.io.plans import plan_to_json
from packenv.items.plan_maker import make_plan
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import MARGIN, assemble
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.options import Constraints, PlanOptions, StabilityRule
from packenv.planning.packing import Packing
from packenv.planning.planner import Planner
from packenv.planning.search.candidates import Candidates, grid_search
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import HEURISTICS
from packenv.planning.search.measured import Resting
from packenv.planning.search.orientations import perturbations
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contacts import Body, item_contacts, join, no_contacts
from packenv.planning.stability.margins import MarginRule, check_margin
from packenv.planning.tiers import Strategy, Tier
from packenv.types import Container, OrderLine, OrientedItem, Placement, Plan
from packenv.verification.exact_meshes import audit_plan
from packenv.verification.stability_and_reach import Recheck, recheck
from tests.shapes import ball, box, cup, cylinder
from tests.shelf_samples import shelf_of

GRID = GridConfig(cell_size=0.005, n_yaws=2)
BOX = Container(0.2, 0.2, 0.12)
MESHES = {
    item.name: item
    for item in (
        box(0.08, 0.06, 0.04, "brick"),
        box(0.10, 0.08, 0.02, "book"),
        box(0.05, 0.05, 0.01, "tile"),
        box(0.012, 0.012, 0.05, "stick"),
        box(0.19, 0.19, 0.11, "block"),
        box(0.5, 0.5, 0.01, "board"),
        cylinder(0.02, 0.06, "can", sections=24),
        cup(0.03, 0.05, name="cup"),
        ball(0.025, subdivisions=4),
    )
}
NAMES = ["book", "brick", "can", "cup", "brick", "tile", "can"]
FIXED = sorted(set(HEURISTICS) - {"random"})
"""Heuristics whose scores can be computed again."""


@pytest.fixture(scope="module")
def shelf() -> ItemShelf:
    return shelf_of(MESHES, GRID)


Rule = Callable[[Trial, tuple[Trial, ...]], bool]


@dataclasses.dataclass(eq=False)
class Judge(Constraint):
    """A constraint that a test dictates; it keeps what it was asked, and its state is what was placed."""

    rule: Rule
    called: str = "judge"
    reason: str = "no"
    objects_to: Callable[[OrientedItem], bool] = lambda oriented: False
    asked: list[tuple[Trial, ContainerMap]] = dataclasses.field(default_factory=list)

    @property
    def name(self) -> str:
        return self.called

    def start(self, resting: Sequence[Resting] = ()) -> tuple[Trial, ...]:
        return ()

    def objection(self, oriented: OrientedItem) -> str | None:
        return "objection" if self.objects_to(oriented) else None

    def check(self, trial: Trial, surface: ContainerMap, state: tuple[Trial, ...]) -> Verdict:
        self.asked.append((trial, surface))
        ok = self.rule(trial, state)
        return Verdict(ok, "" if ok else self.reason, (*state, trial), {"of": self.name})


def by_lot(share: float) -> Rule:
    """Reject this share of candidates, the same ones at every call."""

    def rule(trial: Trial, placed: tuple[Trial, ...]) -> bool:
        key = np.round(np.append(trial.corner, trial.oriented.rotation.ravel()), 4) + 0.0
        digest = np.frombuffer(key.tobytes(), dtype=np.uint32).astype(np.uint64)
        lot = np.random.default_rng([int(d) for d in digest]).random()
        return bool(lot >= share)

    return rule


def yes(trial: Trial, placed: tuple[Trial, ...]) -> bool:
    return True


def no(trial: Trial, placed: tuple[Trial, ...]) -> bool:
    return False


def planner(
    shelf: ItemShelf,
    *judges: Judge,
    heuristic: str = "hm",
    tilting: bool = True,
    restarts: int = 0,
    **more: Any,
) -> Planner:
    more.setdefault("strategy", Strategy(restarts=restarts))
    return Planner(
        HEURISTICS[heuristic], GRID, judges, (lambda name: _groups(shelf, name)) if tilting else None, **more
    )


_CACHE: dict[str, list[tuple[OrientedItem, ...]]] = {}


def _groups(shelf: ItemShelf, name: str) -> list[tuple[OrientedItem, ...]]:
    if name not in _CACHE:
        _CACHE[name] = list(perturbations(shelf.shapes[name], shelf.prepared[name].poses, GRID, BOX.size))
    return _CACHE[name]


def searched(surface: ContainerMap, orientations: Sequence[OrientedItem]) -> Candidates:
    return grid_search(surface, orientations, GRID.step_cells)


def count(surface: ContainerMap, orientations: Sequence[OrientedItem]) -> int:
    """Number of candidates; an empty set has none."""
    return len(searched(surface, orientations)) if orientations else 0


def poses(packing: Packing) -> list[tuple[Any, ...]]:
    return [
        (p.item, p.instance, p.position.tolist(), p.rotation.tolist(), p.score, p.candidates)
        for p in packing.placements
    ]


def before(packing: Packing) -> list[ContainerMap]:
    """The heightmap on which each item was placed."""
    return [ContainerMap.empty(packing.container, GRID.cell_size), *packing.surfaces[:-1]]


def is_stable_pose(oriented: OrientedItem, item: PreparedItem) -> bool:
    return any(np.allclose(oriented.rotation, o.rotation, atol=1e-9) for o in item.orientations)


# ------------------------------------------------------------------------- what constraints may change


@pytest.mark.parametrize("heuristic", sorted(HEURISTICS))
def test_constraints_that_accept_everything_change_nothing(heuristic: str, shelf: ItemShelf) -> None:
    names = [*NAMES, "block", "stick"]
    free = planner(shelf, heuristic=heuristic, tilting=False, seed=5).pack(names, shelf.prepared, BOX)
    for judges in ((Judge(yes),), (Judge(yes), Judge(yes, "other"))):
        bound = planner(shelf, *judges, heuristic=heuristic, tilting=False, seed=5)
        packing = bound.pack(names, shelf.prepared, BOX)
        assert poses(packing) == poses(free)
        assert [(x.item, x.instance, x.reason) for x in packing.leftovers] == [
            (x.item, x.instance, x.reason) for x in free.leftovers
        ]
        assert all((p.route, p.checked, p.rejections) == ("first-pass", 1, {}) for p in packing.placements)
    assert "block" in {left.item for left in free.leftovers}


@pytest.mark.parametrize("heuristic", FIXED)
@pytest.mark.parametrize("search", ["3d", "5d"])
def test_every_placement_is_a_legal_candidate(search: str, heuristic: str, shelf: ItemShelf) -> None:
    """Constraints only remove: pose and score are those of a candidate of the pile of that step."""
    judge = Judge(by_lot(0.95))
    planned = planner(shelf, judge, heuristic=heuristic, search=search, max_checked=40)
    packing = planned.pack(NAMES, shelf.prepared, BOX)
    assert packing.placements
    for placement, surface in zip(packing.placements, before(packing), strict=True):
        sets = (
            [[o for group in _groups(shelf, placement.item) for o in group]]
            if search == "5d"
            else [shelf.prepared[placement.item].orientations]
            if placement.route == "first-pass"
            else _groups(shelf, placement.item)
        )
        assert any(s and _is_among(placement, searched(surface, s), heuristic) for s in sets)


def _is_among(placement: Placement, candidates: Candidates, heuristic: str) -> bool:
    if len(candidates) != placement.candidates:
        return False
    corners = np.column_stack(
        [candidates.ix * candidates.cell_size, candidates.iy * candidates.cell_size, candidates.z]
    )
    here = np.flatnonzero(np.abs(corners - placement.corner).max(axis=1) < 1e-9)
    here = [
        k
        for k in here
        if np.array_equal(candidates.grids[candidates.grid_index[k]].oriented.rotation, placement.rotation)
    ]
    scores = HEURISTICS[heuristic](candidates, np.random.default_rng(0))
    return len(here) == 1 and scores[here[0]] == placement.score


def test_whatever_is_rejected_nothing_overlaps(shelf: ItemShelf) -> None:
    for share in (0.5, 0.9):
        packing = planner(shelf, Judge(by_lot(share))).pack(NAMES, shelf.prepared, BOX)
        assert audit_plan(_plan(packing, NAMES), MESHES).ok


# ------------------------------------------------------------------------------- sequence of questions


@pytest.mark.parametrize("heuristic", FIXED)
def test_candidates_are_asked_in_the_order_of_their_scores(heuristic: str, shelf: ItemShelf) -> None:
    """The 30 best, best first, equal ones in the sequence of Alg. 2."""
    judge = Judge(lambda trial, placed: not placed)
    planned = planner(shelf, judge, heuristic=heuristic, tilting=False, max_checked=30)
    planned.pack(["book", "can"], shelf.prepared, BOX)
    trials = [(trial, surface) for trial, surface in judge.asked if trial.oriented.item == "can"]
    candidates = searched(trials[0][1], shelf.prepared["can"].orientations)
    scores = HEURISTICS[heuristic](candidates, np.random.default_rng(0))
    wanted = np.argsort(scores, kind="stable")[:30]
    assert len(trials) == 30
    for k, (trial, _) in zip(wanted, trials, strict=True):
        assert trial.oriented is candidates.grids[candidates.grid_index[k]].oriented
        assert (trial.ix, trial.iy, trial.z) == (candidates.ix[k], candidates.iy[k], candidates.z[k])


def test_a_trial_tells_its_pose(shelf: ItemShelf) -> None:
    judge = Judge(yes)
    (placement,) = planner(shelf, judge).pack(["cup"], shelf.prepared, BOX).placements
    ((trial, _),) = judge.asked
    placed = MESHES["cup"].vertices @ trial.oriented.rotation.T + trial.position
    np.testing.assert_allclose(placed.min(axis=0), trial.corner, atol=1e-9)
    np.testing.assert_allclose(trial.com, trial.oriented.rotation @ MESHES["cup"].com + trial.position)
    assert placement.position.tolist() == trial.position.tolist()
    assert placement.details == {"judge": {"of": "judge"}}


def test_the_second_constraint_is_asked_only_what_the_first_accepts(shelf: ItemShelf) -> None:
    first, second = Judge(by_lot(0.6), "first", "low"), Judge(by_lot(0.0), "second", "high")
    picky = Judge(lambda trial, placed: int(trial.corner.sum() * 1e6) % 3 == 0, "third", "odd")
    packing = planner(shelf, first, second, picky).pack(NAMES, shelf.prepared, BOX)
    passed = [trial for trial, _ in first.asked if first.rule(trial, ())]
    assert [t for t, _ in second.asked] == passed == [t for t, _ in picky.asked]
    placed = [t for t in passed if picky.rule(t, ())]
    assert [t.position.tolist() for t in placed] == [p.position.tolist() for p in packing.placements]
    found = Counter[str]()
    for piece in (*packing.placements, *packing.leftovers):
        found.update(piece.rejections)
    assert found["low"] == len(first.asked) - len(passed) > 0
    assert found["odd"] == len(passed) - len(placed) > 0
    for placement in packing.placements:
        assert set(placement.details) == {"first", "second", "third"}


def test_a_constraint_is_given_the_state_of_what_was_placed(shelf: ItemShelf) -> None:
    """Every question comes with the accepted trials so far, on the heightmap that they make."""
    questions: list[tuple[int, ...]] = []

    def rule(trial: Trial, placed: tuple[Trial, ...]) -> bool:
        questions.append(tuple(id(p) for p in placed))
        return by_lot(0.7)(trial, placed)

    judge = Judge(rule)
    planned = planner(shelf, judge)
    packing = planned.pack(NAMES, shelf.prepared, BOX)
    surfaces = {id(s): k + 1 for k, s in enumerate(packing.surfaces)}
    accepted = [id(t) for t, _ in judge.asked if by_lot(0.7)(t, ())]
    assert len(accepted) == len(packing.placements)
    for state, (_, surface) in zip(questions, judge.asked, strict=True):
        n = len(state)
        assert state == tuple(accepted[:n])
        assert surfaces.get(id(surface), 0) == n
    assert poses(planned.pack(NAMES, shelf.prepared, BOX)) == poses(packing)


# ------------------------------------------------------------------------------------------------ counts


@pytest.mark.parametrize("max_checked", [1, 7, 100])
@pytest.mark.parametrize("search", ["3d", "5d"])
def test_a_constraint_that_rejects_everything_leaves_everything(
    search: str, max_checked: int, shelf: ItemShelf
) -> None:
    """N candidates of every orientation set are asked: the stable poses, then each perturbation."""
    judge = Judge(no)
    planned = planner(shelf, judge, search=search, max_checked=max_checked)
    packing = planned.pack(["brick", "tile"], shelf.prepared, BOX)
    empty = ContainerMap.empty(BOX, GRID.cell_size)
    assert not packing.placements
    asked = Counter(trial.oriented.item for trial, _ in judge.asked)
    for left in packing.leftovers:
        groups = _groups(shelf, left.item)
        sets = [shelf.prepared[left.item].orientations, *groups]
        if search == "5d":
            sets = [[o for group in groups for o in group]]
        wanted = sum(min(max_checked, count(empty, s)) for s in sets)
        assert left.reason == "no-packable-candidate"
        assert left.rejections == {"no": wanted} == {"no": asked[left.item]}
        assert f"{wanted} no" in left.detail
    assert [left.item for left in packing.leftovers] == ["brick", "tile"]


@pytest.mark.parametrize("share", [0.3, 0.9, 0.99])
def test_counts_add_up(share: float, shelf: ItemShelf) -> None:
    judge = Judge(by_lot(share))
    packing = planner(shelf, judge, max_checked=20).pack(NAMES, shelf.prepared, BOX)
    total = 0
    for placement in packing.placements:
        assert sum(placement.rejections.values()) == placement.checked - 1
        assert set(placement.rejections) <= {"no"}
        total += placement.checked
    for left in packing.leftovers:
        total += sum(left.rejections.values())
    assert total == len(judge.asked)
    if share == 0.99:
        assert any(placement.checked > 20 for placement in packing.placements)


def test_an_objection_takes_no_candidate_s_turn(shelf: ItemShelf) -> None:
    """With all poses but one objected to, the same is asked as if the item had that pose alone."""
    brick = shelf.prepared["brick"]
    single = dataclasses.replace(
        brick, orientations=tuple(o for o in brick.orientations if o.pose_index == 1)
    )
    alone = Judge(no)
    planner(shelf, alone, tilting=False, max_checked=9).pack(["brick"], {"brick": single}, BOX)
    judge = Judge(no, objects_to=lambda oriented: oriented.pose_index != 1)
    packing = planner(shelf, judge, tilting=False, max_checked=9).pack(["brick"], shelf.prepared, BOX)
    assert [(t.oriented, t.ix, t.iy) for t, _ in judge.asked] == [
        (t.oriented, t.ix, t.iy) for t, _ in alone.asked
    ]
    objected = len(brick.orientations) - len(single.orientations)
    assert packing.leftovers[0].rejections == {"orientation-objection": objected, "no": 9}


def test_checked_is_what_was_put_to_the_constraints(shelf: ItemShelf) -> None:
    judge = Judge(lambda trial, placed: trial.ix > 0, objects_to=lambda oriented: oriented.pose_index != 1)
    (placement,) = planner(shelf, judge).pack(["brick"], shelf.prepared, BOX).placements
    assert placement.checked == len(judge.asked)


def test_an_objection_to_everything_asks_nothing(shelf: ItemShelf) -> None:
    judge = Judge(yes, objects_to=lambda oriented: oriented.item == "can")
    packing = planner(shelf, judge).pack(["can", "brick"], shelf.prepared, BOX)
    assert [p.item for p in packing.placements] == ["brick"]
    assert "can" not in {trial.oriented.item for trial, _ in judge.asked}
    (left,) = packing.leftovers
    assert left.reason == "no-usable-orientation"
    orientations = len(shelf.prepared["can"].orientations) + sum(len(g) for g in _groups(shelf, "can"))
    assert left.rejections == {"orientation-objection": orientations}


# -------------------------------------------------------------------------------------------- fallback


def test_later_in_the_sequence_an_item_may_go(shelf: ItemShelf) -> None:
    """Alg. 4 line 15: the book fails, the brick and the can go in, then the book goes in at a stable pose."""

    def once_the_brick_is_in(trial: Trial, placed: tuple[Trial, ...]) -> bool:
        return trial.oriented.item != "book" or any(p.oriented.item == "brick" for p in placed)

    judge = Judge(once_the_brick_is_in)
    packing = planner(shelf, judge, max_checked=6).pack(["book", "brick", "can"], shelf.prepared, BOX)
    assert [(p.item, p.route) for p in packing.placements] == [
        ("brick", "first-pass"),
        ("can", "first-pass"),
        ("book", "later"),
    ]
    book = packing.placements[-1]
    assert (book.rejections, book.checked) == ({"no": 6}, 7)
    assert is_stable_pose(judge.asked[-1][0].oriented, shelf.prepared["book"])
    # It goes where it would have gone had it come last, whatever was rejected before.
    last = planner(shelf, Judge(yes)).pack(["brick", "can", "book"], shelf.prepared, BOX)
    np.testing.assert_allclose(book.position, last.placements[-1].position, atol=1e-12)


def test_the_fallback_keeps_the_sequence_of_the_failed(shelf: ItemShelf) -> None:
    def after_the_cup(trial: Trial, placed: tuple[Trial, ...]) -> bool:
        return trial.oriented.item == "cup" or any(p.oriented.item == "cup" for p in placed)

    names = ["book", "can", "brick", "can", "cup"]
    packing = planner(shelf, Judge(after_the_cup), max_checked=2).pack(names, shelf.prepared, BOX)
    assert [(p.item, p.instance, p.route) for p in packing.placements] == [
        ("cup", 1, "first-pass"),
        ("book", 1, "later"),
        ("can", 1, "later"),
        ("brick", 1, "later"),
        ("can", 2, "later"),
    ]


def test_perturbed_orientations_come_last_and_in_their_sequence(shelf: ItemShelf) -> None:
    """Stable poses are asked twice, then one roll and pitch offset after another, until one passes."""
    groups = _groups(shelf, "can")
    wanted = 3

    def rule(trial: Trial, placed: tuple[Trial, ...]) -> bool:
        return any(trial.oriented is o for o in groups[wanted])

    judge = Judge(rule)
    (placement,) = planner(shelf, judge, max_checked=4).pack(["can"], shelf.prepared, BOX).placements
    assert placement.route == "5d"
    sets = [shelf.prepared["can"].orientations, *groups]
    of_trial = [
        next(k for k, s in enumerate(sets) if any(trial.oriented is o for o in s)) for trial, _ in judge.asked
    ]
    assert of_trial == [k for k in range(wanted + 1) for _ in range(4)] + [wanted + 1]
    assert placement.checked == 4 * (wanted + 1) + 1


def test_routes_are_as_they_are_defined(shelf: ItemShelf) -> None:
    for search in ("3d", "5d"):
        packing = planner(shelf, Judge(by_lot(0.9)), search=search, max_checked=10).pack(
            NAMES * 2, shelf.prepared, BOX
        )
        routes = {p.route for p in packing.placements}
        if search == "5d":
            assert routes == {"5d"}
            continue
        assert routes == {"first-pass", "later", "5d"}
        for p in packing.placements:
            stable = any(
                np.allclose(o.rotation, p.rotation, atol=1e-9) for o in shelf.prepared[p.item].orientations
            )
            assert stable == (p.route != "5d")
        turns = [p.route == "first-pass" for p in packing.placements]
        assert turns == sorted(turns, reverse=True)


def test_without_perturbations_there_is_no_fallback(shelf: ItemShelf) -> None:
    judge = Judge(no)
    packing = planner(shelf, judge, tilting=False).pack(["can"], shelf.prepared, BOX)
    assert len(judge.asked) == 100
    assert packing.leftovers[0].rejections == {"no": 100}


# --------------------------------------------------------------------------------------------- restarts


def test_a_restart_puts_first_what_failed(shelf: ItemShelf) -> None:
    """The can only goes on the empty floor: planned anew with it first, the order is complete."""

    def can_first(trial: Trial, placed: tuple[Trial, ...]) -> bool:
        return trial.oriented.item != "can" or not placed

    names = ["book", "brick", "can"]
    for restarts, wanted in ((0, ["book", "brick"]), (1, ["can", "book", "brick"])):
        packing = planner(shelf, Judge(can_first), max_checked=3, restarts=restarts).pack(
            names, shelf.prepared, BOX
        )
        assert [p.item for p in packing.placements] == wanted
        assert {p.route for p in packing.placements} == {"first-pass"}


@pytest.mark.parametrize("share", [0.3, 0.98])
def test_restarts_never_place_fewer(share: float, shelf: ItemShelf) -> None:
    placed = []
    for restarts in (0, 1, 3):
        packing = planner(shelf, Judge(by_lot(share)), max_checked=3, restarts=restarts, tilting=False).pack(
            NAMES, shelf.prepared, BOX
        )
        placed.append(len(packing.placements))
        pieces = [(p.item, p.instance) for p in (*packing.placements, *packing.leftovers)]
        assert len(set(pieces)) == len(pieces) == len(NAMES)
    assert placed == sorted(placed)


@pytest.mark.parametrize("share", [0.0, 0.9, 0.99])
def test_the_last_resort_is_for_orders_that_no_restart_completes(share: float, shelf: ItemShelf) -> None:
    """And never places fewer: a judge that refuses many is asked in the tiers, one that refuses none last."""
    strict, lax = Judge(by_lot(share)), Judge(yes)
    rare = (Tier(instead={lax.name: lax}),)
    plans = [
        planner(shelf, strict, tilting=False, strategy=Strategy(restarts=1, last_resorts=resorts))
        for resorts in ((), (rare,))
    ]
    without, resorting = (plan.pack(NAMES, shelf.prepared, BOX) for plan in plans)
    assert len(resorting.placements) >= len(without.placements)
    if without.complete:
        assert not lax.asked
        assert poses(resorting) == poses(without)
    else:
        alone = planner(shelf, Judge(yes), tilting=False).pack(NAMES, shelf.prepared, BOX)
        assert poses(resorting) == poses(alone)


def test_what_cannot_be_helped_is_not_tried_again(shelf: ItemShelf) -> None:
    """Complete orders, items that are too large or cannot be taken: one run."""
    for names in (["brick", "can"], ["brick", "board"]):
        asked = []
        for restarts in (0, 3):
            judge = Judge(yes)
            planner(shelf, judge, restarts=restarts).pack(names, shelf.prepared, BOX)
            asked.append(len(judge.asked))
        assert asked[0] == asked[1]


# ------------------------------------------------------------------------------------------- 5D search


@pytest.mark.parametrize("heuristic", FIXED)
def test_more_orientations_never_score_worse(heuristic: str, shelf: ItemShelf) -> None:
    """The stable poses are among those of the 5D search."""
    for name in ("book", "can", "cup"):
        scores = {}
        for search in ("3d", "5d"):
            planned = planner(shelf, heuristic=heuristic, search=search)
            (placement,) = planned.pack([name], shelf.prepared, BOX).placements
            scores[search] = placement.score
        assert scores["5d"] <= scores["3d"] + 1e-9


def plain_5d(
    shelf: ItemShelf, names: Sequence[str], judge: Judge, heuristic: str, max_checked: int
) -> list[tuple[Any, ...]]:
    """The 5D search without any short cut: every candidate scored, sorted, and asked in turn.

    Returns, for each item, (corner, rotation, score, candidates, rejections); without a place, rejections.
    """
    surface, state = ContainerMap.empty(BOX, GRID.cell_size), judge.start()
    rng = np.random.default_rng(0)
    answers: list[tuple[Any, ...]] = []
    for name in names:
        everything = [o for group in _groups(shelf, name) for o in group]
        found = searched(surface, everything)
        scores = HEURISTICS[heuristic](found, rng)
        rejections, objected = Counter[str](), set()
        placed = None
        barred = [judge.objects_to(grid.oriented) for grid in found.grids]
        for k in np.argsort(scores, kind="stable"):
            if rejections["no"] == max_checked:
                break
            grid = int(found.grid_index[k])
            if barred[grid]:
                objected.add(grid)
                continue
            trial = Trial(found.grids[grid].oriented, int(found.ix[k]), int(found.iy[k]), float(found.z[k]))
            if judge.rule(trial, state):
                placed = (trial, float(scores[k]))
                break
            rejections["no"] += 1
        rejections["orientation-objection"] = len(objected)
        if placed is None:
            answers.append((dict(+rejections),))
            continue
        trial, score = placed
        surface = surface.with_item(trial.oriented, trial.ix, trial.iy, trial.z)
        state = (*state, trial)
        answers.append(
            (trial.corner.tolist(), trial.oriented.rotation.tolist(), score, len(found), dict(+rejections))
        )
    return answers


def picky(share: float) -> Callable[[OrientedItem], bool]:
    """Object to this share of orientations, the same ones at every call."""

    def objects(oriented: OrientedItem) -> bool:
        digest = np.frombuffer((np.round(oriented.rotation, 4) + 0.0).tobytes(), dtype=np.uint32)
        return bool(np.random.default_rng([int(d) for d in digest]).random() < share)

    return objects


@pytest.mark.parametrize("heuristic", sorted(HEURISTICS))
@pytest.mark.parametrize(
    ("rejected", "objected", "max_checked"),
    [(0.0, 0.0, 100), (0.9, 0.3, 100), (0.97, 0.97, 20), (0.9, 0.9, 3), (0.5, 1.0, 5), (1.0, 0.5, 7)],
)
def test_the_5d_search_is_the_plain_search(
    rejected: float, objected: float, max_checked: int, heuristic: str, shelf: ItemShelf
) -> None:
    """Same places, same scores, same counts, though few orientations are asked about."""
    names = ["book", "can", "cup", "brick", "tile"]
    judge = Judge(by_lot(rejected), objects_to=picky(objected))
    planned = planner(shelf, judge, heuristic=heuristic, search="5d", max_checked=max_checked)
    packing = planned.pack(names, shelf.prepared, BOX)
    wanted = dict(zip(names, plain_5d(shelf, names, judge, heuristic, max_checked), strict=True))
    assert len(packing.placements) + len(packing.leftovers) == len(names)
    for p in packing.placements:
        found = (p.corner.tolist(), p.rotation.tolist(), p.score, p.candidates, p.rejections)
        assert found == wanted[p.item]
    for left in packing.leftovers:
        assert (left.rejections,) == wanted[left.item]


@pytest.mark.parametrize("heuristic", ["hm", "dblf", "mta", "minz"])
def test_asking_late_and_asking_first_place_alike(heuristic: str, shelf: ItemShelf) -> None:
    """As if the orientations that are objected to were not there."""
    names = ["book", "can", "cup", "brick"]
    late = planner(
        shelf, Judge(by_lot(0.8), objects_to=picky(0.8)), heuristic=heuristic, search="5d", max_checked=30
    ).pack(names, shelf.prepared, BOX)
    without = dataclasses.replace(
        planner(shelf, Judge(by_lot(0.8)), heuristic=heuristic, search="5d", max_checked=30),
        perturbations=lambda name: [[o for o in g if not picky(0.8)(o)] for g in _groups(shelf, name)],
    ).pack(names, shelf.prepared, BOX)
    assert [pose[:-1] for pose in poses(late)] == [pose[:-1] for pose in poses(without)]
    assert [p.checked for p in late.placements] == [p.checked for p in without.placements]
    assert len(late.placements) >= 2


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
def test_5d_plans_are_legal(constraints: Constraints, shelf: ItemShelf) -> None:
    names = ["book", "brick", "can", "cup"]
    options = PlanOptions(constraints=constraints, search="5d", grid=GRID)
    packing = assemble(options, shelf, BOX).pack(names, shelf.prepared, BOX)
    assert packing.complete
    assert {p.route for p in packing.placements} == {"5d"}
    plan = _plan(packing, names)
    assert audit_plan(plan, MESHES).ok
    assert _again(plan, shelf, constraints, "paper").ok


# ------------------------------------------------------------------------------------ real constraints


def _plan(packing: Packing, names: Sequence[str], options: PlanOptions | None = None) -> Plan:
    lines = tuple(OrderLine(name, n) for name, n in Counter(names).items())
    return make_plan(packing, lines, shelf_of(MESHES, GRID), options or PlanOptions(grid=GRID))


def _again(plan: Plan, shelf: ItemShelf, constraints: Constraints, stability: StabilityRule) -> Recheck:
    options = PlanOptions(constraints=constraints, stability=stability, grid=GRID)
    return recheck(plan, MESHES, shelf.fields, options)


def _planned(
    shelf: ItemShelf,
    names: Sequence[str],
    container: Container = BOX,
    *,
    margins: bool = False,
    **options: Any,
) -> Packing:
    planner = assemble(PlanOptions(**options, grid=GRID), shelf, container, margins=margins)
    return planner.pack(names, shelf.prepared, container)


@pytest.mark.parametrize("heuristic", sorted(HEURISTICS))
def test_same_seed_same_plan_under_robot_constraints(heuristic: str, shelf: ItemShelf) -> None:
    def document(seed: int) -> str:
        packing = _planned(shelf, NAMES, heuristic=heuristic, seed=seed, margins=True)
        options = PlanOptions(heuristic, seed=seed, grid=GRID)
        return json.dumps(plan_to_json(_plan(packing, NAMES, options)), allow_nan=False)

    one = document(3)
    assert one == document(3)
    steps = [json.loads(text)["steps"] for text in (one, document(4))]
    assert (steps[0] != steps[1]) == (heuristic == "random")


@pytest.mark.parametrize(
    ("heuristic", "stability"), [*((name, "paper") for name in sorted(HEURISTICS)), ("hm", "margin")]
)
def test_every_prefix_of_the_pile_stands(stability: str, heuristic: str, shelf: ItemShelf) -> None:
    """From nothing: contacts of the exact surfaces, not thinned, no forces of the step before."""
    names = NAMES if stability == "paper" else NAMES[:4]
    packing = _planned(
        shelf, names, heuristic=heuristic, constraints="stability", stability=stability, seed=1
    )
    assert len(packing.placements) >= 4
    bodies: list[Body] = []
    contacts = no_contacts()
    for step, p in enumerate(packing.placements, start=1):
        body = Body(shelf.fields[p.item], p.rotation, p.position)
        contacts = join([contacts, item_contacts(body, bodies, BOX, index=step)])
        bodies.append(body)
        placed = packing.placements[:step]
        masses = [MESHES[q.item].mass for q in placed]
        coms = np.array([q.rotation @ MESHES[q.item].com + q.position for q in placed])
        assert StabilityChecker().check(contacts, masses, coms).stable
        if stability == "margin":
            tilted = check_margin(StabilityChecker(), contacts, masses, coms, MARGIN)
            assert [result.stable for result in tilted] == [True] * 8


@pytest.mark.parametrize("heuristic", ["hm", "mta", "random"])
def test_piles_with_a_margin_also_stand_by_the_paper_s_rule(heuristic: str, shelf: ItemShelf) -> None:
    packing = _planned(shelf, NAMES, heuristic=heuristic, stability="margin", seed=2)
    plan = _plan(packing, NAMES)
    for rule in ("paper", "cautious", "margin"):
        assert _again(plan, shelf, "robot", rule).ok


@pytest.mark.parametrize("clearance", [0.0, 0.008])
def test_a_cautious_plan_does_without_a_margin_only_for_what_comes_last(
    clearance: float, shelf: ItemShelf
) -> None:
    """What is placed in the first pass stands alone by the margin rule, asked again from nothing."""
    options = PlanOptions(constraints="stability", stability="cautious", clearance=clearance, grid=GRID)
    planner = assemble(options, shelf, BOX)
    names = [*["ball"] * (2 if clearance else 7), *NAMES]
    packing = planner.pack(names, shelf.prepared, BOX)
    assert packing.complete
    assert all(("clearance_m" in p.details) == (clearance > 0.0) for p in packing.placements)
    for rule in ("paper", "cautious"):
        assert _again(_plan(packing, names), shelf, "stability", rule).ok
    routes = [p.route for p in packing.placements]
    waited = next((i for i, route in enumerate(routes) if route != "first-pass"), len(routes))
    assert (waited < len(routes)) == (clearance > 0.0)
    (alone,) = (planner.strategy.roomy or planner.strategy).first[0].rules(planner.constraints)
    assert alone is not planner.constraints[0]
    state = alone.start()
    for p, surface in zip(
        packing.placements[:waited],
        (ContainerMap.empty(BOX, GRID.cell_size), *packing.surfaces),
        strict=False,
    ):
        oriented = next(o for o in shelf.prepared[p.item].orientations if np.all(o.rotation == p.rotation))
        ix, iy = np.rint(p.corner[:2] / GRID.cell_size).astype(int)
        verdict = alone.check(Trial(oriented, int(ix), int(iy), p.corner[2]), surface, state)
        assert verdict.ok, verdict.reason
        state = verdict.state


@pytest.mark.parametrize(("search", "clearance"), [("3d", 0.0), ("3d", 0.008), ("5d", 0.0), ("5d", 0.008)])
def test_what_has_no_margin_anywhere_is_packed_even_so(
    search: str, clearance: float, shelf: ItemShelf, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Under a tilt beyond the angle of friction everything slides."""
    steep = MarginRule(tilt_deg=math.degrees(math.atan(MARGIN.mu)) + 2.0, mu=MARGIN.mu)
    monkeypatch.setattr("packenv.planning.assembly.MARGIN", steep)
    names = ["book", "brick", "tile"]
    choice: dict[str, Any] = {"constraints": "stability", "search": search}
    packing = _planned(shelf, names, **choice, clearance=clearance, stability="cautious")
    assert packing.complete
    assert {p.route for p in packing.placements} == {"later" if search == "3d" else "5d"}
    assert all(("clearance_m" in p.details) == bool(clearance) for p in packing.placements)
    assert not _planned(shelf, names, **choice, stability="margin").placements


@pytest.mark.parametrize("seed", range(4))
def test_caution_costs_no_item(seed: int, shelf: ItemShelf) -> None:
    """In boxes that are too small for most orders."""
    names = [name for name in MESHES if name not in ("board", "block")]
    order = np.random.default_rng(seed).choice(names, 9).tolist()
    small = Container(0.14, 0.12, 0.10)
    packed = {
        rule: len(_planned(shelf, order, small, constraints="stability", stability=rule).placements)
        for rule in ("paper", "cautious")
    }
    assert packed["cautious"] >= packed["paper"] > 0


def test_details_of_a_step(shelf: ItemShelf) -> None:
    """Forces carry the item's weight, the joints lead over the release to the placement."""
    packing = _planned(shelf, ["book", "brick"], margins=True)
    for p in packing.placements:
        stability, path = p.details["stability"], p.path
        assert path is not None
        assert stability["contacts"] >= len(stability["forces"]) >= 2  # opposite corners can carry it
        assert 0.0 <= stability["margin_deg"] <= 45.0
        low, high = p.corner - 0.002, p.corner + p.extents + 0.002
        for force in stability["forces"]:
            assert np.all((low <= force["at"]) & (force["at"] <= high))
        joints, heights = path.joints, path.cup_heights
        assert joints.shape == (len(heights), 6)
        assert np.all(np.diff(heights) < 0)
        assert heights[-1] == pytest.approx(path.grasp[2], abs=1e-9)
        assert heights[-2] - heights[-1] == pytest.approx(0.01, abs=1e-9)
    top = packing.placements[-1]
    lift = sum(force["force"][2] for force in top.details["stability"]["forces"])
    assert lift == pytest.approx(MESHES[top.item].mass * 9.81, rel=1e-3)


def test_a_ball_on_a_flat_floor_stands_for_the_paper_and_not_with_a_margin(shelf: ItemShelf) -> None:
    """The paper's check is too optimistic for balls: a push rolls them away.

    Away from the walls: in a corner, friction between two walls and the floor can hold a ball, and both rules
    accept it.
    """
    empty = ContainerMap.empty(BOX, GRID.cell_size)
    trial = Trial(shelf.prepared["ball"].orientations[0], 15, 15, 0.0)
    verdicts = {}
    for rule in ("paper", "margin"):
        options = PlanOptions(constraints="stability", stability=rule, grid=GRID)
        (constraint,) = assemble(options, shelf, BOX).constraints
        verdicts[rule] = constraint.check(trial, empty, constraint.start())
    assert verdicts["paper"].ok
    assert (verdicts["margin"].ok, verdicts["margin"].reason) == (False, "unstable-new-item")


def test_an_item_without_a_graspable_spot_says_so(shelf: ItemShelf) -> None:
    packing = _planned(shelf, ["brick", "stick"])
    assert [p.item for p in packing.placements] == ["brick"]
    (left,) = packing.leftovers
    assert (left.item, left.reason) == ("stick", "no-graspable-spot")
    assert set(left.rejections) == {"orientation-no-grasp"}
    assert _planned(shelf, ["brick", "stick"], constraints="stability").complete


def test_a_graspable_item_that_is_too_large_is_too_large(shelf: ItemShelf) -> None:
    """A board can be taken lying and not on its edge; it fits neither way."""
    (left,) = _planned(shelf, ["board"]).leftovers
    assert left.reason == "larger-than-container"


def test_a_graspable_item_that_finds_no_room_finds_no_room(shelf: ItemShelf) -> None:
    """A tile can be taken lying; beside and on the block there is no room for it in any pose."""
    block = Container(0.19, 0.19, 0.11)
    packing = _planned(shelf, ["block", "tile"], block)
    assert [p.item for p in packing.placements] == ["block"]
    assert packing.leftovers[0].reason == "no-legal-candidate"


def test_no_graspable_spot_in_any_orientation_that_fits(shelf: ItemShelf) -> None:
    """A slit takes a book on its edge alone; with an edge of 1 cm, the cup cannot."""
    (left,) = _planned(shelf, ["tile"], Container(0.2, 0.02, 0.2)).leftovers
    assert left.reason == "no-graspable-spot"


def test_the_floor_of_a_deep_container_is_out_of_reach(shelf: ItemShelf) -> None:
    """The gripper is 30 cm long: an arm that stays above the rim cannot put a brick 1.4 m below it."""
    deep = Container(0.2, 0.2, 1.5)
    packing = _planned(shelf, ["brick"], deep, max_checked=5)
    (left,) = packing.leftovers
    assert left.reason == "unreachable-container"
    assert not left.rejections  # it is said before any search
    assert _planned(shelf, ["brick"], deep, constraints="stability").complete


@pytest.mark.parametrize("size", [(2.0, 2.0, 2.0), (0.05, 0.05, 0.05), (2.0, 0.05, 0.05), (0.02, 0.02, 0.02)])
def test_odd_containers_give_an_answer(size: tuple[float, float, float], shelf: ItemShelf) -> None:
    packing = _planned(shelf, ["tile"], Container(*size), heuristic="dblf")
    assert len(packing.placements) + len(packing.leftovers) == 1
    for left in packing.leftovers:
        if left.reason == "unreachable-container":
            assert packing.container.label in left.detail
            continue
        assert left.reason in {"no-packable-candidate", "larger-than-container", "no-graspable-spot"}
        assert "tile" in left.detail
