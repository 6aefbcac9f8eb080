"""What a figure tells of success: laws of the summary."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from packenv.experiments import robustness
from packenv.experiments.robustness import ROBUSTNESS, thirds, told
from packenv.experiments.spec import RunSpec
from tests.mesh_samples import write_three


def test_a_figure_that_tells_all_nothing_or_the_contrary() -> None:
    figures = np.arange(12.0)
    assert (thirds(figures, figures >= 6), told(figures, figures >= 6)) == ([0.0, 0.5, 1.0], 1.0)
    assert told(figures, figures < 6) == 0.0
    assert told(np.ones(12), figures >= 6) == 0.5
    assert told(figures, figures >= 0) is None


def test_it_does_not_depend_on_units_or_sequence() -> None:
    rng = np.random.default_rng(1)
    figures, good = rng.normal(size=90), rng.random(90) < 0.6
    shuffled = rng.permutation(90)
    again = np.exp(3.0 * figures[shuffled]), good[shuffled]
    assert (thirds(*again), told(*again)) == (thirds(figures, good), told(figures, good))
    assert told(-figures, good) == pytest.approx(1.0 - told(figures, good))
    assert np.mean(thirds(figures, good)) == pytest.approx(good.mean())


def test_every_way_of_an_order_tells_what_its_plan_withstands(tmp_path: Path) -> None:
    write_three(tmp_path)
    spec = RunSpec(str(tmp_path), orders=1, items=2, container=(0.2, 0.2, 0.12), engine="mujoco")
    ROBUSTNESS.prepare(spec, str(tmp_path))
    rows = [
        {"key": job.key, "status": "ok", "revision": "1", **job.head(), **robustness.work(job)}
        for job in ROBUSTNESS.jobs(spec)
    ]
    assert {row["method"] for row in rows} == {c.name for c in robustness.COLUMNS}
    for plain, guarded in zip(rows[::2], rows[1::2], strict=True):
        for figure in robustness.MEASURED.values():
            assert plain[figure] == guarded[figure]
    assert rows[2]["min_offset_m"] >= 0.004 > rows[0]["min_offset_m"]
    lines = ROBUSTNESS.summarize(spec, rows).lines
    assert len(lines) == 8
    assert lines[0].figures["tilt: thirds, %"] == "100"
    assert lines[0].figures["tilt tells, %"] is None
