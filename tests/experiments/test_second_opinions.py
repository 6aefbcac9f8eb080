"""Plans that are carried out in two ways: what their rows say, and that a pile at rest stays where it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from packenv.experiments import second_opinions
from packenv.experiments.experiment import Experiment
from packenv.experiments.results import Line
from packenv.experiments.second_opinions import FULL_TIME, UNTIL_REST, agreement
from packenv.experiments.spec import RunSpec
from packenv.sim.engines import is_there
from tests.mesh_samples import write_three


def rows_of(experiment: Experiment, spec: RunSpec) -> list[dict[str, Any]]:
    """Rows as the runner writes them."""
    experiment.prepare(spec, spec.catalogue)
    return [
        {"key": job.key, "status": "ok", "revision": "1", **job.head(), **experiment.work(job)}
        for job in experiment.jobs(spec)
    ]


def nominal(experiment: Experiment, spec: RunSpec, rows: list[dict[str, Any]]) -> dict[str, Line]:
    lines = experiment.summarize(spec, rows).lines
    return {line.method: line for line in lines if line.world == "nominal"}


@pytest.fixture
def spec(tmp_path: Path) -> RunSpec:
    write_three(tmp_path)
    return RunSpec(str(tmp_path), orders=1, items=2, container=(0.2, 0.2, 0.12), engine="mujoco")


def test_a_pile_that_comes_to_rest_stays_there(spec: RunSpec) -> None:
    rows = rows_of(second_opinions.EARLY_REST, spec)
    early, full = (row["nominal"] for row in rows)
    # Both wait while the items fall; what is left of 20 s is saved for each of the two.
    assert 2 * 15.0 < full["simulated_s"] - early["simulated_s"] < 2 * 20.0
    lines = nominal(second_opinions.EARLY_REST, spec, rows)
    assert list(lines) == [f"paper, {UNTIL_REST}", f"paper, {FULL_TIME}"]
    told = lines[f"paper, {FULL_TIME}"].figures
    assert told["same verdict, %"] == 100.0
    assert told["apart: most, mm"] < 0.3


@pytest.mark.skipif(not is_there("bullet"), reason="PyBullet is not installed")
def test_both_engines_carry_out_the_same_plans(spec: RunSpec) -> None:
    rows = rows_of(second_opinions.TWO_ENGINES, spec)
    assert [row["engine"] for row in rows] == ["bullet", "mujoco"]
    assert len({row["plan"] for row in rows}) == 1
    lines = nominal(second_opinions.TWO_ENGINES, spec, rows)
    assert list(lines) == ["script, bullet", "script, mujoco"]
    assert lines["script, bullet"].figures["same verdict, %"] is None
    assert lines["script, mujoco"].figures["apart: most, mm"] < 5.0


def done(cause: str, *ends: list[float]) -> dict[str, Any]:
    return {"success": not cause, "cause": cause, "ends_m": list(ends)}


def test_agreement_is_of_verdicts_and_gaps_are_of_plans_that_succeed_in_both() -> None:
    here, there = [0.1, 0.1, 0.0], [0.1, 0.1, 0.003]
    good, bad = done("", here, here), done("collision", here)
    pairs = [(good, done("", here, there)), (bad, bad), (good, bad), (bad, done("item-out", there, there))]
    found = agreement(pairs)
    assert found["same verdict, %"] == 50.0
    assert found["apart: most, mm"] == pytest.approx(3.0)
    assert found["apart: median, mm"] == pytest.approx(1.5)
    assert agreement([(b, a) for a, b in pairs]) == found
    assert set(agreement([]).values()) == {None}
