"""The benchmark of small boxes: no method is below the bound, and a second run does nothing again."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import boxes as bench
from benchmarks.boxes import METHODS, summarize


def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], out: Path) -> dict[str, Any]:
    words = ["boxes", "--orders", "3", "--seconds", "1", "--out", str(out), "--json"]
    monkeypatch.setattr(sys, "argv", words)
    assert bench.main() == 0
    report: dict[str, Any] = json.loads(capsys.readouterr().out)
    return report


def test_no_box_is_below_the_bound_and_rows_are_kept(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "rows.jsonl"
    report = run(monkeypatch, capsys, out)
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert report["whole_by_all"] == len(rows) == 3
    for row in rows:
        found = [row[method]["volume"] for method in METHODS]
        assert row["bound"] <= found[2] <= found[1]
    before = out.read_bytes()
    assert run(monkeypatch, capsys, out) == report
    assert out.read_bytes() == before


def test_an_order_that_one_method_does_not_pack_counts_for_none() -> None:
    def row(*volumes: float | None) -> dict[str, Any]:
        told = zip(METHODS, volumes, strict=True)
        return {"bound": 0.001, **{m: {"volume": v, "seconds": 1.0, "faults": 0} for m, v in told}}

    found = summarize([row(0.003, 0.003, 0.002), row(0.005, 0.005, None), row(0.002, 0.002, 0.002)])
    assert found["whole_by_all"] == 2
    assert found["bound_dm3"] == pytest.approx(1.0)
    boxes = {method: own["box_dm3"] for method, own in found["methods"].items()}
    assert boxes == pytest.approx({"hm": 2.5, "auto": 2.5, "budget": 2.0})
    assert found["methods"]["budget"]["smaller_than_hm"] == 1
    assert found["methods"]["budget"]["whole"] == 2
