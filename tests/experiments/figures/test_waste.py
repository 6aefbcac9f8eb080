"""Space wasted below an item, from volumes that are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from packenv.experiments.figures import waste
from packenv.experiments.figures.waste import RANKING, placed_last, stable_versus_not
from packenv.items.catalogue import Catalogue
from packenv.planning.options import PlanOptions
from tests.experiments.figures.sources import SOME, source_of
from tests.shapes import box

pytest.importorskip("matplotlib")

HM = replace(RANKING, sequence="given")
TABLE = Catalogue.of_items({"post": box(0.1, 0.1, 0.1, "post"), "plank": box(0.24, 0.1, 0.02, "plank")})


def test_a_box_on_the_floor_wastes_nothing(tmp_path: Path) -> None:
    source = source_of(tmp_path, TABLE)
    found = placed_last(source, source.plan(["post", "post"], HM))
    assert found.waste == pytest.approx(0.0, abs=1e-9)
    assert found.stable


@pytest.mark.parametrize(("reach", "stands"), [(0.03, True), (0.11, True), (0.14, False)])
def test_what_reaches_over_an_edge_wastes_what_is_below(tmp_path: Path, reach: float, stands: bool) -> None:
    """A plank of 24 cm on a post of 10 × 10 × 10 cm, away from all walls: it stands while its middle is on the post."""
    source = source_of(tmp_path, TABLE)
    plan = source.plan(["post", "plank"], HM)
    post, plank = plan.placements
    end = 0.04 + 0.24
    post = replace(post, rotation=np.eye(3), position=np.array([end - reach - 0.1, 0.1, 0.0]))
    plank = replace(plank, rotation=np.eye(3), position=np.array([end - 0.24, 0.1, 0.1]))
    found = placed_last(source, replace(plan, placements=(post, plank)))
    assert found.waste == pytest.approx((0.24 - 0.1) * 0.1 * 0.1, rel=0.03)
    assert found.stable is stands


def test_the_figure_states_what_it_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(waste, "ORDERS", 4)
    source = source_of(tmp_path, SOME)
    figure = stable_versus_not(source)
    assert figure is not None
    volumes, orders = figure.made_of["wasted_m3"], figure.made_of["orders"]
    assert len(volumes) == len(orders) == len(figure.made_of["stable"]) <= 4
    again = []
    for order in orders:
        pile = source.plan(order[:-1], HM.changed({"constraints": "stability", "sequence": "volume"}))
        plans = [
            source.plan(order[-1:], PlanOptions.from_mapping(options), start=pile)
            for options in figure.made_of["options"]
        ]
        again.append([placed_last(source, plan).waste for plan in plans])
        assert all(p.item == order[-1] for p in (plan.placements[-1] for plan in plans))
    assert volumes == again
    hm, dblf = (1e6 * float(np.mean([pair[side] for pair in volumes])) for side in (0, 1))
    assert f"HM wastes {hm:.0f} cm³ on average and DBLF {dblf:.0f}" in figure.caption
