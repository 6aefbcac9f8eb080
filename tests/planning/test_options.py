"""Every option of planning: what it may be, how it is written, and what the paper has."""

from __future__ import annotations

import inspect
import json
import math
import re
from dataclasses import FrozenInstanceError, fields, replace
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given, strategies as st

from packenv.config import GridConfig
from packenv.errors import InputError
from packenv.planning.assembly import assemble, clearances, heuristic_of
from packenv.planning.options import (
    OWN,
    PAPER,
    PRESETS,
    SINGLE_RULES,
    HeuristicName,
    PlanOptions,
    Rule,
    option_names,
    rules,
)
from packenv.planning.packing_pass import MAX_CHECKED
from packenv.planning.search import heuristics as scores
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.paper_contacts import paper_contacts
from packenv.types import Container
from tests.planning import own_rules
from tests.planning.own_rules import Low
from tests.shapes import box
from tests.shelf_samples import shelf_of

HERE = "tests.planning.own_rules"
SCALE = inspect.signature(paper_contacts).parameters["scale"].default


def grids() -> st.SearchStrategy[GridConfig]:
    return st.builds(
        lambda cells, cell, poses, yaws: GridConfig(cell, cell * cells, poses, yaws),
        st.integers(1, 20),
        st.sampled_from([0.001, 0.002, 0.004, 0.005, 0.01]),
        st.integers(1, 9),
        st.integers(1, 16),
    )


def of_rule(rule: Rule) -> st.SearchStrategy[Any]:
    """Right values of an option."""
    if rule.words:
        values: st.SearchStrategy[Any] = st.sampled_from(rule.words)
    elif rule.whole:
        values = st.integers(int(rule.least), int(min(rule.most, 10**9)))
    else:
        values = st.floats(rule.least, min(rule.most, 1e6))
    return st.none() | values if rule.optional else values


@st.composite
def options(draw: st.DrawFn) -> PlanOptions:
    """Any options that have names."""
    values = {name: draw(of_rule(rule)) for name, rule in rules().items()}
    if draw(st.booleans()):
        values["heuristic"] = draw(st.sampled_from([f"{HERE}:deepest", f"{HERE}:flattest", OWN]))
    own = st.sampled_from([f"{HERE}:Low", f"{HERE}:Never", OWN])
    values["own_constraints"] = draw(st.lists(own, max_size=3) | st.tuples(own))
    values["cell"] = draw(st.sampled_from([None, "tx90", "kr10_r1100", {"robot": "tx90", "friction": 0.4}]))
    if values["stability"] == "physics" and values["constraints"] == "overlap":
        values["constraints"] = draw(st.sampled_from(["stability", "robot"]))
    if values["goal"] == "robust" and values["constraints"] == "overlap":
        values["goal"] = "height"
    if values["stability"] == "physics":
        values["budget"] = values["plans"] = None
    if values["stability"] == "physics" or values["rehearse"]:
        values["geometry"] = draw(st.sampled_from([None, "parts"]))
    return PlanOptions(**values, grid=draw(grids()))


# ----------------------------------------------------------------------------------------- in a file


@given(options())
def test_what_options_write_makes_equal_ones(made: PlanOptions) -> None:
    document = json.loads(json.dumps(made.to_mapping(), allow_nan=False))
    again = PlanOptions.from_mapping(document)
    assert again == made
    assert hash(again) == hash(made)
    assert again.to_mapping() == made.to_mapping() == document
    assert again.shape == made.shape == document["geometry"]
    assert tuple(document) == option_names()


@given(options(), options())
def test_different_options_write_different_documents(one: PlanOptions, other: PlanOptions) -> None:
    assert (one == other) == (one.to_mapping() == other.to_mapping())


@given(options(), st.data())
def test_what_is_left_out_keeps_its_default(made: PlanOptions, data: st.DataObject) -> None:
    document = made.to_mapping()
    for name in ("stability", "rehearse", "geometry", "constraints"):  # which depend on each other
        document.pop(name)
    for name in data.draw(st.lists(st.sampled_from(sorted(set(document) - {"cell_size", "grid_step"})))):
        document.pop(name, None)
    again, default = PlanOptions.from_mapping(document), PlanOptions()
    for name, value in again.to_mapping().items():
        assert value == (document[name] if name in document else default.to_mapping()[name])


def test_options_can_be_rehearsed_after_they_were_in_a_file() -> None:
    """The file says what was planned with; that is no wish to plan with nothing else."""
    again = PlanOptions.from_mapping(PlanOptions().to_mapping())
    assert (again.shape, replace(again, rehearse=2).shape) == ("mesh", "parts")
    again = PlanOptions.from_mapping(PlanOptions(stability="physics").to_mapping())
    assert (again.shape, replace(again, stability="paper").shape) == ("parts", "mesh")
    again = PlanOptions.from_mapping(PlanOptions(geometry="parts").to_mapping())
    assert (again.shape, replace(again, rehearse=2).shape) == ("parts", "parts")


@pytest.mark.parametrize(
    ("heuristic", "told", "c"),
    [
        ("hm", "hm", None),
        (scores.HEURISTICS["mta"], "mta", None),
        (scores.HeightmapMinimization(0.5), "hm", 0.5),
        (scores.DeepestBottomLeft(), "dblf", 0.01),
        (own_rules.deepest, f"{HERE}:deepest", None),
        (lambda candidates, rng: candidates.z, OWN, None),
    ],
)
def test_an_own_heuristic_is_written_by_the_name_that_leads_to_it(
    heuristic: Any, told: str, c: float | None
) -> None:
    made = PlanOptions(heuristic=heuristic)
    document = made.to_mapping()
    assert (document["heuristic"], document["tie_break"]) == (told, c)
    again = PlanOptions.from_mapping(document)
    if told != OWN:
        assert heuristic_of(again) == heuristic_of(made)
        return
    with pytest.raises(InputError, match="own heuristic that has no name: give the heuristic again"):
        heuristic_of(again)


def test_an_own_constraint_that_is_an_object_has_no_name_in_a_file() -> None:
    made = PlanOptions(own_constraints=[Low(), f"{HERE}:Low"])
    assert made.to_mapping()["own_constraints"] == [OWN, f"{HERE}:Low"]


# -------------------------------------------------------------------------------------- wrong values


def wrong_values() -> list[tuple[str, object, str]]:
    """Option, a value that it may not be, what the message must say is right."""
    cases: list[tuple[str, object, str]] = []
    for name, rule in rules().items():
        if rule.words:
            right = rule.right
            cases += [(name, value, right) for value in (3, "", "nonsense", True, ["hm"])]
        else:
            right = f"{rule.least:g}"
            values: list[object] = [rule.least - 1, "3", True, [1], math.nan, math.inf, -math.inf]
            values += [1.5] if rule.whole else []
            values += [rule.most * 2] if rule.most < math.inf else []
            cases += [(name, value, right) for value in values]
        if not rule.optional:
            cases.append((name, None, rule.right))
    cases += [
        ("cell_size", "2 mm", "a number from 0.0002 to 0.05"),
        ("cell_size", 1.0, "a number from 0.0002 to 0.05"),
        ("cell_size", math.nan, "a number from 0.0002 to 0.05"),
        ("grid_step", None, "a number from 0"),
        ("grid_step", 0.003, "a multiple of cell_size"),
        ("grid_step", math.inf, "a number from 0"),
        ("grid_step", 0, "a multiple of cell_size"),
        ("n_poses", 0, "a whole number from 1"),
        ("n_yaws", 2.5, "a whole number from 1"),
        ("n_yaws", True, "a whole number from 1"),
        ("own_constraints", "my_module:MyRule", "give a list"),
        ("own_constraints", 3, "give a list"),
        ("own_constraints", None, "give a list"),
        ("own_constraints", ["Low"], "my_module:MyRule"),
        ("own_constraints", [3], "my_module:MyRule"),
        ("own_constraints", [Low], "my_module:MyRule"),
        ("cell", 3, "give a cell file"),
        ("cell", "tx9", "did you mean 'tx90'"),
        ("cell", {"robot": "tx90", "frction": 0.5}, "did you mean 'friction'"),
    ]
    return cases


@pytest.mark.parametrize(("name", "value", "right"), wrong_values(), ids=str)
def test_a_wrong_value_is_told_in_one_line_with_what_would_be_right(
    name: str, value: object, right: str
) -> None:
    with pytest.raises(InputError) as caught:
        PlanOptions.from_mapping({name: value}, "plan.json: settings")
    message = str(caught.value)
    assert message.startswith("plan.json: settings: ")
    assert name in message
    assert right in message
    assert "\n" not in message
    assert len(message) < 300
    if name in rules() or name in ("own_constraints", "cell"):
        with pytest.raises(InputError, match=name):
            PlanOptions(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("grid", [None, 3, {"cell_size": 0.002}])
def test_a_grid_that_is_none_is_told(grid: Any) -> None:
    with pytest.raises(InputError, match=r"grid is .*, give a GridConfig"):
        PlanOptions(grid=grid)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("heurstic", "did you mean 'heuristic'?"),
        ("Stability", "did you mean 'stability'?"),
        ("cellsize", "did you mean 'cell_size'?"),
        ("with_margin", "the options are heuristic, tie_break"),
        ("grid", "the options are|did you mean 'grid_step'"),
        ("x\ny", "the options are"),
        (3, "the options are"),
    ],
)
def test_an_unknown_name_is_told_in_one_line(name: Any, told: str) -> None:
    with pytest.raises(InputError) as caught:
        PlanOptions.from_mapping({name: 1})
    message = str(caught.value)
    assert message.startswith("the options: there is no option ")
    assert any(part in message for part in told.split("|"))
    assert "\n" not in message


@given(st.text(max_size=30))
def test_whatever_word_is_unknown_is_refused(name: str) -> None:
    if name not in option_names():
        with pytest.raises(InputError):
            PlanOptions.from_mapping({name: 1})


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"stability": "physics", "constraints": "overlap"}, "needs force balance"),
        ({"goal": "robust", "constraints": "overlap"}, "goal robust: a margin is one of force balance"),
        ({"stability": "physics", "geometry": "mesh"}, "stability physics: knows convex parts alone"),
        ({"rehearse": 3, "geometry": "mesh"}, "rehearse 3: knows convex parts alone"),
    ],
)
def test_what_contradicts_itself_is_told_in_one_line(given: dict[str, Any], told: str) -> None:
    for made in (PlanOptions, lambda **words: PlanOptions.from_mapping(words)):
        with pytest.raises(InputError) as caught:
            made(**given)
        assert told in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "shape", "asks"),
    [
        ({}, "mesh", False),
        ({"geometry": "mesh"}, "mesh", False),
        ({"geometry": "parts"}, "parts", False),
        ({"stability": "physics"}, "parts", True),
        ({"stability": "physics", "geometry": "parts"}, "parts", True),
        ({"rehearse": 1}, "parts", True),
        ({"rehearse": 1, "constraints": "overlap"}, "parts", True),
    ],
)
def test_physics_is_planned_for_on_convex_parts(given: dict[str, Any], shape: str, asks: bool) -> None:
    made = PlanOptions(**given)
    assert (made.shape, made.asks_physics) == (shape, asks)


def test_options_are_frozen_and_can_be_keys() -> None:
    made = PlanOptions(own_constraints=[f"{HERE}:Low"])
    with pytest.raises(FrozenInstanceError):
        made.seed = 3  # type: ignore[misc]
    assert made.own_constraints == (f"{HERE}:Low",)
    assert {made: 1}[PlanOptions(own_constraints=(f"{HERE}:Low",))] == 1


# ----------------------------------------------------------------------------------- names and words


def test_names_are_those_of_the_heuristics() -> None:
    assert set(get_args(HeuristicName)) == {"auto", *scores.HEURISTICS}
    assert rules()["heuristic"].words == get_args(HeuristicName)
    assert set(SINGLE_RULES) == set(scores.HEURISTICS)
    for name in SINGLE_RULES:
        assert heuristic_of(PlanOptions(heuristic=name)) is scores.HEURISTICS[name]


def test_every_option_has_a_rule_a_meaning_and_a_default_that_keeps_it() -> None:
    bare = {"own_constraints", "cell", "grid"}
    assert set(rules()) == {f.name for f in fields(PlanOptions)} - bare
    assert set(option_names()) == {*rules(), "own_constraints", "cell", *(f.name for f in fields(GridConfig))}
    for name, rule in rules().items():
        assert rule.meaning
        rule.check(name, getattr(PlanOptions(), name))
        assert f"{name}:" in (PlanOptions.__doc__ or "")


def test_presets() -> None:
    assert PRESETS["default"]() == PlanOptions()
    assert PRESETS["paper"]() == PlanOptions.paper()
    for make in PRESETS.values():
        assert make(seed=7).seed == 7
        assert make(seed=7) == replace(make(), seed=7)
        with pytest.raises(InputError):
            make(heuristic="nonsense")


# ----------------------------------------------------------------------------------------- the paper


PAPER_TEXT = Path(__file__).parents[3] / "shared" / "paper" / "stable_bin_packing.tex"


def test_the_paper_s_options_are_what_the_paper_says() -> None:
    """Sec. V: c = 1, cells of 2 mm, steps of 1 cm, yaws of π / 4 in [0, π), 4 poses, 100 candidates."""
    made = PlanOptions.paper()
    assert (made.heuristic, made.tie_break) == ("hm", 1.0)
    assert (made.grid.cell_size, made.grid.grid_step) == (0.002, 0.01)
    assert math.pi / made.grid.n_yaws == pytest.approx(math.pi / 4)
    assert made.grid.n_poses == 4
    assert made.max_checked == MAX_CHECKED == 100
    # Non-overlap, force balance of the pile as it is, and a way for the robot; Alg. 4 with one pass.
    assert (made.constraints, made.own_constraints) == ("robot", ())
    assert (made.stability, made.contacts, made.grasp) == ("paper", "paper", "paper")
    assert (made.search, made.sequence, made.restarts) == ("3d", "volume", 0)
    assert (made.clearance, made.rehearse, made.shape, made.asks_physics) == (0.0, 0, "mesh", False)
    # What the rules of that name hold, beyond options.
    assert StabilityChecker().mu == 0.7
    assert SCALE == 1.03


@pytest.mark.skipif(not PAPER_TEXT.is_file(), reason="the paper is not there")
def test_the_paper_s_options_are_those_of_its_text() -> None:
    text = PAPER_TEXT.read_text(encoding="utf-8", errors="replace")
    made = PlanOptions.paper()

    def number(pattern: str) -> float:
        found = re.search(pattern, text)
        assert found is not None, pattern
        return float(found.group(1))

    assert made.tie_break == number(r"heuristic constant \$c = (\d+)\$")
    assert made.grid.cell_size == number(r"heightmap resolution ([\d.]+)m")
    assert made.grid.grid_step == number(r"step size in both X and Y ([\d.]+)m")
    assert made.grid.n_yaws == number(r"Delta r = pi/(\d+)\$ in range \$\[0,\\pi\)\$")
    assert made.grid.n_poses == number(r"The top (\d+) planar-stable rolls and pitches")
    assert made.max_checked == number(r"Up to (\d+) legal placement candidates are checked")
    assert StabilityChecker().mu == number(r"friction coefficient \$\\mu = ([\d.]+)\$")
    assert number(r"scale factor of ([\d.]+\d)") == SCALE


def test_the_paper_s_constant_is_that_of_the_scores() -> None:
    assert PlanOptions.paper().tie_break == PAPER["tie_break"] == scores.PAPER_CONSTANT
    assert heuristic_of(PlanOptions.paper()) == scores.HeightmapMinimization(scores.PAPER_CONSTANT)
    assert heuristic_of(PlanOptions.paper(heuristic="dblf")) == scores.DeepestBottomLeft(1.0)


def test_the_paper_s_options_but_for_some() -> None:
    assert PlanOptions.paper(heuristic="mta", seed=3) == replace(PlanOptions.paper(), heuristic="mta", seed=3)
    assert PlanOptions.paper(rehearse=2).shape == "parts"
    assert PlanOptions.paper(stability="physics").shape == "parts"
    assert PlanOptions().grid == PlanOptions.paper().grid


def test_the_paper_s_planner_has_one_pass_with_its_fallback_and_no_more() -> None:
    shelf = shelf_of({"cube": box(0.05, 0.05, 0.03, "cube")}, GridConfig())
    made = assemble(PlanOptions.paper(), shelf, Container(0.2, 0.2, 0.2))
    (tier,) = made.strategy.first
    assert tier.rules(made.constraints) == tuple(made.constraints)
    assert (tier.clearance, tier.each, tier.max_checked, tier.risk) == (0, None, None, 0.0)
    assert (made.strategy.fallback, made.strategy.restart_tiers) == (None, None)
    assert (made.strategy.restarts, list(made.strategy.last_resorts), made.strategy.clearance) == (0, [], 0)
    assert made.perturbations is not None
    assert (made.search, made.max_checked, made.give_up) == ("3d", 100, False)
    assert [constraint.name for constraint in made.constraints] == ["stability", "manipulation"]


@pytest.mark.parametrize(
    ("clearance", "cells"),
    [(0.0, (0,)), (0.001, (1, 0)), (0.002, (1, 0)), (0.006, (3, 1, 0)), (0.0061, (4, 2, 0))],
)
def test_clearance_is_rounded_up_to_cells(clearance: float, cells: tuple[int, ...]) -> None:
    assert clearances(clearance, GridConfig(cell_size=0.002)) == cells
