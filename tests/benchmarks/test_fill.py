"""The benchmark that fills boxes: a buffer is kept to, the best is chosen of it, and figures are those of its rows."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import fill as bench
from benchmarks.fill import FIGURES, fill, sequences, waste
from packenv.execution.planning_job import PlanningJob
from packenv.experiments.shelf import open_shelf
from packenv.planning.options import PlanOptions
from packenv.planning.trails import on_stable_poses
from packenv.types import Container

BOX = Container(0.20, 0.20, 0.15)
SEQUENCE = (
    "mug",
    "apple",
    "pudding_box",
    "banana",
    "apple",
    "spoon",
    "rubber_duck",
    "mug",
    "apple",
    "banana",
)


def filled(buffer: int, **more: Any) -> list[str]:
    shelf = open_shelf("builtin")
    job = PlanningJob(shelf, PlanOptions("minz", constraints="overlap"), margins=False)
    job.load(set(SEQUENCE))
    with job.planner(BOX) as planner:
        placements = fill(on_stable_poses(planner), shelf.prepared, BOX, SEQUENCE, buffer, **more)
    return [placement.item for placement in placements]


@pytest.mark.parametrize("buffer", [1, 3])
def test_what_is_placed_was_in_the_buffer(buffer: int) -> None:
    left = list(SEQUENCE)
    placed = filled(buffer)
    for name in placed:
        assert name in left[:buffer]
        left.remove(name)
    assert placed
    if buffer == 1:
        assert placed == list(SEQUENCE[: len(placed)])


def test_with_the_whole_sequence_at_hand_the_cheapest_comes_first() -> None:
    volumes: list[float] = []

    def largest(step: Any) -> float:
        volumes.append(step.item.volume)
        return -float(step.item.volume)

    first = filled(len(SEQUENCE), cost=largest)[0]
    assert open_shelf("builtin").prepared[first].volume == max(volumes)


def test_an_item_wastes_no_less_than_nothing() -> None:
    seen: list[float] = []

    def noted(step: Any) -> float:
        seen.append(waste(step))
        return seen[-1]

    filled(3, cost=noted)
    # A heightmap encloses what is below it: on the empty floor the item itself, and what is under it.
    assert len(seen) > 5
    assert seen[0] > 0.0


def test_sequences_depend_on_the_seed_alone_and_repeat_items() -> None:
    names = ["a", "b", "c"]
    assert sequences(names, 9, 4, 1) == sequences(names, 9, 8, 1)[:4] != sequences(names, 9, 4, 2)
    assert all(len(found) == 9 and set(found) <= set(names) for found in sequences(names, 9, 4, 1))


def test_a_run_goes_on_and_says_what_its_rows_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "rows.jsonl"

    def run(*more: str) -> dict[str, Any]:
        small = [
            "--sequences",
            "1",
            "--items",
            "8",
            "--container",
            "0.18x0.18x0.1",
            "--out",
            str(out),
            "--json",
        ]
        monkeypatch.setattr(sys, "argv", ["fill", *small, *more])
        assert bench.main() == 0
        return dict(json.loads(capsys.readouterr().out)["modes"])

    run("--modes", "geometry", "--buffers", "1")
    before = out.read_bytes()
    modes = run("--modes", "geometry", "stable", "--buffers", "1", "2")
    assert out.read_bytes().startswith(before)
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert len(rows) == 4
    assert {mode: list(buffers) for mode, buffers in modes.items()} == {
        m: ["1", "2"] for m in ("geometry", "stable")
    }
    for row in rows:
        line = modes[row["mode"]][str(row["buffer"])]
        assert line == {name: row[name] for name in FIGURES}
        assert 0.0 < row["utilization"] <= row["compactness"] < 1.0
    assert run("--modes", "geometry", "stable", "--buffers", "1", "2") == modes
    assert len(out.read_text().splitlines()) == 4
