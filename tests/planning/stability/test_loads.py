"""What rests on an item: by masses in a tower, by the linear programme on a plank, and never more than it bears."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from packenv.geometry.distance_grids import SurfaceField
from packenv.limits import ItemLimits
from packenv.planning.search.measured import Resting
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contact_finder import contact_finder
from packenv.planning.stability.contacts import Body, join
from packenv.planning.stability.loads import (
    Balanced,
    LoadLimits,
    Loads,
    largest_load,
    loads_borne,
    may_bear,
    resting_on,
    with_supports,
)
from packenv.types import Container, Item
from tests.planning.stability import piles
from tests.shapes import box

BOX = Container(0.5, 0.3, 0.4)
FIND = contact_finder("surface", 0.7, tight=False)


def limited(item: Item, kg: float) -> Item:
    """The item, with what may rest on it."""
    return replace(item, limits=ItemLimits(max_load_kg=kg))


def weighing(item: Item, kg: float) -> Item:
    """The item, of another mass."""
    return replace(item, mass=kg, inertia=item.inertia * kg / item.mass)


def laid(item: Item, x: float, z: float, y: float = 0.1) -> Resting:
    """The item, unturned, with its smallest corner there."""
    return Resting(item, np.eye(3), np.array([x, y, z]))


def pile_of(items: Sequence[Resting]) -> tuple[tuple[frozenset[int], ...], Balanced]:
    """Who rests on whom, and the pile for the linear programme, from the meshes."""
    bodies = [Body(SurfaceField.of_item(p.item), p.rotation, p.position) for p in items]
    rests_on: tuple[frozenset[int], ...] = ()
    contacts = []
    for new in range(1, len(items) + 1):
        own = FIND(bodies[new - 1], bodies[: new - 1], BOX, new)
        contacts.append(own)
        rests_on = with_supports(rests_on, own, new)
    masses = np.array([p.item.mass for p in items])
    coms = np.array([p.rotation @ p.item.com + p.position for p in items])
    return rests_on, Balanced(StabilityChecker(), join(contacts), masses, coms)


def test_in_a_tower_everything_above_counts() -> None:
    masses = (0.4, 0.3, 0.2, 0.1)
    tower = [
        laid(limited(weighing(box(0.1, 0.1, 0.05, f"b{k}"), kg), 9.0), 0.1, 0.05 * k)
        for k, kg in enumerate(masses)
    ]
    rests_on, balanced = pile_of(tower)
    above = [sum(masses[k + 1 :]) for k in range(4)]
    borne = loads_borne(tower, rests_on, None)
    assert [borne[k + 1] for k in range(4)] == pytest.approx(above)
    # Nothing else carries: the linear programme can find no other figure.
    for k in range(3):
        over = resting_on(k + 1, rests_on)
        assert largest_load(balanced, k + 1, over) == pytest.approx(above[k], abs=1e-5)
    assert resting_on(1, rests_on) == {2, 3, 4}


def test_what_stands_beside_does_not_count() -> None:
    row = [laid(limited(box(0.1, 0.1, 0.1, f"b{k}"), 0.0), 0.1 * k, 0.0) for k in range(3)]
    rests_on, _ = pile_of(row)
    assert rests_on == (frozenset({0}), frozenset({0}), frozenset({0}))
    assert set(loads_borne(row, rests_on, None).values()) == {0.0}


@pytest.mark.parametrize("com_x", [0.10, 0.15, 0.18])
def test_the_most_on_one_of_two_supports_is_the_lever_rule(com_x: float) -> None:
    """A plank of 0.3 m on blocks of 0.04 m at its ends: moments about the far end of the other block."""
    left, right = box(0.04, 0.1, 0.05, "left"), box(0.04, 0.1, 0.05, "right")
    plank = weighing(box(0.3, 0.1, 0.02, "plank"), 2.0)
    plank = replace(plank, com=np.array([com_x, 0.05, 0.01]))
    items = [laid(limited(left, 9.0), 0.1, 0.0), laid(right, 0.36, 0.0), laid(plank, 0.1, 0.05)]
    rests_on, balanced = pile_of(items)
    points = balanced.contacts.points
    on_left = (balanced.contacts.first == 1) & (balanced.contacts.second == 3)
    on_right = (balanced.contacts.first == 2) & (balanced.contacts.second == 3)
    inner, outer = points[on_left, 0].max() - 0.1, points[on_right, 0].max() - 0.1
    assert (inner, outer) == pytest.approx((0.04, 0.3), abs=0.006)  # contacts are samples of the faces
    most = 2.0 * (outer - com_x) / (outer - inner)
    assert loads_borne(items, rests_on, None)[1] == pytest.approx(2.0)
    assert largest_load(balanced, 1, frozenset({3})) == pytest.approx(most, rel=1e-5)
    for share in (0.5, 0.99, 0.9999, 1.0001, 1.01, 1.5):
        assert may_bear(balanced, 1, frozenset({3}), share * most) is (share < 1.0)
    rule = LoadLimits({}, {}, FIND)
    before = Loads(tuple(items[:2]), rests_on[:2])
    own = FIND(
        Body(SurfaceField.of_item(plank), np.eye(3), items[2].position),
        [Body(SurfaceField.of_item(p.item), p.rotation, p.position) for p in items[:2]],
        BOX,
        3,
    )
    for kg, passes in ((most + 0.01, True), (most - 0.01, False)):
        tried = replace(before, items=(replace(items[0], item=limited(left, kg)), items[1]))
        assert (rule.with_item(tried, items[2], BOX, own, balanced) is not None) is passes


def test_forces_that_only_press_do_not_bound_and_masses_do() -> None:
    """A block between two walls: friction on both may press it down as hard as one likes."""
    wide = weighing(box(0.5, 0.1, 0.05, "wide"), 1.0)
    items = [laid(limited(box(0.1, 0.1, 0.05, "eggs"), 2.0), 0.2, 0.0), laid(wide, 0.0, 0.05)]
    rests_on, balanced = pile_of(items)
    assert largest_load(balanced, 1, frozenset({2})) == np.inf
    assert loads_borne(items, rests_on, balanced)[1] == pytest.approx(1.0)


def test_an_item_that_touches_steep_sides_alone_rests_on_all_of_them() -> None:
    a = piles.pile([[0, 0, 0], [0.1, 0, 0]], [[1, 0, 0.02], [-1, 0, 0.02]], [1, 2], [3, 3], [1], [[0, 0, 0]])
    assert with_supports((frozenset(), frozenset()), a.contacts, 3)[2] == {1, 2}


def test_what_comes_from_beneath_carries_what_was_there() -> None:
    """A drawer pushed under a shelf: the shelf rests on it, too, and on it all that the shelf bears."""
    under = piles.pile([[0, 0, 0]], [[0, 0, -1]], [1], [3], [1], [[0, 0, 0]])
    found = with_supports((frozenset(), frozenset({1})), under.contacts, 3)
    assert found == (frozenset({3}), frozenset({1}), frozenset({1}))
    assert resting_on(3, found) == {1, 2}


def test_looking_late_finds_what_looking_early_finds() -> None:
    """Contacts are looked for from the first limited item on: the sequence of limits is no matter."""
    shapes = {f"b{k}": box(0.1, 0.1, 0.05, f"b{k}") for k in range(4)}
    fields = {name: SurfaceField.of_item(item) for name, item in shapes.items()}
    for which in range(4):
        items = dict(shapes, **{f"b{which}": limited(shapes[f"b{which}"], 9.0)})
        rule, loads = LoadLimits(items, fields, FIND), Loads()
        for k in range(4):
            after = rule.with_item(loads, laid(items[f"b{k}"], 0.1, 0.05 * k), BOX)
            assert after is not None
            loads = after
        assert loads.rests_on == (frozenset({0}), frozenset({1}), frozenset({2}), frozenset({3}))
        assert loads_borne(loads.items, loads.rests_on or (), None) == {
            which + 1: pytest.approx(sum(items[f"b{k}"].mass for k in range(which + 1, 4)))
        }
