"""What a figure tells of success: laws of the summary."""

from __future__ import annotations

import numpy as np
import pytest

from packenv.experiments.robustness import summarize, told


def test_a_figure_that_tells_all_nothing_or_the_contrary():
    figures = np.arange(12.0)
    found = told(figures, figures >= 6)
    assert (found["thirds"], found["more"]) == ([0.0, 0.5, 1.0], 1.0)
    assert (found["zero"], found["above"]) == ([0, 1], [6, 11])
    assert told(figures, figures < 6)["more"] == 0.0
    assert told(np.ones(12), figures >= 6)["more"] == 0.5
    assert told(figures, figures >= 0)["more"] is None


def test_it_does_not_depend_on_units_or_sequence():
    rng = np.random.default_rng(1)
    figures, good = rng.normal(size=90), rng.random(90) < 0.6
    shuffled = rng.permutation(90)
    first = told(figures, good)
    again = told(np.exp(3.0 * figures[shuffled]), good[shuffled])
    assert (again["thirds"], again["more"]) == (first["thirds"], first["more"])
    assert told(-figures, good)["more"] == pytest.approx(1.0 - first["more"])
    assert np.mean(first["thirds"]) == pytest.approx(good.mean())


def test_plans_that_were_not_whole_are_left_out():
    row = {"clearance_m": 0.0, "way": "guarded", "world": "nominal", "planned": True}
    figures = {"min_tilt_deg": 1.0, "min_push": 0.1, "min_offset_m": 0.0}
    found = summarize([{**row, **figures, "success": True}, {"planned": False}, {"error": "stopped"}])
    assert [(name, group["n"], group["success"]) for name, group in found.items()] == [
        ("guarded, nominal, 0 mm", 1, 1.0),
        ("guarded, nominal, all", 1, 1.0),
    ]
