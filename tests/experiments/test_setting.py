"""Settings of the planner as words."""

from __future__ import annotations

import pytest

from packenv.errors import InputError
from packenv.experiments.setting import options_of
from packenv.planning.options import PlanOptions


def test_a_setting_is_a_preset_with_options_that_differ() -> None:
    assert options_of("default") == PlanOptions()
    assert options_of("paper") == PlanOptions.paper()
    assert options_of("default, grasp=paper,restarts=0") == PlanOptions(grasp="paper", restarts=0)
    assert options_of("paper,max-checked=7,tie_break=none") == PlanOptions.paper(
        max_checked=7, tie_break=None
    )
    assert options_of("default,cell_size=0.005").grid.cell_size == 0.005


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("papr", "did you mean 'paper'"),
        ("default,grap=paper", "did you mean 'grasp'"),
        ("default,grasp", "give option=value"),
        ("default,grasp=papre", "grasp is 'papre'"),
        ("default,restarts=x", "restarts is 'x'"),
        ("", "begin with default or paper"),
    ],
)
def test_a_wrong_setting_is_one_line_that_says_what_would_be_right(setting: str, told: str) -> None:
    with pytest.raises(InputError) as problem:
        options_of(setting)
    assert told in str(problem.value)
    assert repr(setting) in str(problem.value)
    assert "\n" not in str(problem.value)
