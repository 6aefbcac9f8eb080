"""A failing execution: what is shown happened, in that sequence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from packenv.experiments.figures import failure as module
from packenv.experiments.figures.failure import Failing, carry_out, failure, moments
from packenv.items.catalogue import Catalogue
from packenv.planning.options import PlanOptions
from packenv.types import Plan
from tests.experiments.figures.sources import BOXES, Listener, source_of
from tests.shapes import box

pytest.importorskip("matplotlib")

OPTIONS = PlanOptions.paper(constraints="overlap", geometry="parts", sequence="given")
ITEMS = Catalogue.of_items(
    {
        item.name: item
        for item in (
            box(0.1, 0.1, 0.08, "post"),
            box(0.1, 0.08, 0.05, "brick"),
            box(0.08, 0.08, 0.06, "block"),
        )
    }
)


def planned(tmp_path: Path, overhang: float) -> tuple[module.Source, Plan]:
    """A post, a brick that reaches over its edge, and a block beside the post, below the brick."""
    source = source_of(tmp_path, ITEMS)
    plan = source.plan(["post", "brick", "block"], OPTIONS)
    at = [(0.1, 0.1, 0.0), (0.1 + overhang, 0.11, 0.08), (0.21, 0.11, 0.0)]
    placements = tuple(
        replace(p, rotation=np.eye(3), position=np.array(place))
        for p, place in zip(plan.placements, at, strict=True)
    )
    return source, replace(plan, placements=placements)


def test_an_item_that_falls_off_is_met_by_the_next_one(tmp_path: Path) -> None:
    source, plan = planned(tmp_path, 0.09)
    found = carry_out(source, plan)
    assert isinstance(found, Failing)
    assert found.plan.placements[found.gone].item == "brick"
    assert found.executed.execution.cause == "item-displaced"
    fell = found.executed.execution.final[1].position - plan.placements[1].position
    assert found.away > 0.03
    assert np.linalg.norm(fell) > 0.01
    shown = moments(found)
    times = [moment.frame.time for moment in shown]
    assert times == sorted(set(times))
    assert 4 <= len(shown) <= 6
    assert [len(moment.frame.poses) for moment in shown] == sorted(len(m.frame.poses) for m in shown)
    # Before its release the brick is over its place, upright.
    first = shown[0].frame.poses[1]
    assert np.allclose(first.rotation, np.eye(3), atol=1e-6)
    assert np.allclose(first.position[:2], plan.placements[1].position[:2], atol=1e-6)
    assert "brick just before its release" in shown[0].words
    assert "block met brick" in shown[-1].words
    assert all(frame in found.frames for frame in (m.frame for m in shown))


def test_an_execution_that_goes_well_shows_nothing(tmp_path: Path) -> None:
    source, plan = planned(tmp_path, 0.0)
    done = carry_out(source, plan)
    assert not isinstance(done, Failing)
    assert done.success


def test_the_figure_of_a_failing_execution(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, plan = planned(tmp_path, 0.09)
    monkeypatch.setattr(module, "ORDERS", 1)
    monkeypatch.setattr(module.Source, "plan", lambda *_: plan)
    figure = failure(source)
    assert figure is not None
    assert figure.made_of["failed_step"] == 3
    assert figure.made_of["displaced_step"] == 2
    assert figure.made_of["times_s"] == sorted(figure.made_of["times_s"])
    assert "Of 1 executions of random orders, 1 failed, 1 in this way" in figure.caption
    assert figure.files[0].stat().st_size > 20_000


def test_where_nothing_fails_there_is_no_figure_and_a_remark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "ORDERS", 1)
    monkeypatch.setattr(module, "ITEMS", 2)
    listener = Listener()
    assert failure(source_of(tmp_path, BOXES, listener)) is None
    (remark,) = listener.remarks
    assert "failure" in remark
    assert list(tmp_path.iterdir()) == []
