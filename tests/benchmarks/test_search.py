"""The benchmark of searches: traces that only get better, figures of rows alone, and runs that go on."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from benchmarks import search
from benchmarks.search import METHODS, Trace, curve, summarize
from packenv.planning.packing import Packing
from packenv.types import Container

BOX = Container(0.3, 0.3, 0.3)


@st.composite
def rows(draw: st.DrawFn) -> dict[str, Any]:
    """A row as the benchmark writes them: every point of its trace is later, and no worse."""
    size = draw(st.integers(1, 8))
    placed = sorted(draw(st.lists(st.integers(0, size), min_size=1, max_size=5)))
    gaps = draw(st.lists(st.floats(1e-3, 5.0), min_size=len(placed), max_size=len(placed)))
    times = [sum(gaps[: k + 1]) for k in range(len(gaps))]
    return {
        "method": draw(st.sampled_from(["auto", "gls"])), "order": ["a"] * size, "placed": placed[-1],
        "whole": placed[-1] == size, "height": 0.2, "cpu_s": times[-1] + 0.5, "overlaps": 0, "protrusions": 0,
        "blocked": 0, "trace": [(t, n, 0.2) for t, n in zip(times, placed, strict=True)],
    }  # fmt: skip


@settings(deadline=None)  # the first example loads scipy
@given(st.lists(rows(), min_size=1, max_size=6))
def test_shares_are_shares_and_never_fall_with_time(found: list[dict[str, Any]]) -> None:
    for line in summarize(found):
        own = [row for row in found if row["method"] == line["method"]]
        _, placed, whole = zip(*curve(own), strict=True)
        for shares in (placed, whole):
            assert list(shares) == sorted(shares)
            assert 0.0 <= shares[0] <= shares[-1] <= 1.0
        assert whole[-1] == line["whole"] / len(own) == line["whole_share"]["mean"]
        assert placed[-1] == sum(row["placed"] for row in own) / sum(len(row["order"]) for row in own)
        assert line["whole_share"]["low"] <= line["whole_share"]["mean"] <= line["whole_share"]["high"]


@given(st.lists(st.floats(0.0, 1.0), min_size=1))
def test_a_trace_has_what_is_better_alone(figures: list[float]) -> None:
    now = iter(range(1000))
    trace = Trace(better=lambda packing: (packing.utilization,), clock=lambda: float(next(now)))
    kept: list[float] = []
    for figure in figures:
        before = len(trace.points)
        trace.tell(Packing(BOX, (), (), (), figure))
        kept += [figure] * (len(trace.points) - before)
    assert kept == sorted(set(kept))
    assert kept[-1] == max(figures)
    assert [at for at, _, _ in trace.points] == sorted({at for at, _, _ in trace.points})


def run(out: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *more: str) -> Any:
    """The report of a small run."""
    given = [
        "--size",
        "9",
        "--container",
        "0.22x0.22x0.16",
        "--plans",
        "2",
        "--out",
        str(out),
        "--json",
        *more,
    ]
    monkeypatch.setattr(sys, "argv", ["search", *given])
    assert search.main() == 0
    return json.loads(capsys.readouterr().out)


def test_a_run_goes_on_and_its_rows_are_audited(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, picture = tmp_path / "rows.jsonl", tmp_path / "curve.svg"
    first = run(out, capsys, monkeypatch, "--orders", "1", "--methods", "one-pass-hm", "gls")
    before = out.read_bytes()
    assert [line["method"] for line in first["methods"]] == ["one-pass-hm", "gls"]
    whole = run(out, capsys, monkeypatch, "--orders", "2", "--svg", str(picture))
    assert out.read_bytes().startswith(before)  # no finished row is lost, or made again
    made = [json.loads(line) for line in out.read_text().splitlines()]
    assert len(made) == len({row["key"] for row in made}) == 2 * len(METHODS)
    assert all(
        line["orders"] == 2 and line["overlaps"] == line["protrusions"] == 0 for line in whole["methods"]
    )
    for row in made:
        assert row["trace"][-1][1] == row["placed"]
        assert row["trace"][-1][0] <= row["cpu_s"]
    # What searches on begins with the plan of `auto`.
    placed = {(row["method"], tuple(row["order"])): row["placed"] for row in made}
    for (method, order), count in placed.items():
        if method in search.SEARCHING:
            assert count >= placed["one-pass-best", order]
    assert picture.read_text().startswith("<?xml")
    assert run(out, capsys, monkeypatch, "--orders", "2") == whole
    assert len(out.read_text().splitlines()) == len(made)
