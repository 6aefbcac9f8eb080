"""Packed boxes: whole plans alone, each in its smallest box."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from packenv.experiments.figures import galleries
from packenv.experiments.figures.figure import Source
from packenv.experiments.figures.galleries import large_gallery, small_gallery
from packenv.io.containers import read_boxes
from packenv.planning.options import PlanOptions
from packenv.types import Leftover, Plan
from tests.experiments.figures.sources import SOME, Listener, source_of

pytest.importorskip("matplotlib")


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(galleries, "SHOWN", 2)


def test_small_orders_are_in_the_smallest_box_that_takes_them(tmp_path: Path) -> None:
    source = source_of(tmp_path, SOME)
    figure = small_gallery(source)
    assert figure is not None
    boxes = sorted(read_boxes(), key=lambda box: box.volume)
    orders = [o for k, o in enumerate(figure.made_of["orders"]) if k not in figure.made_of["not_packed"]]
    assert len(orders) == len(figure.made_of["boxes"]) == 2
    for order, name in zip(orders, figure.made_of["boxes"], strict=True):
        assert 3 <= len(order) <= 5
        smaller = [box for box in boxes if box.volume < next(b for b in boxes if b.name == name).volume]
        options = PlanOptions.from_mapping(figure.made_of["options"])
        assert not any(source.plan(order, options, box).complete for box in smaller)


def test_what_is_not_packed_whole_is_told_and_not_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every second order leaves something over."""
    real, asked = Source.plan, []

    def plan(source: Source, order: list[str], options: PlanOptions, container: Any) -> Plan:
        asked.append(order)
        made = real(source, order[:2], options.changed({"constraints": "overlap"}), container)
        left = (Leftover(order[2], 1, "no-legal-candidate", "there is none"),) if len(asked) % 2 else ()
        return replace(made, leftovers=left)

    monkeypatch.setattr(Source, "plan", plan)
    figure = large_gallery(source_of(tmp_path, SOME))
    assert figure is not None
    assert figure.made_of["orders"] == asked
    assert figure.made_of["not_packed"] == [0, 2]
    assert len(figure.made_of["boxes"]) == 2
    assert "2 of the first 4 random orders" in figure.caption
    assert "the other 2 left something over" in figure.caption


def test_where_nothing_is_packed_there_is_no_figure_and_a_remark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = Leftover("bowl", 1, "no-legal-candidate", "there is none")
    monkeypatch.setattr(Source, "plan", lambda *_: Plan(source.box, (), (left,)))
    listener = Listener()
    source = source_of(tmp_path, SOME, listener)
    assert large_gallery(source) is None
    assert "large-orders" in listener.remarks[0]
    assert list(tmp_path.iterdir()) == []
