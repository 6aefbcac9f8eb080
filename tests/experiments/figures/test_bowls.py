"""Three bowls: what the figure states is what the plans say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from packenv.experiments.figures.bowls import COUNT, bowls, large_box, nesting_item
from packenv.experiments.figures.figure import Source
from packenv.geometry.prepare import PreparedItem
from packenv.planning.options import PlanOptions
from packenv.types import Placement
from tests.experiments.figures.sources import BOXES, SOME, Listener, source_of

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    return source_of(tmp_path_factory.mktemp("figures"), SOME)


def prepared(source: Source, *names: str) -> dict[str, PreparedItem]:
    shelf = source.shelf(PlanOptions.paper())
    return {name: shelf.prepared[name] for name in names}


def footprint(placements: tuple[Placement, ...]) -> float:
    """Area of the bounding boxes' union on a grid of millimetres, m²."""
    covered = np.zeros((320, 320), dtype=bool)
    for p in placements:
        (x0, y0), (x1, y1) = (np.rint(1000 * c[:2]).astype(int) for c in (p.corner, p.corner + p.extents))
        covered[x0:x1, y0:y1] = True
    return float(covered.sum()) * 1e-6


def test_hm_nests_the_bowls_and_dblf_spreads_them(source: Source) -> None:
    figure = bowls(source)
    assert figure is not None
    (order,) = figure.made_of["orders"]
    assert order == ["bowl"] * COUNT + ["cracker_box"]
    plans = [source.plan(order, PlanOptions.from_mapping(chosen)) for chosen in figure.made_of["options"]]
    assert [plan.settings["heuristic"] for plan in plans] == ["hm", "dblf", "hm", "dblf"]
    stacks = [plan.placements[:COUNT] for plan in plans]
    single = stacks[0][0].extents
    for nested, spread in (stacks[:2], stacks[2:]):
        assert footprint(nested) == pytest.approx(single[0] * single[1], rel=0.02)
        assert footprint(spread) == pytest.approx(COUNT * single[0] * single[1], rel=0.02)
        assert max(p.corner[2] + p.extents[2] for p in nested) < 0.6 * COUNT * single[2]
    heights = [max(p.corner[2] + p.extents[2] for p in stack) for stack in stacks]
    assert figure.made_of["bowls_height_m"] == pytest.approx(heights)
    round_share = np.pi / 4
    for stated, stack in zip(figure.made_of["bowls_floor_m2"], stacks, strict=True):
        assert stated == pytest.approx(round_share * footprint(stack), rel=0.06)  # every cell that is touched
    assert f"{1e4 * figure.made_of['bowls_floor_m2'][1]:.0f} cm²" in figure.caption


def test_a_bowl_is_what_a_copy_nests_in(source: Source) -> None:
    assert nesting_item(prepared(source, "bowl", "cracker_box", "apple", "nesting_cup_1")) == "bowl"
    assert nesting_item(prepared(source, "cracker_box", "plate")) == "plate"
    assert nesting_item(prepared(source, "cracker_box", "apple", "chips_can")) is None


def test_a_large_box_fills_its_bounding_box(source: Source) -> None:
    items = prepared(source, "bowl", "cracker_box", "sugar_box", "pitcher", "funnel")
    assert large_box(items, "bowl") == "cracker_box"
    assert large_box(prepared(source, "funnel", "bowl"), None) is None


def test_without_a_bowl_there_is_no_figure_and_a_remark(tmp_path: Path) -> None:
    listener = Listener()
    assert bowls(source_of(tmp_path, BOXES, listener)) is None
    (remark,) = listener.remarks
    assert "bowls" in remark
    assert "no bowl" in remark
    assert list(tmp_path.iterdir()) == []
