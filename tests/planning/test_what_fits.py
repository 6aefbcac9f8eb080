"""What users reported as not packed though everyone sees that it fits: one case of each kind, with its answer."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

import numpy as np
import pytest

import packenv as rp
from benchmarks.shells import cup, sleeve
from packenv.items.catalogue import Catalogue, open_catalogue
from packenv.types import Item
from tests.shapes import as_item, box, cylinder

Size = tuple[float, float, float]
MM = 1e-3


def packed(
    items: Mapping[str, Item] | str, order: Mapping[str, int], size: Size, **options: object
) -> rp.Plan:
    """The plan of an order, after its check: 0 overlaps, 0 unstable, 0 unreachable."""
    lines = [name for name, count in order.items() for _ in range(count)]
    plan = rp.plan(rp.Order.of(*lines), rp.Container(*size), items, margins=False, **options)
    report = rp.verify(plan, items)
    assert report.ok, report.to_json()
    return plan


CUP = cup(foot=25 * MM, height=100 * MM, half_angle=math.atan(0.15), wall=0.00224, floor=2 * MM)
"""Of 80 mm at the rim; wall / sin(half angle) is 15.1 mm."""

ROWS_AND_LAYERS: dict[str, tuple[Item, int, Size]] = {
    "27 cubes of 100 in 300": (box(0.1, 0.1, 0.1, "item"), 27, (0.3, 0.3, 0.3)),
    "8 cubes of 125 in 250": (box(0.125, 0.125, 0.125, "item"), 8, (0.25, 0.25, 0.25)),
    "3 of 105 in 320": (box(0.105, 0.08, 0.06, "item"), 3, (0.32, 0.08, 0.06)),
    "12 of 105 x 80 in 320 x 320": (box(0.105, 0.08, 0.06, "item"), 12, (0.32, 0.32, 0.06)),
    "7 of 41 in 320": (box(0.041, 0.3, 0.05, "item"), 7, (0.32, 0.32, 0.06)),
    "6 nested cups": (CUP.item("item"), 6, (0.09, 0.09, 0.19)),
    "7 nested cups": (CUP.item("item"), 7, (0.09, 0.09, 0.2)),
}


@pytest.mark.parametrize("case", ROWS_AND_LAYERS)
def test_as_many_as_a_person_sees_and_no_more(case: str) -> None:
    item, count, size = ROWS_AND_LAYERS[case]
    plan = packed({"item": item}, {"item": count + 2}, size, constraints="overlap")
    assert len(plan.placements) == count, [left.detail for left in plan.leftovers]


def test_the_size_of_the_container_in_single_precision_fits() -> None:
    """float32 of 0.1 is 1.5 nm more than 0.1; meshes come with such numbers."""
    sizes = np.array([0.3, 0.2, 0.1], dtype=np.float32).astype(float)
    assert sizes[2] > 0.1
    item = {"full": box(*sizes, "full")}
    assert packed(item, {"full": 1}, (0.301, 0.201, 0.1), constraints="overlap").complete
    assert packed(item, {"full": 1}, (0.3, 0.2, 0.1), constraints="overlap").complete


@pytest.mark.parametrize("width", [0.2, 0.168])
def test_a_rod_fits_at_a_yaw_of_25_degrees(width: float) -> None:
    """420 × 20 mm in 400 mm needs a width of 167.0 mm by Carver's condition."""
    rod = {"rod": box(0.42, 0.02, 0.02, "rod")}
    assert packed(rod, {"rod": 1}, (0.4, width, 0.1), constraints="overlap").complete
    assert not packed(rod, {"rod": 1}, (0.4, 0.1665, 0.021), constraints="overlap").complete


@pytest.mark.parametrize("constraints", ["overlap", "stability"])
def test_a_rod_leans_from_corner_to_corner(constraints: str) -> None:
    rod = {"rod": cylinder(0.008, 0.5, "rod", sections=24)}
    assert packed(rod, {"rod": 1}, (0.32, 0.32, 0.3), constraints=constraints).complete
    assert not packed(rod, {"rod": 1}, (0.28, 0.28, 0.28), constraints=constraints).complete  # diagonal 0.485


@pytest.mark.parametrize("constraints", ["overlap", "stability"])
def test_a_rod_leans_in_a_narrow_container(constraints: str) -> None:
    rod = {"rod": cylinder(0.008, 0.4, "rod", sections=24)}
    assert packed(rod, {"rod": 1}, (0.3, 0.1, 0.3), constraints=constraints).complete


def test_a_leaning_rod_that_no_cup_can_hold_is_said_to_be_that() -> None:
    rod = {"rod": cylinder(0.008, 0.4, "rod", sections=24)}
    (left,) = packed(rod, {"rod": 1}, (0.3, 0.1, 0.3), constraints="robot").leftovers
    assert left.reason != "larger-than-container", left.detail


def test_a_core_goes_into_its_sleeve() -> None:
    """A core of 58 mm in a bore of 62 mm, anywhere up to 2 mm beside the middle."""
    middle = np.array([35 * MM, 35 * MM, 0.0])
    shell = sleeve(70 * MM, 62 * MM, 60 * MM, "sleeve").to_trimesh().apply_translation(middle)
    items = {"sleeve": as_item(shell, "sleeve"), "core": box(58 * MM, 58 * MM, 70 * MM, "core")}
    for size in ((0.07, 0.07, 0.07), (0.08, 0.08, 0.07)):
        plan = packed(items, {"sleeve": 1, "core": 1}, size, constraints="overlap")
        assert plan.complete, [left.detail for left in plan.leftovers]
        first, second = plan.placements
        apart = second.corner - first.corner
        assert np.all((apart[:2] >= 4 * MM - 2e-5) & (apart[:2] <= 8 * MM + 2e-5))


def builtin(name: str) -> Item:
    return open_catalogue("builtin").item(name)


NESTING: dict[str, tuple[str, int, Size]] = {
    "3 bowls": ("bowl", 3, (0.17, 0.17, 0.12)),
    "4 party cups": ("party_cup", 4, (0.1, 0.1, 0.26)),
    "3 trays": ("storage_tray", 3, (*map(float, builtin("storage_tray").extents[:2]), 0.12)),
    "6 plates": ("plate", 6, (0.3, 0.3, 0.3)),
}


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
@pytest.mark.parametrize("case", NESTING)
def test_built_in_items_nest(case: str, constraints: str) -> None:
    name, count, size = NESTING[case]
    plan = packed("builtin", {name: count}, size, constraints=constraints)
    assert plan.complete, [left.detail for left in plan.leftovers]


@pytest.mark.parametrize("constraints", ["overlap", "stability", "robot"])
def test_nesting_cups_are_packed_into_one_another(constraints: str) -> None:
    order = {f"nesting_cup_{k}": 1 for k in range(1, 6)}
    plan = packed("builtin", order, (0.1, 0.1, 0.1), constraints=constraints)
    assert plan.complete, [left.detail for left in plan.leftovers]


@pytest.mark.parametrize("constraints", ["stability", "robot"])
def test_nested_cups_are_held_by_those_below(constraints: str) -> None:
    plan = packed({"cup": CUP.item("cup")}, {"cup": 6}, (0.09, 0.09, 0.2), constraints=constraints)
    assert plan.complete, [left.rejections for left in plan.leftovers]
    bottoms = np.array([p.corner[2] for p in plan.placements])
    assert np.diff(bottoms) == pytest.approx(CUP.pitch, abs=1e-5)


PITCHES = {"bowl": 0.0111, "party_cup": 0.0176, "storage_tray": 0.0171}
"""Of built-in items by an exact distance of meshes (FCL), m, to 0.05 mm."""


@pytest.mark.parametrize("name", PITCHES)
def test_built_in_items_stand_as_close_as_their_meshes_allow(name: str) -> None:
    across = builtin(name).extents[:2]
    plan = packed("builtin", {name: 3}, (*map(float, across), 0.5), constraints="overlap")
    bottoms = np.sort([p.corner[2] for p in plan.placements])
    assert np.diff(bottoms) == pytest.approx(PITCHES[name], abs=5e-4)


@pytest.mark.parametrize(
    ("size", "lengths"),
    [((1.2, 0.8, 0.8), ("0.8", "0.3")), ((0.4, 0.3, 0.4), ("0.4", "0.3"))],
    ids=["pallet", "deep container"],
)
def test_what_the_robot_cannot_reach_is_said_at_once(size: Size, lengths: tuple[str, str]) -> None:
    """In a sentence with the two lengths: that of the container and that of the gripper."""
    items = {"carton": box(0.3, 0.2, 0.1, "carton")}
    packed(items, {"carton": 1}, (0.4, 0.3, 0.2))  # compiles what there is to compile
    catalogue = Catalogue.of_items(items)
    start = time.process_time()
    plan = rp.plan(rp.Order.of(*["carton"] * 8), rp.Container(*size), catalogue)
    assert time.process_time() - start < 2.0
    assert not plan.placements
    for left in plan.leftovers:
        assert left.reason == "unreachable-container"
        assert all(length in left.detail for length in lengths), left.detail
