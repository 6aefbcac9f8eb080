"""Several rules, one plan: never worse than the rules alone, and no more of them asked than can matter."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import packenv as rp
from packenv.agents.planner import PlannerAgent
from packenv.config import GridConfig
from packenv.env.config import PackConfig
from packenv.errors import InputError
from packenv.execution.planning_job import PlanningJob
from packenv.execution.smallest_box import pack_smallest
from packenv.planning.assembly import MEMBERS, heuristic_of
from packenv.planning.options import SINGLE_RULES, PlanOptions
from packenv.planning.packing import Packing
from packenv.planning.planner import Planner
from packenv.planning.portfolio import Portfolio, goal
from packenv.planning.search.measured import Resting
from packenv.types import Container, Leftover, Placement
from tests.shapes import box
from tests.shelf_samples import shelf_of

GRID = GridConfig(cell_size=0.004, grid_step=0.02, n_poses=2, n_yaws=2)
BOX = Container(0.20, 0.16, 0.12)
TIGHT = Container(0.16, 0.12, 0.12)
_SIZES = np.random.default_rng(5).integers(2, 11, (12, 3)) * 0.01
SHELF = shelf_of({f"b{k:02}": box(*size, f"b{k:02}") for k, size in enumerate(_SIZES.tolist())}, GRID)
NAMES = sorted(SHELF.items)


def job_of(**words: Any) -> PlanningJob:
    return PlanningJob(SHELF, PlanOptions(**{"constraints": "overlap", "grid": GRID, **words}))


def packed(names: list[str], box: Container = BOX, **words: Any) -> Packing:
    job = job_of(**words)
    job.load(names)
    return job.pack(box, job.sequence(names))


def where(packing: Packing) -> list[tuple[str, bytes, bytes]]:
    return [(p.item, p.rotation.tobytes(), p.position.tobytes()) for p in packing.placements]


def drawn(seed: int, most: int = 12) -> list[str]:
    rng = np.random.default_rng(seed)
    return [str(name) for name in rng.choice(NAMES, rng.integers(2, most))]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0, 3]), st.sampled_from([BOX, TIGHT]))
def test_no_member_alone_packs_more(seed: int, restarts: int, box: Container) -> None:
    names = drawn(seed)
    found = packed(names, box, restarts=restarts)
    alone = {name: packed(names, box, restarts=restarts, heuristic=name) for name in MEMBERS}
    assert len(found.placements) == max(len(packing.placements) for packing in alone.values())
    assert found.made_by in MEMBERS
    if not found.complete:
        assert goal(found) >= max(goal(packing) for packing in alone.values())


@pytest.mark.parametrize("constraints", ["stability", "robot"])
@pytest.mark.parametrize("seed", range(6))
def test_no_member_alone_packs_more_under_constraints(constraints: str, seed: int) -> None:
    names = drawn(seed, 9)
    words = {"constraints": constraints, "restarts": seed % 2}
    found = packed(names, **words)
    alone = [packed(names, heuristic=name, **words) for name in MEMBERS]
    assert len(found.placements) == max(len(packing.placements) for packing in alone)


def test_no_member_wins_everywhere() -> None:
    """So that the laws above say something."""
    winners = Counter(packed(drawn(seed), TIGHT, restarts=0).made_by for seed in range(60))
    assert len(winners) > 2


@pytest.mark.parametrize("seed", range(10))
def test_the_plan_is_that_of_the_rule_that_it_names(seed: int) -> None:
    names = drawn(seed)
    found = packed(names, TIGHT)
    assert where(found) in [
        where(packed(names, TIGHT, heuristic=found.made_by, restarts=restarts)) for restarts in (0, 3)
    ]
    assert where(found) == where(packed(names, TIGHT))


def test_an_order_that_the_first_member_packs_is_planned_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []
    pack = Planner.pack
    monkeypatch.setattr(
        Planner, "pack", lambda self, *given: asked.append(self.heuristic) or pack(self, *given)
    )
    found = packed(NAMES[:2])
    assert found.complete
    assert (found.made_by, len(asked)) == (MEMBERS[0], 1)


def test_nothing_is_planned_again_that_would_be_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """An item larger than the container is left over whatever the rule and the sequence."""
    asked: list[object] = []
    pack = Planner.pack
    monkeypatch.setattr(
        Planner, "pack", lambda self, *given: asked.append(self.heuristic) or pack(self, *given)
    )
    longest = max(NAMES, key=lambda name: float(np.max(SHELF.items[name].vertices)))
    assert not packed([longest, *NAMES[:1]], Container(0.04, 0.04, 0.04)).complete
    assert len(asked) == len(MEMBERS)


def placement(top: float, margin: float | None = None) -> Placement:
    details: dict[str, object] = {} if margin is None else {"stability": {"margin_deg": margin}}
    size = np.array([0.1, 0.1, top])
    return Placement(
        "b00", 1, np.eye(3), np.zeros(3), np.zeros(3), size, 0, 0.0, 0.0, 1, details=details
    )  # fmt: skip


def packing(*placements: Placement, risk: float = 0.0) -> Packing:
    return Packing(BOX, placements, (Leftover("b01", 1, "no-legal-candidate", ""),), (), 0.0, risk=risk)


def test_the_goal_is_items_then_risk_then_height_then_margin() -> None:
    best_last = [
        packing(),
        packing(placement(0.01, 45.0)),
        packing(placement(0.01), placement(0.02), risk=2.0),
        packing(placement(0.01), placement(0.05), risk=1.0),
        packing(placement(0.01), placement(0.05)),
        packing(placement(0.01), placement(0.04)),
        packing(placement(0.01, 3.0), placement(0.04, 20.0)),
        packing(placement(0.01, 5.0), placement(0.04, 9.0)),
    ]
    assert sorted(best_last, key=goal) == best_last
    assert len({goal(found) for found in best_last}) == len(best_last)


def test_a_box_that_one_rule_gives_up_is_taken_by_another() -> None:
    boxes = [TIGHT, Container(0.20, 0.20, 0.20)]
    taken: dict[str, list[float]] = {name: [] for name in ("auto", *MEMBERS)}
    for seed in range(25):
        names = drawn(seed, 8)
        for name, volumes in taken.items():
            job = job_of(heuristic=name)
            job.load(names)
            found = pack_smallest(job, boxes, job.sequence(names))
            volumes.append(found.container.volume if found.complete else np.inf)
    assert taken["auto"] == np.min([taken[name] for name in MEMBERS], axis=0).tolist()
    assert TIGHT.volume in taken["auto"]
    assert any(taken["auto"] != taken[name] for name in MEMBERS)


def test_the_rest_is_planned_on_what_lies_there() -> None:
    job = job_of()
    names = NAMES[:5]
    job.load(names)
    lying = [Resting(SHELF.shapes[names[0]], np.eye(3), np.zeros(3))]
    found, _ = job.pack_onto(BOX, names[1:], lying)
    assert found.made_by in MEMBERS
    alone, _ = job_of(heuristic=found.made_by).pack_onto(BOX, names[1:], lying)
    assert where(found) == where(alone)


def test_members_differ_in_their_rule_alone() -> None:
    job = job_of(constraints="robot", tie_break=0.5)
    made = job.packer(BOX)
    assert isinstance(made, Portfolio)
    assert [member.heuristic for member in made.members] == [
        heuristic_of(PlanOptions(heuristic=name, tie_break=0.5)) for name in MEMBERS
    ]
    first = made.members[0]
    for member in made.members:
        assert vars(replace(member, heuristic=first.heuristic)) == vars(first)


@pytest.mark.parametrize(
    "words",
    [
        {"heuristic": "hm"},
        {"heuristic": lambda candidates, rng: candidates.z},
        {"stability": "physics", "constraints": "robot"},
    ],
    ids=["one rule", "an own rule", "physics"],
)
def test_one_rule_or_physics_has_one_planner(words: dict[str, Any]) -> None:
    made = job_of(**words).packer(BOX)
    assert isinstance(made, Planner)
    if "stability" in words:
        assert made.heuristic == heuristic_of(PlanOptions(heuristic="hm"))


def test_auto_is_the_default_and_the_paper_s_preset_is_hm() -> None:
    assert PlanOptions().heuristic == "auto"
    paper = PlanOptions.paper()
    assert (paper.heuristic, paper.tie_break) == ("hm", 1.0)


def test_a_plan_says_which_rule_it_is_by() -> None:
    items = {name: SHELF.items[name] for name in NAMES[:3]}
    options = PlanOptions(constraints="overlap", grid=GRID)
    plan = rp.plan(rp.Order.of(*items), BOX, items, options)
    assert plan.settings["heuristic"] == "auto"
    assert plan.made_by == MEMBERS[0]


def test_the_environment_and_its_agents_keep_single_rules() -> None:
    with pytest.raises(InputError, match="heuristics has 'auto'") as told:
        PackConfig(heuristics=("auto",))
    assert all(name in str(told.value) for name in (*SINGLE_RULES, "my_module:my_rule"))
    with pytest.raises(InputError, match="heuristic is 'auto', give one of hm, "):
        PlannerAgent(heuristic="auto")
    assert PackConfig().plan_options().heuristic == "hm"
