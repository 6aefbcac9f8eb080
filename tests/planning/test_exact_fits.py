"""What a person sees fits, is packed: nesting items nest, layers stack to the rim, full-size items fit."""

from __future__ import annotations

import numpy as np
import pytest

import packenv as rp
from packenv.config import CLEARANCE, GridConfig
from packenv.planning.search.fitting import turned_to_fit
from packenv.types import StablePose
from tests.shapes import box, cup


def packed(
    order: dict[str, int], container: tuple[float, float, float], catalogue: object, **words: object
) -> rp.Plan:
    """The plan of an order, after its audit."""
    lines = [name for name, count in order.items() for _ in range(count)]
    plan = rp.plan(rp.Order.of(*lines), rp.Container(*container), catalogue, margins=False, **words)
    assert rp.verify(plan, catalogue).ok
    return plan


@pytest.mark.parametrize("taper", [0.6, 0.75, 0.9])
def test_cups_nest_as_closely_as_their_walls_allow(taper: float) -> None:
    """Each stands as far above the one below as the second above the first."""
    radius, height, wall = 0.04, 0.09, 0.002
    catalogue = {"cup": cup(radius, height, wall, "cup", taper)}
    plan = packed({"cup": 3}, (0.09, 0.09, 0.3), catalogue, constraints="overlap")
    bottoms = np.sort([p.corner[2] for p in plan.placements])
    two = packed({"cup": 2}, (0.09, 0.09, 0.3), catalogue, constraints="overlap")
    pitch = max(p.corner[2] for p in two.placements)
    assert np.diff(bottoms) == pytest.approx([pitch, pitch], abs=5e-6)
    assert pitch < 0.6 * height


@pytest.mark.parametrize("layers", [1, 2, 3, 7, 10])
@pytest.mark.parametrize("heights", ["map", "mesh"])
def test_exact_layers_stack_to_the_rim(layers: int, heights: str) -> None:
    slab = box(0.16, 0.16, 0.15 / layers, "slab")  # too large to stand on edge
    plan = packed({"slab": layers}, (0.16, 0.16, 0.15), {"slab": slab}, heights=heights)
    assert len(plan.placements) == layers


@pytest.mark.parametrize("over", [0.0, 1.5e-9, 0.4 * CLEARANCE, 0.9 * CLEARANCE])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_item_as_large_as_the_container_fits(axis: int, over: float) -> None:
    size = [0.2, 0.16, 0.1]
    size[axis] += over
    plan = packed({"block": 1}, (0.2, 0.16, 0.1), {"block": box(*size, "block")})
    assert plan.complete


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_one_that_is_larger_does_not_and_the_message_shows_it(axis: int) -> None:
    size = [0.2, 0.16, 0.1]
    size[axis] += 2 * CLEARANCE
    plan = packed({"block": 1}, (0.2, 0.16, 0.1), {"block": box(*size, "block")})
    assert [left.reason for left in plan.leftovers] == ["larger-than-container"]
    assert f"{size[axis]:.5f}" in plan.leftovers[0].detail


@pytest.mark.parametrize("sides", [(3, 3, 3), (2, 4, 3), (5, 1, 2)])
def test_boxes_of_whole_cells_fill_the_container(sides: tuple[int, int, int]) -> None:
    brick = box(0.06, 0.06, 0.06, "brick")
    container = tuple(0.06 * n for n in sides)
    plan = packed(
        {"brick": int(np.prod(sides))}, container, {"brick": brick}, constraints="overlap", grid_step=0.002
    )
    assert plan.complete


def test_a_rod_is_turned_wherever_a_rectangle_fits_a_rectangle() -> None:
    """Carver's condition: p × q fits P × Q (p > P, q ≤ Q) where ((P+Q)/(p+q))² + ((P-Q)/(p-q))² ≥ 2."""
    rng = np.random.default_rng(1)
    grid, pose = GridConfig(), StablePose(np.eye(3), 1.0, 0.01)
    counts = {True: 0, False: 0}
    for _ in range(300):
        large, small = np.sort(rng.uniform(0.1, 0.4, 2))[::-1]
        rod, wide = large * rng.uniform(1.005, 1.25), small * rng.uniform(0.02, 0.6)
        sum_, difference = (large + small) / (rod + wide), (large - small) / (rod - wide)
        room = sum_**2 + difference**2 - 2.0
        if abs(room) < 0.01:
            continue  # within a quarter of a degree of the border
        item = box(rod, wide, 0.02, "rod")
        found = turned_to_fit(item, (pose,), grid, (large, small, 0.1))
        assert bool(found) == (room > 0.0), (rod, wide, large, small)
        for oriented in found:
            assert (oriented.extents <= np.array([large, small, 0.1]) + CLEARANCE).all()
        counts[bool(found)] += 1
    assert min(counts.values()) > 30


@pytest.mark.parametrize("constraints", ["overlap", "stability"])
def test_a_rod_longer_than_the_container_lies_across(constraints: str) -> None:
    rod = {"rod": box(0.42, 0.015, 0.015, "rod")}
    plan = packed({"rod": 1}, (0.40, 0.20, 0.10), rod, constraints=constraints)
    assert plan.complete
    assert not packed({"rod": 1}, (0.40, 0.20, 0.10), rod, constraints=constraints, heights="map").complete
