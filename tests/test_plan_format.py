"""The page on plan files says of every option what the product does."""

from __future__ import annotations

import json
import re
from typing import get_args

import pytest

import packenv as rp
from packenv.io.plans import plan_to_json
from packenv.planning import options
from packenv.planning.inquiry import ORIENTATION
from packenv.planning.manipulation.checker import Reason
from packenv.planning.manipulation.constraint import NO_GRASP
from packenv.planning.options import PlanOptions, Rule, option_names, rules
from tests.conftest import REPO
from tests.memory_samples import BOX, ORDER, meshes

PAGE = (REPO / "docs" / "plan-format.md").read_text(encoding="utf-8")
GRID: dict[str, Rule] = options._GRID
HEAD = "| option | value | default |"


def between(start: str, end: str) -> str:
    """What the page has between two comments."""
    return PAGE.split(f"<!-- {start} -->")[1].split(f"<!-- {end} -->")[0].strip()


def table() -> dict[str, tuple[str, str]]:
    """Value and default by option."""
    head, line, *rows = between("options", "end of options").splitlines()
    assert head == HEAD
    assert set(line) <= set("|- ")
    found = {}
    for row in rows:
        option, value, default = (cell.strip() for cell in row.strip("|").split(" | "))
        assert option.strip("`") not in found
        found[option.strip("`")] = (value, default)
    return found


def meanings() -> dict[str, str]:
    """Meaning by option, its lines joined."""
    text = between("meanings", "end of meanings").removeprefix("- ")
    pairs = [" ".join(entry.split()).split(": ", 1) for entry in text.split("\n- ")]
    return {name.strip("`"): meaning for name, meaning in pairs}


def value_of(name: str, rule: Rule) -> str:
    """What the table says an option may be."""
    if rule.words:
        words = ", ".join(f"`{word}`" for word in rule.words)
        return f"{words}, or `module:name`" if name == "heuristic" else words
    return rule.right.replace("none", "null")


def row_of(name: str) -> tuple[tuple[str, str], str]:
    """What the page should say of an option: value and default, meaning."""
    default = f"`{json.dumps(PlanOptions().to_mapping()[name])}`".replace('"', "")
    if name == "own_constraints":
        return ("a list of `module:name`", default), "further constraints of your own"
    if name == "cell":
        meaning = "robot, container's place and friction; null: the TX90, the container in front of it"
        return ("a record as in [cell.md](cell.md), or null", default), meaning
    rule = {**rules(), **GRID}[name]
    return (value_of(name, rule), default), rule.meaning


def test_the_page_has_every_option() -> None:
    assert tuple(table()) == option_names()
    assert tuple(meanings()) == option_names()


@pytest.mark.parametrize("name", option_names())
def test_the_page_says_what_the_product_does(name: str) -> None:
    assert (table()[name], meanings()[name]) == row_of(name)


def test_settings_of_a_plan_are_exactly_the_options_of_the_table() -> None:
    plan = rp.plan(ORDER, BOX, rp.load_catalogue(meshes()), constraints="overlap")
    assert list(plan_to_json(plan)["settings"]) == list(table())


def rows() -> set[str]:
    """Every word in the first column of a table of the page."""
    first = {line.split("|")[1] for line in PAGE.splitlines() if line.startswith("| `")}
    return {word.strip(" `") for cell in first for word in cell.split(",")}


def test_every_key_of_a_plan_file_has_a_row() -> None:
    plan = rp.plan(ORDER, BOX, rp.load_catalogue(meshes()), geometry="parts")
    written = plan_to_json(plan)
    step = written["steps"][0]
    records = [written, written["container"], step, *step["details"].values(), *written["meshes"].values()]
    assert set(step["details"]) == {"stability", "manipulation", "robustness"}
    named = rows()
    assert {key for record in records for key in record} - named == set()
    metrics = {"route_<route>" if key.startswith("route_") else key for key in written["metrics"]}
    assert metrics - named == set()
    forces = [force for found in written["steps"] for force in found["details"]["stability"]["forces"]]
    assert {key for force in forces for key in force} == {"at", "force"}
    assert {"at", "force", "item", "qty", "clearance_m"} <= set(re.findall(r"`([a-z_]+)`", PAGE))


def test_every_reason_of_the_robot_has_a_row() -> None:
    of_candidates = set(get_args(Reason)) - {NO_GRASP}  # which rules whole orientations out
    assert of_candidates | {f"{ORIENTATION}{NO_GRASP}"} <= rows()


def test_every_rule_of_a_drop_is_named() -> None:
    from packenv.execution.physics_planner import INSIDE, LENIENT, STRICT

    named = re.findall(r"^- `([a-z-]+)`", PAGE.split("`rule` is one of")[1].split("###")[0], re.MULTILINE)
    assert named == [STRICT.name, LENIENT.name, INSIDE.name, "no-drop"]
