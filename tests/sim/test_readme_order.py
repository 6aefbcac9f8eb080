"""The order of the README in its box, planned as anybody would first: what stands in the plan stands in physics."""

from __future__ import annotations

from dataclasses import replace

import pytest

import packenv as rp
from packenv.execution.physics_planner import INSIDE
from packenv.items.catalogue import open_catalogue
from packenv.items.shelf import ItemShelf
from packenv.shipped import assets_dir
from packenv.sim.drop_test import DropTest, Lying, Release
from packenv.sim.world import WorldConfig
from packenv.types import Container, Pose

pytestmark = pytest.mark.usefixtures("auto")

WATCH = replace(INSIDE, settle=4.0)
"""Gaps at the sides let an item slip by millimetres, and a duck may roll in its bowl; what hangs falls."""


def test_nothing_of_the_readmes_order_hangs() -> None:
    plan = rp.plan(rp.load_order(assets_dir() / "orders" / "ten.csv"), Container(0.32, 0.32, 0.30))
    shelf = ItemShelf(open_catalogue("builtin"))
    test = DropTest(plan.container, WorldConfig())
    pile: tuple[Lying, ...] = ()
    for placement in plan.placements:
        item, pose = shelf.physics[placement.item], Pose(placement.rotation, placement.position)
        dropped = test.drop(pile, item, *pose, Release(height=0.0), WATCH)
        assert not dropped.reason
        assert dropped.sink_m < 0.012, f"{placement.item} falls by {dropped.sink_m:.3f} m"
        pile = (*pile, Lying(item, pose))
    test.close()
    assert len(pile) == 10
    assert rp.verify(plan).ok
