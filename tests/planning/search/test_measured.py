"""Heightmaps of items where they really lie."""

from __future__ import annotations

import numpy as np
import pytest

from packenv.geometry.heightmaps import orient_item
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting, measured_map
from packenv.types import Container
from tests.geometry_samples import random_rotation, surface_samples
from tests.shapes import box, cup

BOX = Container(0.2, 0.16, 0.12)
CELL = 0.002


@pytest.mark.parametrize("seed", range(4))
def test_on_whole_cells_it_is_the_map_that_the_planner_keeps(seed: int) -> None:
    item, rotation = cup(0.03, 0.05), random_rotation(seed)
    oriented = orient_item(item, rotation, cell_size=CELL)
    planned = ContainerMap.empty(BOX, CELL).with_item(oriented, 11, 7, 0.01)
    position = oriented.offset + np.array([11 * CELL, 7 * CELL, 0.01])
    measured = measured_map(BOX, CELL, [Resting(item, rotation, position)])
    # Rounding may touch one more ring of cells, or move a height by a quantum.
    higher = measured.heights - planned.heights
    assert (higher >= -2e-6).all()
    assert np.mean(np.abs(higher) > 2e-6) < 0.02


@pytest.mark.parametrize("seed", range(6))
def test_no_point_of_an_item_is_above_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    item, rotation = cup(0.03, 0.05), random_rotation(seed)
    position = np.array([0.08, 0.08, 0.04]) + rng.uniform(-0.03, 0.03, 3)
    heights = measured_map(BOX, CELL, [Resting(item, rotation, position)]).heights
    points = surface_samples(item, 4000, rng) @ rotation.T + position
    inside = ((points[:, :2] > 0) & (points[:, :2] < np.array(BOX.size[:2]) - CELL)).all(axis=1)
    i, j = (points[inside, :2] / CELL).astype(int).T
    assert (heights[i, j] >= points[inside, 2] - 1e-9).all()


def test_what_sticks_out_is_cut_off_at_the_walls() -> None:
    item = box(0.1, 0.1, 0.05)
    out = Resting(item, np.eye(3), np.array([-0.06, 0.12, 0.0]))
    heights = measured_map(BOX, CELL, [out]).heights
    raised = np.argwhere(heights > 0.0)
    assert raised.min(axis=0).tolist() == [0, 60]
    assert raised.max(axis=0).tolist() in ([19, 79], [20, 79])
    assert heights.max() == pytest.approx(0.05, abs=1e-6)


def test_items_lie_on_what_lies_beneath() -> None:
    item = box(0.05, 0.05, 0.02)
    below = measured_map(BOX, CELL, [Resting(item, np.eye(3), np.array([0.02, 0.02, 0.0]))])
    both = measured_map(BOX, CELL, [Resting(item, np.eye(3), np.array([0.1, 0.1, 0.0]))], below)
    apart = measured_map(BOX, CELL, [Resting(item, np.eye(3), np.array([a, a, 0.0])) for a in (0.02, 0.1)])
    assert np.array_equal(both.heights, apart.heights)
