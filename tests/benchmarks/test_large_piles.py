"""The benchmark of large piles: piles are those of the plan, answers are the reference's, figures those of the rows."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import large_piles as bench
from benchmarks.large_piles import WAYS, Job, piles, prepare, summarize, work
from packenv.experiments.shelf import open_shelf
from packenv.planning.stability.equilibrium import residuals
from packenv.types import Container

BOX = Container(0.30, 0.25, 0.20)
ORDER = ("mug", "apple", "pudding_box", "banana", "apple", "mug")


@pytest.fixture(scope="module")
def row() -> dict[str, object]:
    prepare("builtin")
    return work(Job(BOX.size, ORDER, (3, 5), ()))


def test_each_pile_is_asked_about_in_each_way(row: dict) -> None:
    assert row["placed"] == len(ORDER)
    assert [(a["items"], a["way"]) for a in row["answers"]] == [(n, way) for n in (3, 5) for way in WAYS]
    for answer in row["answers"]:
        assert answer["stable"] == (answer["cvxpy"] == "stable")
        assert answer["stable"] or answer["way"] != "planned"


def test_piles_grow_by_the_plan() -> None:
    shelf = open_shelf("builtin", grid=bench.OPTIONS.grid)
    planning = bench.PlanningJob(shelf, bench.OPTIONS, margins=False)
    planning.load(set(ORDER))
    placements = planning.pack(BOX, planning.sequence(list(ORDER))).placements
    found = list(piles(placements, shelf, BOX))
    assert [len(pile.masses) for pile in found] == list(range(1, len(ORDER) + 1))
    for pile, p in zip(found, placements, strict=True):
        assert set(pile.contacts.second) <= set(range(1, len(pile.masses) + 1))
        corner, far = p.corner, p.corner + p.extents
        assert ((corner < pile.coms[-1]) & (pile.coms[-1] < far)).all()
        # Without forces each item is short of its weight.
        none = residuals(pile.contacts, np.zeros((len(pile.contacts), 3)), pile.masses, pile.coms)
        np.testing.assert_allclose(none[:, 2], -1.0)


def test_what_cvxpy_leaves_open_is_no_agreement() -> None:
    answer = {
        "way": "heavy",
        "decided_by": "pile",
        "solver": "cvxpy/CLARABEL",
        "check_ms": 1.0,
        "cvxpy_ms": 2.0,
    }
    said = [(True, "stable"), (False, "stable"), (True, "undecided"), (False, "unstable")]
    rows = [{"answers": [{**answer, "stable": ours, "cvxpy": theirs} for ours, theirs in said]}]
    total = summarize(rows)
    assert (total["questions"], total["agree"], total["cvxpy_undecided"]) == (4, 2, 1)
    assert total["ways"]["planned"]["questions"] == 0
    assert total["ways"]["heavy"]["stable"] == 2


def test_command_prints_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "rows.jsonl"
    command = [
        "large_piles",
        "--orders",
        "1",
        "--size",
        "5",
        "--smallest",
        "3",
        "--every",
        "2",
        "--out",
        str(out),
    ]
    monkeypatch.setattr(sys, "argv", [*command, "--json"])
    assert bench.main() == 0
    report = json.loads(capsys.readouterr().out)
    assert report["questions"] == report["agree"] == 6
    rows = out.read_bytes()
    monkeypatch.setattr(sys, "argv", command)
    assert bench.main() == 0
    assert "agree" in capsys.readouterr().out
    assert out.read_bytes() == rows
