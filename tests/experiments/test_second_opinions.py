"""Figures of the experiments that carry plans out twice."""

from __future__ import annotations

from typing import Any

import pytest

from packenv import api
from packenv.experiments import both_engines, early_rest
from packenv.items.catalogue import Catalogue
from packenv.items.shelf import ItemShelf
from packenv.planning.options import PlanOptions
from packenv.sim.placing import MotionConfig
from packenv.sim.session import ExecutionConfig
from packenv.types import Container, Order
from tests import shapes


def test_a_pile_that_comes_to_rest_stays_there() -> None:
    config = ExecutionConfig(motion=MotionConfig(settle=3.0))
    shelf = ItemShelf(Catalogue.of_items({"brick": shapes.box(0.10, 0.08, 0.05, "brick")}), geometry="parts")
    options = PlanOptions("hm", constraints="stability", geometry="parts")
    plan = api.plan(Order.of("brick", "brick"), Container(0.12, 0.10, 0.12), shelf, options)
    assert plan.complete
    row = early_rest.both(plan, shelf, config)
    assert row["early"]["success"]
    assert row["full"]["success"]
    assert len(row["apart_m"]) == 2
    assert max(row["apart_m"]) < 3e-4
    saved = row["full"]["simulated_s"] - row["early"]["simulated_s"]
    # Both wait while they fall and for the rule's time; what is left of 3 s is saved twice.
    assert 2 * 2.0 < saved < 2 * (3.0 - 0.15)


def done(cause: str | None, cpu: float = 1.0) -> dict[str, Any]:
    return {
        "success": cause is None,
        "cause": cause,
        "detail": cause or "",
        "drop_m": [0.01, 0.02],
        "shift_m": [0.0, 0.001],
        "at_rest": True,
        "simulated_s": 10.0 * cpu,
        "cpu_s": cpu,
    }


def test_early_rest_tells_where_the_verdicts_differ() -> None:
    rows = [
        {"index": 0, "early": done(None), "full": done(None, 4.0), "apart_m": [0.0, 0.0005]},
        {"index": 1, "early": done("item-out"), "full": done("item-out", 4.0), "apart_m": [0.2, 0.2]},
        {"index": 2, "early": done(None), "full": done("collision", 4.0), "apart_m": [0.1, 0.1]},
        {"index": 3, "early": done(None), "full": done(None, 4.0), "apart_m": [0.0, 0.003]},
        {"index": 4},
    ]
    for row in rows[:4]:
        row["items"] = ["mug", "ball"]
    report = early_rest.summarize(rows)
    assert report["n"] == 4
    assert report["same_verdict"] == 0.75
    assert [d["index"] for d in report["different"]] == [2]
    assert report["success_early"] == 0.75
    assert report["success_full"] == 0.5
    assert report["apart_mm"]["max"] == pytest.approx(3.0)
    assert report["apart_share_1mm"] == 0.5
    assert report["wanderers"] == {"ball": 1}
    assert report["cpu_saved"] == 0.75


def test_without_a_complete_plan_there_is_nothing_to_tell() -> None:
    assert early_rest.summarize([{"index": 0}]) == {"n": 0}


def test_two_engines_are_compared_on_the_same_plans() -> None:
    good, bad = done(None), done("collision", 2.0)
    rows = [
        {"index": 0, "nominal": {"bullet": good, "mujoco": done(None, 2.0), "apart_m": [0.001, 0.0]}},
        {"index": 1, "nominal": {"bullet": good, "mujoco": bad, "apart_m": [0.5]}},
        {"index": 2, "nominal": {"bullet": bad, "mujoco": bad, "apart_m": [0.5]}},
        {"index": 3, "nominal": {"bullet": good, "mujoco": good, "apart_m": [0.002]}},
    ]
    report = both_engines.summarize([{**row, "disturbed": row["nominal"]} for row in rows] + [{"index": 4}])
    nominal = report["nominal"]
    assert report["disturbed"] == nominal
    assert nominal["n"] == 4
    assert nominal["agreement"] == 0.75
    assert nominal["different"] == [{"index": 1, "bullet": "", "mujoco": "collision"}]
    assert nominal["bullet"]["success"] == 0.75
    assert nominal["mujoco"]["success"] == 0.5
    assert nominal["mujoco"]["cpu_s_median"] == 2.0
    assert nominal["bullet"]["drop_cm"] == pytest.approx(1.5)
    assert nominal["apart_mm"]["max"] == pytest.approx(2.0)
    assert both_engines.summarize([{"index": 4}])["nominal"] == {"n": 0}
