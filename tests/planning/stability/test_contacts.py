"""Laws of contacts first, closed forms second."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from packenv.config import GridConfig
from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.prepare import prepare_item
from packenv.items.catalogue import open_catalogue
from packenv.planning.planner import Planner, by_box_volume
from packenv.planning.search.heuristics import HEURISTICS
from packenv.planning.stability.contact_patches import HULL, thin
from packenv.planning.stability.contacts import (
    THRESHOLD,
    Body,
    item_contacts,
    join,
    no_contacts,
)
from packenv.planning.stability.paper_contacts import paper_contacts
from packenv.types import Contacts, Container, FloatArray, Item
from tests.geometry.test_distance_grids import closest_by_brute_force
from tests.shapes import ball, box, cup, cylinder

BOX = Container(0.32, 0.32, 0.30)
UP = np.array([0.0, 0.0, 1.0])
_FIELDS: dict[str, SurfaceField] = {}


def body(item: Item, position: tuple[float, float, float], rotation: FloatArray | None = None) -> Body:
    field = _FIELDS.setdefault(item.sha256, SurfaceField.of_item(item))
    return Body(field, np.eye(3) if rotation is None else rotation, np.array(position, float))


def pile_contacts(bodies: list[Body], container: Container, *, threshold: float = THRESHOLD) -> Contacts:
    """All contacts of a pile, unthinned."""
    found = [
        item_contacts(body, bodies[:i], container, index=i + 1, threshold=threshold)
        for i, body in enumerate(bodies)
    ]
    return join(found)


def turn(axis: int, angle: float) -> FloatArray:
    """Rotation by an angle about axis 0, 1 or 2."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[i, i], rotation[i, j], rotation[j, i], rotation[j, j] = c, -s, s, c
    return rotation


def between(contacts: Contacts, first: int) -> Contacts:
    """Only those with the body ``first``."""
    at = contacts.first == first
    return Contacts(*(getattr(contacts, k)[at] for k in ("points", "normals", "first", "second", "gaps")))


def level_area(points: FloatArray) -> float:
    return float(ConvexHull(points[:, :2]).volume)


def packed_pile(items: list[Item]) -> list[Body]:
    """The items as the planner packs them."""
    grid = GridConfig()
    prepared = {item.name: prepare_item(item, grid) for item in items}
    sequence = by_box_volume([item.name for item in items], prepared)
    plan = Planner(HEURISTICS["hm"], grid).pack(sequence, prepared, BOX)
    named = {item.name: item for item in items}
    return [body(named[p.item], tuple(p.position), p.rotation) for p in plan.placements]


@pytest.fixture(scope="module")
def pile() -> list[Body]:
    bodies = packed_pile(
        [
            cup(0.06, 0.08, name="bowl"),
            cup(0.05, 0.07, name="bowl two"),
            box(0.2, 0.15, 0.05, "book"),
            ball(0.02),
            cylinder(0.03, 0.1),
            box(0.05, 0.05, 0.05, "cube"),
        ]
    )
    assert len(bodies) == 6
    return bodies


# Laws


def test_contacts_move_with_the_scene(pile: list[Body]) -> None:
    rotation = turn(2, 0.7) @ turn(0, 0.3)
    shift = np.array([1.0, -2.0, 3.0])
    moved = [Body(b.field, rotation @ b.rotation, rotation @ b.position + shift) for b in pile]
    for index in range(2, len(pile) + 1):
        here, there = (item_contacts(s[index - 1], s[: index - 1], BOX, index=index) for s in (pile, moved))
        # Walls and floor stay where they are, so only items' contacts move along.
        here = join([between(here, i) for i in range(1, index)])
        there = join([between(there, i) for i in range(1, index)])
        # Single precision of the samples may take a gap over the threshold.
        firm = here.gaps < THRESHOLD - 1e-6
        assert abs(len(here) - len(there)) <= (~firm).sum() + 2
        for point, normal in zip(here.points[firm], here.normals[firm], strict=True):
            away = np.linalg.norm(there.points - (rotation @ point + shift), axis=1)
            aligned = np.linalg.norm(there.normals - rotation @ normal, axis=1)
            assert np.maximum(away, aligned).min() < 1e-5


def test_swapping_roles_flips_normals(pile: list[Body]) -> None:
    compared = 0
    for i, a in enumerate(pile):
        for b in pile[i + 1 :]:
            one = between(item_contacts(b, [a], BOX, index=2), 1)
            two = between(item_contacts(a, [b], BOX, index=2), 1)
            rows = [np.column_stack([c.points, s * c.normals, c.gaps]) for c, s in ((one, 1.0), (two, -1.0))]
            assert len(one) == len(two)
            one_sorted, two_sorted = (r[np.lexsort(np.round(r, 9).T)] for r in rows)
            assert one_sorted == pytest.approx(two_sorted, abs=1e-9)
            compared += len(one)
    assert compared > 100


def one_by_one(one: Body) -> Body:
    """The same samples, each in a block of its own that is too large to be passed by."""
    points = one.field.samples.astype(np.float64)
    spheres = np.column_stack([points, np.ones(len(points))])
    return replace(one, field=replace(one.field, starts=np.arange(len(points) + 1), spheres=spheres))


def check_same_one_by_one(bodies: list[Body]) -> int:
    """What passing samples by leaves is what looking at each of them finds, to the last bit."""
    alone, found = [one_by_one(b) for b in bodies], 0
    for i in range(len(bodies)):
        fast, slow = (item_contacts(s[i], s[:i], BOX, index=i + 1) for s in (bodies, alone))
        for name in ("points", "normals", "first", "second", "gaps"):
            of_items = getattr(fast, name)[fast.first > 0], getattr(slow, name)[slow.first > 0]
            np.testing.assert_array_equal(*of_items)
        found += int((fast.first > 0).sum())
    return found


def test_no_sample_that_touches_is_passed_by(pile: list[Body]) -> None:
    assert check_same_one_by_one(pile) > 500
    shaken = np.random.default_rng(5).uniform(-2e-3, 2e-3, (len(pile), 3))
    off = [
        Body(b.field, turn(1, 0.02) @ b.rotation, b.position + d) for b, d in zip(pile, shaken, strict=True)
    ]
    assert check_same_one_by_one(off) > 100


def check_near_both_surfaces(bodies: list[Body], contacts: Contacts, most: int = 60) -> None:
    assert np.linalg.norm(contacts.normals, axis=1) == pytest.approx(1.0, abs=1e-6)
    assert np.all(np.abs(contacts.gaps) <= THRESHOLD + 1e-9)
    pick = np.random.default_rng(0).permutation(len(contacts))[:most]
    for number in range(1, len(bodies) + 1):
        field, b = bodies[number - 1].field, bodies[number - 1]
        at = pick[(contacts.first[pick] == number) | (contacts.second[pick] == number)]
        local = (contacts.points[at] - b.position) @ b.rotation
        away = closest_by_brute_force(field.vertices, field.faces.astype(np.int64), local)
        assert away.max(initial=0.0) <= THRESHOLD + 1e-7
    floor = contacts.first == 0
    margin = np.abs(np.concatenate([contacts.points, contacts.points - np.array(BOX.size)], axis=1)[:, :5])
    assert margin[floor].min(axis=1) == pytest.approx(0.0, abs=1e-12)


def test_points_are_near_both_surfaces(pile: list[Body]) -> None:
    contacts = pile_contacts(pile, BOX)
    assert set(contacts.second) == set(range(1, 7))
    assert np.all(contacts.first < contacts.second)
    check_near_both_surfaces(pile, contacts)


@pytest.mark.objects
def test_points_of_scanned_items_are_near_both_surfaces(objects_dir: Path) -> None:
    shelf = open_catalogue(str(objects_dir))
    names = ("072-c_toy_airplane", "024_bowl", "002_master_chef_can", "013_apple")
    bodies = packed_pile([shelf.item(name) for name in names if name in shelf.names])
    contacts = pile_contacts(bodies, BOX)
    assert set(contacts.second) == set(range(1, len(bodies) + 1))
    check_near_both_surfaces(bodies, contacts, 40)
    assert check_same_one_by_one(bodies) > 100
    thinned = thin(contacts)
    assert 0 < len(thinned) < 0.5 * len(contacts)


def test_a_larger_threshold_only_adds(pile: list[Body]) -> None:
    small, large = (pile_contacts(pile, BOX, threshold=t) for t in (0.7e-3, 1.5e-3))
    assert len(small) < len(large)
    # Feet on the same faces: every contact of the small threshold is one of the large.
    kept = {tuple(np.round(np.r_[p, n], 9)) for p, n in zip(large.points, large.normals, strict=True)}
    found = [
        tuple(np.round(np.r_[p, n], 9)) in kept for p, n in zip(small.points, small.normals, strict=True)
    ]
    assert np.mean(found) > 0.99


def test_no_contacts_joined_are_none() -> None:
    assert len(join([])) == len(no_contacts()) == 0


def test_wrong_arguments_are_refused() -> None:
    cube = body(box(0.05, 0.05, 0.05), (0, 0, 0))
    with pytest.raises(ValueError, match="give 1"):
        item_contacts(cube, [], BOX, index=2)
    with pytest.raises(ValueError, match="threshold"):
        item_contacts(cube, [], BOX, index=1, threshold=0.01)
    with pytest.raises(ValueError, match="give 1"):
        paper_contacts(cube, [], BOX, index=3)


# Closed forms


def test_box_on_floor_is_held_by_its_footprint() -> None:
    contacts = item_contacts(body(box(0.1, 0.06, 0.04), (0.1, 0.1, 0.0)), [], BOX, index=1)
    assert np.all(contacts.first == 0)
    assert contacts.normals == pytest.approx(np.tile(UP, (len(contacts), 1)))
    assert level_area(contacts.points) == pytest.approx(0.1 * 0.06, rel=1e-5)
    kept = thin(contacts)
    assert len(kept) == 4
    assert sorted(map(tuple, np.round(kept.points, 6))) == [
        (0.1, 0.1, 0.0), (0.1, 0.16, 0.0), (0.2, 0.1, 0.0), (0.2, 0.16, 0.0)
    ]  # fmt: skip


@pytest.mark.parametrize("gap", [0.0, 0.0005, 0.0014, -0.00002])
@pytest.mark.parametrize(("dx", "dy"), [(0.05, 0.03), (0.0, 0.0), (-0.0333, 0.0111)])
def test_box_on_box_is_held_by_the_intersection(dx: float, dy: float, gap: float) -> None:
    block = box(0.1, 0.06, 0.04)
    lower, upper = body(block, (0.1, 0.1, 0.0)), body(block, (0.1 + dx, 0.1 + dy, 0.04 + gap))
    contacts = item_contacts(upper, [lower], BOX, index=2)
    assert np.all(contacts.first == 1)
    assert contacts.normals == pytest.approx(np.tile(UP, (len(contacts), 1)), abs=1e-9)
    assert contacts.gaps == pytest.approx(gap, abs=1e-7)
    low = np.maximum([0.1, 0.1], [0.1 + dx, 0.1 + dy])
    high = np.minimum([0.2, 0.16], [0.2 + dx, 0.16 + dy])
    assert contacts.points[:, :2].min(axis=0) == pytest.approx(low, abs=1e-6)
    assert contacts.points[:, :2].max(axis=0) == pytest.approx(high, abs=1e-6)
    assert level_area(contacts.points) == pytest.approx(float(np.prod(high - low)), rel=1e-4)


def test_boxes_beyond_the_threshold_do_not_touch() -> None:
    block = box(0.1, 0.06, 0.04)
    lower = body(block, (0.1, 0.1, 0.0))
    assert len(item_contacts(body(block, (0.1, 0.1, 0.0416)), [lower], BOX, index=2)) == 0
    # Beside and above: edges are 0.7 mm apart, but no face is over a face.
    beside = body(block, (0.2005, 0.1, 0.0405))
    assert len(item_contacts(beside, [lower], BOX, index=2)) == 0


def test_ball_on_floor_touches_under_its_centre() -> None:
    radius = 0.03
    contacts = item_contacts(body(ball(radius, subdivisions=4), (0.15, 0.15, radius)), [], BOX, index=1)
    assert len(contacts)
    reach = np.sqrt(radius**2 - (radius - THRESHOLD) ** 2)
    away = np.linalg.norm(contacts.points[:, :2] - 0.15, axis=1)
    assert away.min() < 0.001
    assert 0.9 * reach < away.max() < 1.02 * reach
    assert np.linalg.norm(contacts.points[:, :2].mean(axis=0) - 0.15) < 0.0005


def test_ball_on_ball_pushes_along_the_centre_line() -> None:
    radius, item = 0.03, ball(0.03, subdivisions=4)
    line = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
    lower = body(item, (0.15, 0.15, 0.1))
    upper = body(item, tuple(lower.position + line * (2 * radius + 0.0003)))
    contacts = item_contacts(upper, [lower], BOX, index=2)
    assert np.all(contacts.normals @ line > 0.95)
    mean = contacts.normals.mean(axis=0)
    assert mean @ line / np.linalg.norm(mean) > 0.999
    middle = lower.position + line * radius
    assert np.linalg.norm(contacts.points.mean(axis=0) - middle) < 0.001


def test_lying_cylinder_in_a_corner_touches_floor_and_walls_along_lines() -> None:
    radius, length = 0.03, 0.1
    lying = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    contacts = item_contacts(
        body(cylinder(radius, length), (length / 2, radius, radius), lying), [], BOX, index=1
    )
    half = np.sqrt(radius**2 - (radius - THRESHOLD) ** 2)
    for axis, along in ((2, 0), (1, 0)):
        of_plane = contacts.normals[:, axis] > 0.5
        points = contacts.points[of_plane]
        assert np.ptp(points[:, along]) == pytest.approx(length, abs=1e-6)
        across = points[:, 3 - axis - along] - radius
        assert np.abs(across).max() < half + 1e-3
    end = contacts.points[contacts.normals[:, 0] > 0.5]
    assert float(ConvexHull(end[:, 1:]).volume) == pytest.approx(np.pi * radius**2, rel=0.01)


def test_box_on_an_edge_and_on_a_corner_touch_there() -> None:
    cube = box(0.05, 0.05, 0.05)
    on_edge = turn(0, np.pi / 4)
    contacts = item_contacts(body(cube, (0.1, 0.15, 0.0), on_edge), [], BOX, index=1)
    lowest = contacts.points[contacts.gaps < 1e-6]
    assert lowest[:, 0].min() == pytest.approx(0.1, abs=1e-6)
    assert lowest[:, 0].max() == pytest.approx(0.15, abs=1e-6)
    on_corner = turn(1, np.arctan(np.sqrt(0.5))) @ turn(0, np.pi / 4)
    lift = -float((cube.vertices @ on_corner.T)[:, 2].min())
    contacts = item_contacts(body(cube, (0.15, 0.15, lift), on_corner), [], BOX, index=1)
    assert contacts.gaps.min() == pytest.approx(0.0, abs=1e-6)
    assert np.all(np.ptp(contacts.points, axis=0) < 0.005)


def test_crossing_edges_touch_with_the_normal_of_both() -> None:
    bar = box(0.1, 0.03, 0.03)
    ridge = turn(0, np.pi / 4)
    top = 0.03 * np.sqrt(2)
    lower = body(bar, (0.1, 0.1, 0.0), ridge)
    upper = body(bar, (0.15, 0.05, top + 0.0003), turn(2, np.pi / 2) @ ridge)
    contacts = item_contacts(upper, [lower], BOX, index=2)
    assert len(contacts)
    assert contacts.normals == pytest.approx(np.tile(UP, (len(contacts), 1)), abs=1e-6)
    assert contacts.points[:, :2] == pytest.approx(np.tile([0.15, 0.1], (len(contacts), 1)), abs=1e-6)
    assert contacts.gaps == pytest.approx(0.0003, abs=1e-6)


def test_nested_cups_touch_at_the_bottom_and_all_around() -> None:
    item = cup(0.05, 0.08, wall=0.003)
    # The inner cup stands on the outer one's floor plus a gap; walls are parallel and 3 mm thick.
    outer = body(item, (0.15, 0.15, 0.0))
    slope = 0.05 * 0.2 / 0.08
    lift = 0.003 * np.sqrt(1.0) / slope + 0.001
    inner = body(item, (0.15, 0.15, float(lift)))
    contacts = item_contacts(inner, [outer], BOX, index=2)
    assert len(contacts) > 100
    away = contacts.points[:, :2] - 0.15
    around = np.arctan2(away[:, 1], away[:, 0])
    assert np.diff(np.sort(around)).max() < np.radians(10)
    # Normals push the inner cup inwards and up.
    inwards = -np.einsum("ij,ij->i", contacts.normals[:, :2], away / np.linalg.norm(away, axis=1)[:, None])
    walls = np.abs(contacts.normals[:, 2]) < 0.5
    assert walls.sum() > 100
    assert np.all(inwards[walls] > 0.9)
    assert np.all(contacts.normals[walls, 2] > 0.0)


def test_thin_wall_is_touched_on_its_own_side() -> None:
    plate = box(0.1, 0.001, 0.1)
    block = box(0.05, 0.05, 0.05)
    standing = body(plate, (0.1, 0.15, 0.0))
    for y, sign in ((0.1513, 1.0), (0.0997, -1.0)):
        contacts = between(item_contacts(body(block, (0.12, y, 0.0)), [standing], BOX, index=2), 1)
        assert len(contacts) > 100
        assert contacts.normals[:, 1] == pytest.approx(sign, abs=1e-6)
        assert contacts.gaps == pytest.approx(0.0003, abs=1e-6)


def test_items_over_the_rim_touch_no_wall() -> None:
    block = box(0.05, 0.05, 0.05)
    contacts = item_contacts(body(block, (0.0, 0.1, 0.28)), [], BOX, index=1)
    assert contacts.points[:, 2].max() <= BOX.height


# Thinning


def test_thinning_keeps_hulls(pile: list[Body]) -> None:
    contacts = pile_contacts(pile, BOX)
    kept = thin(contacts)
    assert len(kept) < 0.5 * len(contacts)
    originals = {tuple(p) for p in contacts.points}
    assert all(tuple(p) in originals for p in kept.points)
    floor, thinned = between(contacts, 0), between(kept, 0)
    for number in set(floor.second):
        for plane in np.unique(floor.normals, axis=0):
            one, two = (c.points[(c.second == number) & (c.normals @ plane > 0.99)] for c in (floor, thinned))
            if len(one) < 3:
                continue
            for angle in np.arange(0, 6.28, 0.1):
                side = np.cross(plane, [0.577, 0.577, 0.577])
                side /= np.linalg.norm(side)
                direction = np.cos(angle) * side + np.sin(angle) * np.cross(plane, side)
                assert (two @ direction).max() > (one @ direction).max() - HULL - 1e-9


def test_thinning_moves_with_the_scene_and_twice_is_once() -> None:
    block = box(0.1, 0.06, 0.04)
    contacts = item_contacts(body(block, (0.15, 0.13, 0.0405)), [body(block, (0.1, 0.1, 0.0))], BOX, index=2)
    kept = thin(contacts)
    rotation = turn(0, 0.4) @ turn(2, 1.1)
    moved = Contacts(
        contacts.points @ rotation.T + 1.0, contacts.normals @ rotation.T, contacts.first, contacts.second,
        contacts.gaps,
    )  # fmt: skip
    assert thin(moved).points == pytest.approx(kept.points @ rotation.T + 1.0)
    assert np.array_equal(thin(kept).points, kept.points)
    assert len(thin(no_contacts())) == 0


def test_thinning_keeps_pairs_and_normals_apart() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0]]) * 0.1
    points = np.concatenate([square, square, square])
    normals = np.concatenate([np.tile(UP, (10, 1)), np.tile([0.0, 0.6, 0.8], (5, 1))])
    second = np.repeat([1, 2, 2], 5)
    contacts = Contacts(points, normals, np.zeros(15, np.int64), second, np.zeros(15))
    kept = thin(contacts)
    # The slanted ones are not in one plane, so each row of equal height is a patch of its own.
    flat = kept.normals[:, 2] > 0.9
    assert np.bincount(kept.second[flat]).tolist() == [0, 4, 4]
    assert set(kept.second[~flat]) == {2}


# The paper's rule


def test_paper_rule_finds_a_box_on_floor_and_on_a_box() -> None:
    block = box(0.1, 0.06, 0.04)
    lower, upper = body(block, (0.1, 0.1, 0.0)), body(block, (0.113, 0.107, 0.04))
    floor = paper_contacts(lower, [], BOX, index=1)
    assert len(floor) == 4
    assert floor.normals == pytest.approx(np.tile(UP, (4, 1)))
    # Corners of the enlarged box, not of the box.
    assert level_area(floor.points) == pytest.approx(0.1 * 0.06 * 1.03**2, rel=1e-6)
    stacked = paper_contacts(upper, [lower], BOX, index=2)
    assert len(stacked)
    assert set(stacked.first) == {1}
    assert np.linalg.norm(stacked.normals, axis=1) == pytest.approx(1.0)
    assert np.all(np.abs(stacked.points[:, 2] - 0.04) < 0.003)


def test_paper_rule_depends_on_size_and_ours_does_not() -> None:
    gap = 0.001
    for size, expected in ((0.03, 0), (0.12, 1)):
        block = box(size, size, size)
        lower, upper = body(block, (0.1, 0.1, 0.0)), body(block, (0.1, 0.1, size + gap))
        assert (len(paper_contacts(upper, [lower], BOX, index=2)) > 0) == bool(expected)
        assert len(item_contacts(upper, [lower], BOX, index=2)) > 0
