"""The benchmark of layouts: each outcome is one of the outcomes before it, and a second run does nothing again."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import layouts as bench
from benchmarks.layouts import LEVELS, OUTCOMES, summarize


def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], out: Path) -> dict[str, Any]:
    words = ["layouts", "--orders", "2", "--size", "6", "--container", "0.25x0.25x0.2", "--seconds", "5"]
    monkeypatch.setattr(sys, "argv", [*words, "--out", str(out), "--json"])
    assert bench.main() == 0
    report: dict[str, Any] = json.loads(capsys.readouterr().out)
    return report


def test_outcomes_are_one_inside_the_other_and_rows_are_kept(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "rows.jsonl"
    report = run(monkeypatch, capsys, out)
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert len(rows) == report["orders"] == 2
    for row in rows:
        assert row["loadable"] >= row["at_once"]
        assert row["free"] >= row["loadable"]
        assert row["robot"] >= row["executed"]
        for level in LEVELS:
            assert row[level] == (row["placed"][level] == len(row["order"]))
            assert row["free"] >= row[level]
        if row["loadable"]:
            # A layout with a loading sequence is a plan: lowered to contact, no piece is higher than in it.
            assert row["overlap"]
    assert any(row["loadable"] for row in rows)
    before = out.read_bytes()
    assert run(monkeypatch, capsys, out) == report
    assert out.read_bytes() == before


def test_shares_are_of_all_orders_and_items_of_the_free_ones() -> None:
    def row(placed: int, *outcomes: str) -> dict[str, Any]:
        told = {name: name in outcomes for name in OUTCOMES}
        return {**told, "order": ["a"] * 4, "placed": dict.fromkeys(LEVELS, placed)}

    found = summarize([row(4, *OUTCOMES), row(2, "free"), row(0), row(0)])
    assert found["outcomes"]["free"]["count"] == 2
    assert found["outcomes"]["executed"]["mean"] == 0.25
    assert found["placed_of_free"]["robot"]["mean"] == 0.75
