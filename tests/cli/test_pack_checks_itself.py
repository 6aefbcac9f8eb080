"""A plan for the robot is carried out in simulation before it is given out, though nobody says so."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from packenv.api import REHEARSALS
from packenv.cli import main
from tests.mesh_samples import write_three

SIZE = "0.2x0.2x0.12"


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shelf")
    write_three(folder)
    (folder / "order.csv").write_text("item,qty\nbrick,1\nbook,1\ncan,1\n")
    return folder


def packed(
    shelf: Path, capsys: pytest.CaptureFixture[str], *more: str, size: str = SIZE
) -> tuple[dict[str, Any], str]:
    arguments = [str(shelf / "order.csv"), "--catalogue", str(shelf), "--container", size, "--json", *more]
    capsys.readouterr()
    main(["pack", *arguments])
    told = capsys.readouterr()
    return json.loads(told.out), told.err


def test_it_is_rehearsed_on_convex_parts_and_says_nothing_of_success(
    shelf: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, told = packed(shelf, capsys, size="0.32x0.32x0.30")
    assert plan["metrics"]["rehearsal_worlds"] == plan["metrics"]["rehearsal_survived"] == REHEARSALS
    assert (plan["settings"]["rehearse"], plan["settings"]["geometry"]) == (REHEARSALS, "parts")
    assert told == ""


@pytest.mark.parametrize(
    "more",
    [
        ("--rehearse", "0"),
        ("--geometry", "mesh"),
        ("--constraints", "stability"),
        ("--constraints", "overlap"),
        ("--preset", "paper"),
        ("--plans", "2"),
    ],
    ids=" ".join,
)
def test_whoever_asks_for_something_else_gets_that_alone(
    more: tuple[str, ...], shelf: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, _ = packed(shelf, capsys, *more)
    assert "rehearsal_worlds" not in plan["metrics"]
    assert plan["settings"]["rehearse"] == 0


def test_an_order_that_does_not_fit_is_planned_on_its_meshes_as_before(
    shelf: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tight = "0.11x0.09x0.07"
    plan, told = packed(shelf, capsys, size=tight)
    known, _ = packed(shelf, capsys, "--rehearse", "0", size=tight)
    assert 0 < len(plan["steps"]) < 3
    assert "not rehearsed: " in told
    assert plan["settings"] == known["settings"]
    assert [step["position"] for step in plan["steps"]] == [step["position"] for step in known["steps"]]


def test_without_any_engine_a_plan_is_a_plan(
    shelf: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("packenv.sim.engines._installed", lambda package: False)
    plan, told = packed(shelf, capsys)
    assert (plan["settings"]["rehearse"], told) == (0, "")
