"""The page on plan files says of every option what the product does."""

from __future__ import annotations

import json

import pytest

import packenv as rp
from packenv.io.plans import plan_to_json
from packenv.planning import options
from packenv.planning.options import PlanOptions, Rule, option_names, rules
from tests.conftest import REPO
from tests.memory_samples import BOX, ORDER, meshes

PAGE = (REPO / "docs" / "plan-format.md").read_text(encoding="utf-8")
GRID: dict[str, Rule] = options._GRID
HEAD = "| option | value | default | meaning |"


def table() -> dict[str, tuple[str, str, str]]:
    """Value, default and meaning by option."""
    between = PAGE.split("<!-- options -->")[1].split("<!-- end of options -->")[0]
    head, line, *rows = between.strip().splitlines()
    assert head == HEAD
    assert set(line) <= set("|- ")
    found = {}
    for row in rows:
        option, value, default, meaning = (cell.strip() for cell in row.strip("|").split(" | "))
        assert option.strip("`") not in found
        found[option.strip("`")] = (value, default, meaning)
    return found


def value_of(name: str, rule: Rule) -> str:
    """What the table says an option may be."""
    if rule.words:
        words = ", ".join(f"`{word}`" for word in rule.words)
        return f"{words}, or `module:name`" if name == "heuristic" else words
    return rule.right.replace("none", "null")


def row_of(name: str) -> tuple[str, str, str]:
    """What the table should say of an option."""
    default = f"`{json.dumps(PlanOptions().to_mapping()[name])}`".replace('"', "")
    if name == "own_constraints":
        return ("a list of `module:name`", default, "further constraints of your own")
    if name == "cell":
        cell = "a robot cell's record as in [cell.md](cell.md), or null"
        return (
            cell,
            default,
            "robot, container's place and friction; null: the TX90, the container in front of it",
        )
    rule = {**rules(), **GRID}[name]
    return (value_of(name, rule), default, rule.meaning)


def test_the_table_has_a_row_for_every_option() -> None:
    assert tuple(table()) == option_names()


@pytest.mark.parametrize("name", option_names())
def test_a_row_says_what_the_product_does(name: str) -> None:
    assert table()[name] == row_of(name)


def test_settings_of_a_plan_are_exactly_the_options_of_the_table() -> None:
    plan = rp.plan(ORDER, BOX, rp.load_catalogue(meshes()), constraints="overlap")
    assert list(plan_to_json(plan)["settings"]) == list(table())


def test_every_key_of_a_plan_file_has_a_row() -> None:
    plan = rp.plan(ORDER, BOX, rp.load_catalogue(meshes()), constraints="overlap")
    written = plan_to_json(plan)
    rows = {line.split("|")[1].strip() for line in PAGE.splitlines() if line.startswith("| `")}
    named = {word.strip(" `") for row in rows for word in row.split(",")}
    assert set(written) - named == set()
    assert set(written["steps"][0]) - named == set()
    assert "rehearsed_plan" not in PAGE
