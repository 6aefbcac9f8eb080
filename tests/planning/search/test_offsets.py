"""How far an item may be off: closed forms, laws, and every shift tried."""

from __future__ import annotations

import numpy as np
import pytest

from packenv.geometry.heightmaps import orient_item
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.offsets import LARGEST_OFFSET, largest_offset
from packenv.types import Container
from tests import shapes

CELL = 0.002
BOX = Container(0.2, 0.2, 0.2)
RELEASE = 0.01
BRICK = orient_item(shapes.box(0.04, 0.04, 0.03), np.eye(3), cell_size=CELL)


def surface_of(*blocks: tuple[int, int, int, int, float]) -> ContainerMap:
    """Blocks over cells x0 to x1 and y0 to y1, of a height."""
    heights = np.zeros((100, 100), dtype=np.float32)
    for x0, x1, y0, y1, z in blocks:
        heights[x0:x1, y0:y1] = z
    return ContainerMap(BOX, CELL, heights)


def offset(surface: ContainerMap, ix: int, iy: int, z: float = 0.0, release: float = RELEASE) -> float:
    return largest_offset(surface, BRICK, ix, iy, z, release)


@pytest.mark.parametrize("gap", [0, 1, 3, 7])
def test_a_gap_to_a_wall_or_to_what_is_higher_than_the_release_is_the_offset(gap):
    assert offset(surface_of(), gap, 40) == pytest.approx(gap * CELL)
    assert offset(surface_of(), 40, 80 - gap) == pytest.approx(gap * CELL)
    neighbour = (60 + gap, 80, 30, 70, 0.05)
    assert offset(surface_of(neighbour), 40, 40) == pytest.approx(gap * CELL)
    diagonal = (60 + gap, 80, 60 + gap, 80, 0.05)
    assert offset(surface_of(diagonal), 40, 40) == pytest.approx(gap * CELL)


def test_what_is_lower_than_the_release_is_not_met():
    step = (60, 80, 30, 70, RELEASE)
    assert offset(surface_of(step), 30, 40) == offset(surface_of(), 30, 40) == LARGEST_OFFSET
    assert offset(surface_of(step), 40, 40) == LARGEST_OFFSET
    assert offset(surface_of(step), 40, 40, release=0.5 * RELEASE) == 0.0


def test_it_is_capped_and_zero_where_the_maps_tell_of_no_way_down():
    assert offset(surface_of(), 40, 40) == LARGEST_OFFSET
    assert offset(surface_of((40, 60, 40, 60, 0.1)), 40, 40) == 0.0
    whole = orient_item(shapes.box(0.2, 0.2, 0.05), np.eye(3), cell_size=CELL)
    assert largest_offset(surface_of(), whole, 0, 0, 0.0, RELEASE) == 0.0


def test_it_is_the_largest_square_of_shifts_that_all_come_down():
    """Every shift tried by itself; heights of the right size, so that each answer is seen."""
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(60):
        blocks = [
            (int(x), int(x) + 8, int(y), int(y) + 8, float(rng.uniform(0.0, 0.03)))
            for x, y in rng.integers(0, 92, (6, 2))
        ]
        surface = surface_of(*blocks)
        ix, iy = (int(v) for v in rng.integers(0, 81, 2))
        z = surface.bound(BRICK, ix, iy)

        def comes_down(dx: int, dy: int) -> bool:
            x, y = ix + dx, iy + dy  # noqa: B023
            inside = 0 <= x <= 80 and 0 <= y <= 80
            return inside and surface.bound(BRICK, x, y) <= z + RELEASE  # noqa: B023

        cells = 0
        while cells < 10:
            reach = range(-cells - 1, cells + 2)
            if not all(comes_down(dx, dy) for dx in reach for dy in reach):
                break
            cells += 1
        assert offset(surface, ix, iy, z) == pytest.approx(cells * CELL)
        seen.add(cells)
    assert len(seen) >= 5


def test_a_mirrored_box_and_a_higher_release_change_it_as_they_should():
    rng = np.random.default_rng(4)
    for _ in range(30):
        blocks = [(int(x), int(x) + 9, int(y), int(y) + 9, 0.02) for x, y in rng.integers(0, 91, (5, 2))]
        surface = surface_of(*blocks)
        mirror = ContainerMap(BOX, CELL, np.ascontiguousarray(surface.heights[::-1]))
        ix, iy = (int(v) for v in rng.integers(0, 81, 2))
        found = offset(surface, ix, iy)
        assert offset(mirror, 80 - ix, iy) == found
        assert offset(surface, ix, iy, release=0.02) >= found
