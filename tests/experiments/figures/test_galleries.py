"""Packed boxes: whole plans alone, each in its smallest box."""

from __future__ import annotations

from pathlib import Path

import pytest

from packenv.experiments.figures import galleries
from packenv.experiments.figures.galleries import large_gallery, small_gallery
from packenv.io.containers import read_boxes
from packenv.planning.options import PlanOptions
from packenv.types import Container
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


def test_what_is_not_packed_whole_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tight = Container(0.2, 0.2, 0.28)
    monkeypatch.setattr(galleries.Source, "box", tight)
    listener = Listener()
    source = source_of(tmp_path, SOME, listener)
    figure = large_gallery(source)
    if figure is None:
        assert "large-orders" in listener.remarks[0]
        return
    options = PlanOptions.from_mapping(figure.made_of["options"])
    whole = [source.plan(order, options).complete for order in figure.made_of["orders"]]
    assert [k for k, complete in enumerate(whole) if not complete] == figure.made_of["not_packed"]
    assert sum(whole) == len(figure.made_of["boxes"])
