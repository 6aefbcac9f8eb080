"""Page and terminal say the same of what was packed; limits of items and what rests on them are told."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

import packenv
from packenv.cli import main
from packenv.limits import ItemLimits
from packenv.types import Leftover, Placement, Plan
from packenv.view.page import page_text
from packenv.view.show import scene_of
from packenv.view.words import leftover_lines, limit_words, loads_at_end, rule_words
from tests import shapes
from tests.view.test_page import decode, make_scene, place

ORDER = """item,qty,fragile,upright,max_load_kg,keep_apart
wood_block,1,,,0.5,food
foam_brick,2,,,,
soap_bar,1,,yes,,
tuna_can,1,yes,,,
golf_ball,2,,,,tools
"""
QUICK = ["--constraints", "stability", "--restarts", "0", "--stability", "paper", "--heuristic"]


@pytest.fixture
def packed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[list[str], dict, Plan]:
    """What the terminal says, what the page holds, and the plan."""
    order, page, out = (tmp_path / name for name in ("order.csv", "plan.html", "plan.json"))
    order.write_text(ORDER)
    words = ["--container", "0.3x0.24x0.12", "--html", str(page), "--out", str(out)]
    assert main(["pack", str(order), *words, *QUICK, "hm"]) == 1
    record, _ = decode(page.read_text(encoding="utf-8"))
    return capsys.readouterr().out.splitlines(), record, packenv.load_plan(out)


def test_page_and_terminal_agree(packed: tuple[list[str], dict, Plan]) -> None:
    lines, record, _ = packed
    summary = dict(record["summary"])
    rows = [re.split(r" {2,}", line.strip()) for line in lines]
    placed = [row for row in rows if row[0].isdigit()]
    assert [row[1] for row in placed] == [step["name"] for step in record["steps"]]
    assert {"foam_brick (1)", "foam_brick (2)"} <= {row[1] for row in placed}
    left = [row for row in rows if row[0] == "-"]
    assert [row[1] for row in left] == [line["name"] for line in record["leftovers"]] == ["golf_ball x 2"]
    assert record["leftovers"][0]["reason"] == "kept-apart"
    assert left[0][2] == f"not packed: {record['leftovers'][0]['detail']}"
    last = next(line for line in lines if line.startswith("packed "))
    told = re.fullmatch(
        r"packed (\d+ of \d+) items into (.+) with (.+): utilization (.+)%, height (.+)", last
    )
    assert told is not None
    assert summary["Packed"] == told[1] == "5 of 7"
    assert summary["Container"] == told[2] == "0.3x0.24x0.12 m"
    assert summary["Heuristic"] == told[3] == "hm"
    assert summary["Utilization"] == f"{told[4]} %"
    assert summary["Height"] == told[5]


def test_limits_are_in_the_terminals_last_column_and_in_the_pages_list(
    packed: tuple[list[str], dict, Plan],
) -> None:
    lines, record, plan = packed
    assert lines[0].endswith("limits")
    loads = plan.placements[-1].details["stability"]
    assert isinstance(loads, Mapping)
    steps = {load["step"]: load["kg"] for load in loads["loads"]}
    for number, (p, step) in enumerate(zip(plan.placements, record["steps"], strict=True), start=1):
        words = plan.meshes[p.item].limits.words
        assert lines[number].endswith(", ".join(words) or "°")
        assert step["limits"][: len(words)] == list(words)
        assert (number in steps) == (p.item in ("wood_block", "tuna_can"))
    wood = next(k for k, p in enumerate(plan.placements, 1) if p.item == "wood_block")
    on_it = f"{steps[wood]:.2g} of 0.5 kg on it" if steps[wood] else "nothing on it"
    assert record["steps"][wood - 1]["limits"] == ["bears 0.5 kg", "apart: food", on_it]


def test_without_limits_there_is_no_such_column(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    order = tmp_path / "order.csv"
    order.write_text("item\nsoap_bar\n")
    assert main(["pack", str(order), "--container", "0.3x0.24x0.12", *QUICK, "hm"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "limits" not in lines[0]
    assert all(step["limits"] == [] for step in decode(page_text(make_scene()))[0]["steps"])


@pytest.mark.parametrize(
    ("limits", "load", "words"),
    [
        (ItemLimits(), None, ()),
        (ItemLimits(upright=True), 3.0, ("this side up",)),
        (ItemLimits(max_load_kg=2.0), 0.4, ("bears 2 kg", "0.4 of 2 kg on it")),
        (ItemLimits(max_load_kg=2.0), 0.0, ("bears 2 kg", "nothing on it")),
        (ItemLimits(max_load_kg=2.0), None, ("bears 2 kg",)),
        (ItemLimits(fragile=True), 0.0, ("fragile",)),
        (ItemLimits(fragile=True), 0.25, ("fragile", "0.25 of 0 kg on it")),
    ],
)
def test_what_rests_on_an_item_is_told_where_it_counts(
    limits: ItemLimits, load: float | None, words: tuple[str, ...]
) -> None:
    assert limit_words(replace(shapes.box(0.1, 0.1, 0.1), limits=limits), load) == words


@pytest.mark.parametrize(
    ("details", "loads"),
    [
        ({"stability": {"loads": [{"step": 2, "kg": 0.5}]}}, {2: 0.5}),
        ({"loads": {"loads": [{"step": 1, "kg": 1}, {"step": 3, "kg": 0}]}}, {1: 1.0, 3: 0.0}),
        ({"stability": {"contacts": 3}, "clearance_m": 0.002}, {}),
        ({"loads": {"loads": "much"}}, {}),
        ({"loads": {"loads": [{"step": 1}]}}, {}),
        ({"loads": {"loads": 7}}, {}),
    ],
)
def test_loads_are_read_of_the_last_step(details: dict[str, object], loads: dict[int, float]) -> None:
    crate = shapes.box(0.1, 0.08, 0.06)
    earlier: Placement = replace(
        place(crate, (0, 0, 0)), details={"loads": {"loads": [{"step": 9, "kg": 9}]}}
    )
    assert loads_at_end((earlier, replace(earlier, details=details))) == loads
    assert loads_at_end(()) == {}


def test_equal_leftovers_are_one_line() -> None:
    left = [Leftover("mug", k, "kept-apart", "Why.") for k in (1, 2)] + [
        Leftover("mug", 3, "given-up", "Why.")
    ]
    assert [(line.name, line.reason) for line in leftover_lines(left)] == [
        ("mug x 2", "kept-apart"),
        ("mug", "given-up"),
    ]


@pytest.mark.parametrize(
    ("asked", "made_by", "words"),
    [
        ("hm", "planner", "hm"),
        ("auto", "dblf", "dblf (auto)"),
        ("auto", "planner", "hm (auto)"),
        ("minz", "dblf paper", "dblf (in place of minz)"),
        ("hm", "agent", "agent"),
        ("my_rules:flattest", "planner", "my_rules:flattest"),
    ],
)
def test_the_heuristic_is_the_one_that_made_the_plan(asked: str, made_by: str, words: str) -> None:
    scene = make_scene()
    plan = Plan(scene.container, (), (), {"heuristic": asked}, made_by=made_by)
    assert rule_words(plan) == words


def test_an_items_check_tells_limits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shapes.box(0.06, 0.05, 0.02).to_trimesh().export(tmp_path / "plate.stl")
    (tmp_path / "objects.csv").write_text("name,file,unit,fragile,upright\nplate,plate.stl,m,yes,yes\n")
    assert main(["items", "check", str(tmp_path)]) == 0
    assert "this side up, fragile" in capsys.readouterr().out
    assert main(["items", "check", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["limits"] == ["this side up", "fragile"]


def test_a_plan_of_an_order_with_limits_shows_them_again(packed: tuple[list[str], dict, Plan]) -> None:
    _, record, plan = packed
    again, _ = decode(page_text(scene_of(plan)))
    for told in ("name", "limits"):
        assert [step[told] for step in again["steps"]] == [step[told] for step in record["steps"]]
    assert again["leftovers"] == record["leftovers"]
