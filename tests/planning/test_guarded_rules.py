"""What own rules get wrong changes no plan and ends in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import packenv as rp
from packenv.api import plan
from packenv.config import GridConfig
from tests import shapes
from tests.shelf_samples import shelf_of

ITEMS = {"brick": shapes.box(0.08, 0.06, 0.04, "brick"), "plate": shapes.box(0.1, 0.1, 0.02, "plate")}
SHELF = shelf_of(ITEMS, GridConfig())
BOX = rp.Container(0.2, 0.2, 0.15)
ORDER = rp.Order.of("brick", "plate", "brick")


def planned(**options: Any) -> rp.Plan:
    return plan(ORDER, BOX, SHELF, constraints="overlap", **options)


def grows(candidates: rp.Candidates, rng: np.random.Generator) -> Any:
    scores = candidates.z
    scores += 0.01
    return scores


def fails(candidates: rp.Candidates, rng: np.random.Generator) -> Any:
    return 1 / 0


def leaves(candidates: rp.Candidates, rng: np.random.Generator) -> Any:
    raise SystemExit(3)


class Rule(rp.Constraint):
    def __init__(self, answer: Any = None, *, write: bool = False, **others: Any) -> None:
        self.answer, self.write, self.others = answer, write, others

    def check(self, trial: rp.Trial, surface: Any, state: Any) -> rp.Verdict:
        if self.write:
            surface.heights[:] = 0.1
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def objection(self, oriented: Any) -> Any:
        return self.others.get("objection")

    def for_order(self, items: Any, container: Any) -> Any:
        return self.others.get("for_order", self)


class Top(rp.Constraint):
    def check(self, trial: rp.Trial, surface: Any, state: Any) -> rp.Verdict:
        trial.oriented.top[:] = 0.0
        return rp.Verdict(True)


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        (grows, ("heuristic grows", "read-only", "test_guarded_rules.py:")),
        (fails, ("heuristic fails", "ZeroDivisionError", "test_guarded_rules.py:")),
        (leaves, ("heuristic leaves", "SystemExit")),
        (lambda c: c.z, ("heuristic <lambda>", "2 were given")),
        (lambda c, rng: np.full(len(c), "a"), ("not all finite numbers",)),
        (lambda c, rng: np.ma.masked_less(c.z.astype(float), 1.0), ("not all finite numbers",)),
        (lambda c, rng: c.z[:-1], ("returned an array of shape", "give an array of")),
        (lambda c, rng: list(c.z), ("returned [",)),
    ],
)
def test_a_heuristic(rule: Any, words: tuple[str, ...]) -> None:
    with pytest.raises(rp.InputError) as problem:
        planned(heuristic=rule)
    assert all(word in str(problem.value) for word in words)
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        (Rule(True), ("constraint Rule: check returned True", "packenv.Verdict")),
        (Rule(None), ("check returned None",)),
        (Rule(ValueError("bad luck")), ("ValueError: bad luck", "test_guarded_rules.py:")),
        (Rule(rp.Verdict(True, details={"a": np.zeros(2)})), ("details cannot be written",)),
        (Rule(rp.Verdict(True, details={"a": float("nan")})), ("details cannot be written",)),
        (Rule(rp.Verdict(True), write=True), ("read-only",)),
        (Rule(rp.Verdict(True), objection=True), ("objection returned True",)),
        (Rule(rp.Verdict(True), for_order=3), ("for_order returned 3",)),
        (Top(), ("constraint Top", "read-only")),
    ],
)
def test_a_constraint(rule: rp.Constraint, words: tuple[str, ...]) -> None:
    with pytest.raises(rp.InputError) as problem:
        planned(own_constraints=[rule])
    assert all(word in str(problem.value) for word in words)
    assert "\n" not in str(problem.value)


def test_a_plan_made_here_is_planned_again_with_the_rules_it_was_made_with() -> None:
    made = planned(heuristic=lambda c, rng: c.z, own_constraints=[Rule(rp.Verdict(True))])
    rest = rp.plan_rest(made, [made.placements[0].pose], SHELF)
    assert rest.complete
    assert rest.lying == 1
    assert rp.verify(rest, SHELF).ok
    assert len(rest.placements) == 3


def test_the_stateful_rule_of_the_page_counts() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "own-rules.md").read_text()
    code = page.split("```python\n")[2].split("```")[0]
    names: dict[str, Any] = {}
    exec(code, names)
    order = rp.Order.of(*["brick"] * 6)
    for stability in ("paper", "cautious"):
        rule = names["FewOnTheFloor"]()
        made = plan(order, BOX, SHELF, constraints="stability", stability=stability, own_constraints=[rule])
        low = [p for p in made.placements if p.corner[2] < 0.002]
        assert len(made.placements) > 3
        assert len(low) == 3
    rest = rp.plan_rest(made, [p.pose for p in made.placements[:3]], SHELF)
    assert sum(p.corner[2] < 0.002 for p in rest.placements) <= 3


def test_numbers_of_numpy_are_numbers() -> None:
    options = rp.PlanOptions(seed=np.int64(3), clearance=np.float32(0.01), tie_break=np.float64(1.0))  # type: ignore[arg-type]
    assert options.to_mapping()["seed"] == 3
    assert type(options.seed) is int
    assert type(options.clearance) is float


@pytest.mark.parametrize("given", ["paper", {"stability": "paper"}, rp.PlanOptions.paper()])
def test_options_in_any_form(given: Any) -> None:
    assert plan(ORDER, BOX, SHELF, given, constraints="overlap").settings["stability"] == "paper"
    with pytest.raises(rp.InputError, match="one of default, paper"):
        plan(ORDER, BOX, SHELF, "papr")
