"""Whether gravity presses an item to where it stands: laws, closed forms, and an independent reference.

An item *stands* here as the planner's rules ask it: the pile is balanced and each item settles in turn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.settling_reference import reference_motion
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.margins import MarginRule, measure_margin
from packenv.planning.stability.settling import (
    SETTLED,
    STIFFNESS,
    contact_rows,
    settled_tilt,
    settles,
    settles_with,
)
from packenv.planning.stability.settling_kernels import settle
from tests.planning.stability import piles
from tests.planning.stability.piles import Pile, pile

CHECKER = StabilityChecker()


def balanced(p: Pile, mu: float = 0.7) -> bool:
    """The paper's check."""
    return StabilityChecker(mu=mu).check(*p.args).stable


def stands(p: Pile, mu: float = 0.7) -> bool:
    """Balanced, and each item settles on what came before it."""
    checker = StabilityChecker(mu=mu)
    for new in range(1, len(p.masses) + 1):
        there = p.contacts.take(np.maximum(p.contacts.first, p.contacts.second) <= new)
        if not settles(checker, there, p.coms[new - 1], new):
            return False
    return checker.check(*p.args).stable


# Laws ----------------------------------------------------------------------------------------------------


def held(rng: np.random.Generator) -> Pile:
    """One item touched from below and from all sides, by faces of any slant."""
    return piles.rubble(rng, 1, int(rng.integers(4, 10)), float(rng.uniform(0.3, 3.0)))


def test_more_friction_never_makes_an_item_fall():
    rng = np.random.default_rng(1)
    changes = 0
    for _ in range(150):
        p = held(rng)
        verdicts = [stands(p, mu) for mu in np.sort(rng.uniform(0.0, 2.0, 6))]
        assert verdicts == sorted(verdicts)
        changes += verdicts[0] != verdicts[-1]
    assert changes >= 30


def test_more_friction_never_makes_a_pile_fall():
    rng = np.random.default_rng(2)
    changes = 0
    for _ in range(60):
        p = piles.rubble(rng, int(rng.integers(2, 6)), 6, float(rng.uniform(0.1, 1.0)))
        verdicts = [stands(p, mu) for mu in (0.0, 0.23, 0.5, 0.7, 1.31)]
        assert verdicts == sorted(verdicts)
        changes += verdicts[0] != verdicts[-1]
    assert changes >= 10


def test_settling_only_takes_away_and_never_from_level_stacks():
    """What is not balanced does not stand; boxes on level boxes press each other, so nothing is taken."""
    rng = np.random.default_rng(3)
    taken = 0
    for _ in range(80):
        p = held(rng)
        assert balanced(p) or not stands(p)
        taken += balanced(p) and not stands(p)
    assert taken >= 3
    standing = 0
    for _ in range(60):
        p = piles.stack_of_boxes(rng, int(rng.integers(1, 6)), 0.06)
        if sequence_balanced(p):
            standing += 1
            assert stands(p)
    assert standing >= 10


def sequence_balanced(p: Pile) -> bool:
    """The paper's check of every intermediate pile, with half a millimetre to spare at every edge."""
    for new in range(1, len(p.masses) + 1):
        there = p.contacts.take(p.contacts.second <= new)
        inner = replace(there, points=there.points + 0.02 * (p.coms[there.second - 1] - there.points))
        if not CHECKER.check(inner, p.masses[:new], p.coms[:new]).stable:
            return False
    return True


def test_moving_and_turning_an_item_with_gravity_changes_nothing():
    rng = np.random.default_rng(4)
    for i in range(60):
        p = held(rng)
        turn = Rotation.random(random_state=i).as_matrix()
        q = piles.turned(p, turn, (0.3, -0.2, 0.5))
        checker = replace(CHECKER, gravity=tuple(q.gravity))
        assert settles(CHECKER, p.contacts, p.coms[0], 1) == settles(checker, q.contacts, q.coms[0], 1)


def test_contacts_of_other_items_do_not_matter():
    rng = np.random.default_rng(5)
    for _ in range(30):
        p = piles.rubble(rng, 3, 6, 0.6)
        own = p.contacts.take((p.contacts.first == 3) | (p.contacts.second == 3))
        assert settles(CHECKER, p.contacts, p.coms[2], 3) == settles(CHECKER, own, p.coms[2], 3)


def test_an_item_without_contacts_falls():
    p = piles.box_on_floor()
    assert not settles(CHECKER, p.contacts.take(np.zeros(0, dtype=np.int64)), p.coms[0], 1)


# Closed forms --------------------------------------------------------------------------------------------


def between(half_angle_deg: float, com: float = 0.0, height: float = 0.06) -> Pile:
    """A block of 10 cm between two faces; they open upwards by twice the angle, downwards where negative."""
    a = np.radians(half_angle_deg)
    points, normals = [], []
    for side in (-1.0, 1.0):
        for y in (-0.03, 0.03):
            for z in (-height / 2, height / 2):
                points.append([side * (0.05 + z * np.tan(a)), y, 0.1 + z])
                normals.append([-side * np.cos(a), 0.0, np.sin(a)])
    return pile(points, normals, [0] * 8, [1] * 8, [0.3], [[com, 0.0, 0.1]])


@pytest.mark.parametrize("mu", [0.3, 0.7, 2.0, 10.0])
@pytest.mark.parametrize("com", [0.0, 0.03])
@pytest.mark.parametrize("height", [0.02, 0.1])
def test_a_block_between_two_facing_walls_falls_at_any_friction(mu, com, height):
    """The paper's check holds it from μ = h / w on or earlier, for the walls press it as hard as one likes."""
    p = between(0.0, com, height)
    assert not stands(p, mu)
    if mu >= 2.0:
        assert balanced(p, mu)


@pytest.mark.parametrize("angle", [5.0, 15.0, 30.0])
def test_a_block_under_faces_that_lean_over_it_falls_though_it_is_self_locking(angle):
    p = between(-angle)
    mu = np.tan(np.radians(angle)) + 0.05
    assert balanced(p, mu)
    assert not stands(p, mu)


@pytest.mark.parametrize("mu", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("angle", [15.0, 30.0, 60.0])
def test_a_block_in_a_vee_stands_at_any_friction(mu, angle):
    """Its own weight presses it: W / (2 sin angle) on each face."""
    assert stands(between(angle), mu)


def test_a_smooth_wedge_slips_where_only_many_weights_would_hold_it():
    """Two equal faces give way by F / (4 K) each; the wedge sinks by that over the sine: W / (8 K sin²) in all."""
    for angle in (1.0, 2.0, 4.0, 20.0):
        sunk = 1.0 / (8.0 * STIFFNESS * np.sin(np.radians(angle)) ** 2)
        sunk /= 1.0 + sunk  # that it falls freely by as it gives way
        p = between(angle)
        rows = contact_rows(p.contacts, p.coms[0], 1)
        motion = np.empty(6)
        settle(rows, np.array([0.0, 0, -1, 0, 0, 0]), np.zeros(len(rows)), STIFFNESS, 0.3, 1e-7, 200, motion)
        assert -motion[2] == pytest.approx(sunk, rel=1e-6)
        assert settles(StabilityChecker(mu=0.0), p.contacts, p.coms[0], 1) == (sunk <= SETTLED)


@pytest.mark.parametrize("yaw", [0.0, 33.0])
@pytest.mark.parametrize("slope", [10.0, 20.0, 34.0, 34.9, 35.1, 36.0])
def test_a_block_on_a_slope_stands_where_friction_exceeds_its_tangent(slope, yaw):
    assert stands(piles.on_ramp(slope, yaw)) == (np.tan(np.radians(slope)) < 0.7)


@pytest.mark.parametrize("fraction", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("angle", [40.0, 55.0, 70.0])
def test_a_ladder_stands_from_the_friction_of_its_closed_form_on(angle, fraction):
    p = piles.plank(angle, fraction)
    needed = piles.plank_needs(angle, fraction)
    assert stands(p, needed + 0.005)
    assert not stands(p, needed - 0.005)


@pytest.mark.parametrize("sides", [1.0, 1e-3])
def test_an_arch_stands_from_the_friction_of_its_closed_form_on(sides):
    """With its own weight, and where the key alone has any: then its thrust runs through the springers."""
    p = piles.arch(0.001)
    p = replace(p, masses=np.array([sides, 1.0, sides]))
    checker = StabilityChecker(mu=2.0)
    needed = measure_margin(checker, *p.args, with_mu=True).mu
    assert needed is not None
    if sides == 1.0:
        assert needed == pytest.approx(piles.arch_needs(), abs=0.01)
    order = key_last(p)
    for mu in (needed + 0.01, needed - 0.01):
        assert balanced(order, mu) == (mu > needed)
    # On both springers' stones the key is pressed by its weight alone.
    assert settles(StabilityChecker(mu=needed + 0.01), order.contacts, order.coms[2], 3)


def key_last(p: Pile) -> Pile:
    """The arch with its key (item 2) as the last to come."""
    new = np.array([0, 1, 3, 2])
    c = p.contacts
    order = [0, 2, 1]
    return replace(
        p,
        contacts=replace(c, first=new[c.first], second=new[c.second]),
        masses=p.masses[order],
        coms=p.coms[order],
    )


def leaning_plates(weight: float) -> Pile:
    """Two plates against each other at 60°, the second one put down last; ``weight`` of the second."""
    a = np.radians(60.0)
    points, normals, first, second = [], [], [], []
    for item, side in ((1, -1.0), (2, 1.0)):
        for y in (-0.03, 0.03):
            points.append([side * 0.2 * np.cos(a), y, 0.0])
            normals.append([0.0, 0.0, 1.0])
            first.append(0)
            second.append(item)
    for y in (-0.03, 0.03):
        points.append([0.0, y, 0.2 * np.sin(a)])
        normals.append([1.0, 0.0, 0.0])
        first.append(1)
        second.append(2)
    coms = [[side * 0.1 * np.cos(a), 0.0, 0.1 * np.sin(a)] for side in (-1.0, 1.0)]
    return pile(points, normals, first, second, [1.0, weight], coms)


def test_of_two_leaning_plates_the_second_is_carried_and_the_first_would_have_fallen():
    """Feet need cot(60°) / 2 of friction; the pile stands, but no one can put the plates there one by one."""
    p = leaning_plates(1.0)
    needed = 1.0 / (2.0 * np.tan(np.radians(60.0)))
    assert balanced(p, needed + 0.01)
    assert not balanced(p, needed - 0.01)
    assert settles(StabilityChecker(mu=needed + 0.05), p.contacts, p.coms[1], 2)
    assert not stands(p)


def test_a_bridge_stands_and_its_keystone_is_carried_only_by_what_fell_before():
    deck = pile(
        [[x, y, 0.1] for x in (-0.1, 0.1) for y in (-0.02, 0.02)],
        [[0, 0, 1]] * 4,
        [1, 1, 2, 2],
        [3] * 4,
        [1.0, 1.0, 0.5],
        [[-0.1, 0, 0.05], [0.1, 0, 0.05], [0, 0, 0.11]],
    )
    piers = [piles.rectangle(x - 0.03, x + 0.03, -0.03, 0.03, 0.0) for x in (-0.1, 0.1)]
    feet = pile(np.concatenate(piers), [[0, 0, 1]] * 8, [0] * 8, [1] * 4 + [2] * 4, [1.0] * 2, deck.coms[:2])
    names = ("points", "normals", "first", "second", "gaps")
    contacts = type(deck.contacts)(
        *(np.concatenate([getattr(feet.contacts, n), getattr(deck.contacts, n)]) for n in names)
    )
    assert stands(replace(deck, contacts=contacts))
    keyed = piles.bridge(True)
    assert balanced(keyed)
    assert not stands(keyed)


def test_balls_stand_on_the_floor_and_in_a_corner_and_not_between_leaning_faces():
    assert stands(piles.ball_on_floor())
    assert stands(piles.ball_in_corner())
    assert not stands(between(-20.0))


# Margins --------------------------------------------------------------------------------------------------


def test_the_tilt_of_what_hangs_is_none_and_of_what_stands_that_of_balance():
    hanging = between(0.0)
    margin = measure_margin(CHECKER, *hanging.args)
    assert margin.tilt_deg > 10.0
    assert settled_tilt(CHECKER, hanging.contacts, hanging.coms[0], 1, margin) == 0.0
    for height, mu in ((0.05, 0.7), (0.12, 0.7), (0.3, 0.7), (0.12, 0.2)):
        checker = StabilityChecker(mu=mu)
        box = piles.box_on_floor(com=(0.05, 0.05, height))
        margin = measure_margin(checker, *box.args)
        assert settled_tilt(checker, box.contacts, box.coms[0], 1, margin) == margin.tilt_deg


def test_the_tilt_is_at_most_that_of_balance_and_none_where_balance_fails():
    rng = np.random.default_rng(6)
    lower = 0
    for _ in range(40):
        p = held(rng)
        margin = measure_margin(CHECKER, *p.args)
        tilt = settled_tilt(CHECKER, p.contacts, p.coms[0], 1, margin)
        assert 0.0 <= tilt <= margin.tilt_deg
        assert (tilt > 0.0) <= settles(CHECKER, p.contacts, p.coms[0], 1)
        lower += tilt < margin.tilt_deg
    assert lower >= 3


def test_a_margin_asks_for_its_tilts_with_its_friction():
    rule = MarginRule()
    ramp = piles.on_ramp(20.0, 0.0)  # 0.36 of friction
    assert settles_with(CHECKER, ramp.contacts, ramp.coms[0], 1, None)
    assert not settles_with(CHECKER, ramp.contacts, ramp.coms[0], 1, rule)
    box = piles.box_on_floor()
    assert settles_with(CHECKER, box.contacts, box.coms[0], 1, rule)


# An independent reference ---------------------------------------------------------------------------------


def motion_of(p: Pile, mu: float) -> np.ndarray:
    """What the product says is left of the motion, at this coefficient alone."""
    rows = contact_rows(p.contacts, p.coms[0], 1)
    motion = np.empty(6)
    settle(rows, np.array([0.0, 0, -1, 0, 0, 0]), np.full(len(rows), mu), STIFFNESS, 0.3, 1e-4, 200, motion)
    return motion


def rests(motion: np.ndarray) -> bool:
    return bool(np.abs(motion).max() <= SETTLED)


def test_closed_forms_move_as_the_cvxpy_reference_says():
    pytest.importorskip("cvxpy")
    cases = [(between(a), mu) for a, mu in ((0.0, 0.7), (-10.0, 0.7), (10.0, 0.3), (20.0, 0.7))]
    cases += [(piles.on_ramp(s, 20.0), 0.7) for s in (20.0, 33.0, 40.0)]
    cases += [(piles.plank(55.0), 0.25), (piles.plank(55.0), 0.4), (piles.overhang(0.004), 0.7)]
    for p, mu in cases:
        reference = reference_motion(p.contacts, p.coms[0], 1, mu)
        found = motion_of(p, mu)
        assert rests(found) == rests(reference)
        np.testing.assert_allclose(found, reference, atol=2.0 / STIFFNESS)


def test_random_items_rest_where_the_cvxpy_reference_says():
    """Coulomb friction can have several solutions, and the two go there by different ways: 1 in 24 differs."""
    pytest.importorskip("cvxpy")
    rng = np.random.default_rng(7)
    cases = [(held(rng), mu) for _ in range(12) for mu in (0.25, 0.7)]
    pairs = [
        (rests(motion_of(p, mu)), rests(reference_motion(p.contacts, p.coms[0], 1, mu))) for p, mu in cases
    ]
    assert 5 <= sum(theirs for _, theirs in pairs) <= len(pairs) - 5
    assert sum(ours != theirs for ours, theirs in pairs) <= 1
