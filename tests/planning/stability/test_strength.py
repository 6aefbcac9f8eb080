"""What piles withstand: closed forms, laws, and a reference that shares no matrix."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import cvxpy as cp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from packenv.planning.stability import margins
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contacts import join
from packenv.planning.stability.equilibrium import tangents
from packenv.planning.stability.margins import MarginRule, check_margin, measure_margin, tilt_directions
from packenv.planning.stability.strength import Strength, measure_strength
from packenv.types import Contacts
from tests.planning.stability import piles
from tests.planning.stability.piles import Pile

CHECKER = StabilityChecker()


def by_item(p: Pile) -> list[Contacts]:
    """The contacts of each item with what was there before it."""
    newer = np.maximum(p.contacts.first, p.contacts.second)
    return [p.contacts.take(newer == k) for k in range(1, len(p.masses) + 1)]


def strengths(p: Pile, checker: StabilityChecker = CHECKER) -> tuple[Strength, ...]:
    return measure_strength(checker, by_item(p), p.masses, p.coms)


def figures(p: Pile, checker: StabilityChecker = CHECKER) -> np.ndarray:
    return np.array([(s.tilt_deg, s.push) for s in strengths(p, checker)])


def some_piles(seed: int, n: int) -> list[Pile]:
    """Towers and rubble, some of which fall."""
    rng = np.random.default_rng(seed)
    return [
        piles.stack_of_boxes(rng, int(rng.integers(2, 6)), float(rng.uniform(0.02, 0.08)))
        if rng.random() < 0.5
        else piles.rubble(rng, int(rng.integers(1, 5)), int(rng.integers(4, 9)), float(rng.uniform(0.1, 0.6)))
        for _ in range(n)
    ]


# Closed forms --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("width", "height"), [(0.10, 0.04), (0.10, 0.15), (0.10, 0.30), (0.10, 1.0)])
@pytest.mark.parametrize("mu", [0.2, 0.7])
def test_a_block_tips_over_its_edge_or_slides_whichever_is_first(width, height, mu):
    block = piles.box_on_floor(com=(width / 2, width / 2, height / 2), size=width)
    (found,) = strengths(block, StabilityChecker(mu=mu))
    most = min(mu, width / height)
    assert found.tilt_deg == pytest.approx(np.degrees(np.arctan(most)), abs=1e-3)
    assert found.push == pytest.approx(most, abs=1e-5)


def column(n: int, side: float = 0.1) -> Pile:
    """Cubes one on the other, exactly."""
    points = np.concatenate([piles.rectangle(0.0, side, 0.0, side, k * side) for k in range(n)])
    first = np.repeat(np.arange(n), 4)
    coms = [[side / 2, side / 2, (k + 0.5) * side] for k in range(n)]
    return piles.pile(points, np.tile([0.0, 0.0, 1.0], (4 * n, 1)), first, first + 1, np.ones(n), coms)


def test_a_column_of_cubes_tips_as_one_block_as_high_and_each_cube_slides():
    for n, found in enumerate(strengths(column(5), StabilityChecker(mu=0.4)), start=1):
        assert found.tilt_deg == pytest.approx(np.degrees(np.arctan(min(0.4, 1.0 / n))), abs=1e-3)
        # The top cube slides by μ; or the column tips about the floor's edge: the push has a lever of n - ½
        # sides, the n weights one of half a side.
        assert found.push == pytest.approx(min(0.4, 0.5 * n / (n - 0.5)), abs=1e-5)


def test_what_does_not_stand_withstands_nothing_and_what_stands_firmly_is_capped():
    assert strengths(piles.overhang(0.01))[-1] == Strength(0.0, 0.0)
    (flat,) = strengths(piles.box_on_floor(com=(0.05, 0.05, 0.01)), StabilityChecker(mu=3.0))
    assert flat == Strength(pytest.approx(45.0), 1.0)
    nothing = measure_strength(CHECKER, [], np.empty(0), np.empty((0, 3)))
    assert nothing == ()


def test_an_item_that_nothing_touches_withstands_nothing():
    lone = piles.pile(np.empty((0, 3)), np.ones((0, 3)), [], [], [1.0], [[0.1, 0.1, 0.1]])
    assert strengths(lone) == (Strength(0.0, 0.0),)


# Laws ----------------------------------------------------------------------------------------------------


def test_more_friction_never_lowers_them():
    raised = 0
    for p in some_piles(1, 30):
        rows = [figures(p, StabilityChecker(mu=mu)) for mu in (0.1, 0.3, 0.5, 0.7, 1.2)]
        for less, more in pairwise(rows):
            assert (more >= less - 1e-4).all()
        raised += (rows[-1] > rows[0] + 0.01).any()
    assert raised >= 10


def test_scaling_all_masses_changes_nothing():
    for p in some_piles(2, 15):
        np.testing.assert_allclose(figures(replace(p, masses=37.0 * p.masses)), figures(p), atol=1e-3)


def mirrored(p: Pile) -> Pile:
    """The mirror image along x."""
    over = np.array([-1.0, 1.0, 1.0])
    contacts = replace(p.contacts, points=p.contacts.points * over, normals=p.contacts.normals * over)
    return replace(p, contacts=contacts, coms=p.coms * over)


def test_a_mirrored_or_turned_pile_has_the_same():
    turn = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    differing = 0
    for p in some_piles(3, 20):
        found = figures(p)
        np.testing.assert_allclose(figures(mirrored(p)), found, atol=1e-3)
        np.testing.assert_allclose(figures(piles.turned(p, turn, (0.2, -0.1, 0.0))), found, atol=1e-3)
        differing += found[-1, 0] > 0.0
    assert differing >= 5


def test_a_pile_withstands_no_more_than_any_of_its_items_with_all_others_held():
    asked = 0
    for p in some_piles(4, 30):
        tilt = strengths(p)[-1].tilt_deg
        for body in range(1, len(p.masses) + 1):
            assert tilt <= measure_margin(CHECKER, *p.args, free=[body]).tilt_deg + 1e-3
        asked += tilt > 0.0
    assert asked >= 10


def test_every_step_is_the_margin_of_its_pile_as_it_is():
    """Found group by group, as they are joined, or all at once."""
    for p in [*some_piles(5, 12), beside(column(3), column(2)), beside(*some_piles(6, 2))]:
        for n, found in enumerate(strengths(p), start=1):
            part = join(by_item(p)[:n])
            whole = measure_margin(CHECKER, part, p.masses[:n], p.coms[:n])
            assert found.tilt_deg == pytest.approx(whole.tilt_deg, abs=1e-3)


def beside(a: Pile, b: Pile) -> Pile:
    """Two piles in turn, a metre apart."""
    n, m = len(a.masses), len(b.masses)
    # Odd numbers for one, even ones for the other, as long as there are both.
    order = np.argsort(np.concatenate([np.arange(n), np.arange(m) + 0.5]), kind="stable")
    number = np.zeros(n + m + 1, dtype=np.int64)
    number[1 + order] = np.arange(1, n + m + 1)
    shift = np.array([1.0, 0.0, 0.0])
    contacts = join(
        [
            a.contacts,
            replace(
                b.contacts,
                points=b.contacts.points + shift,
                first=np.where(b.contacts.first > 0, b.contacts.first + n, 0),
                second=np.where(b.contacts.second > 0, b.contacts.second + n, 0),
            ),
        ]
    )
    contacts = replace(contacts, first=number[contacts.first], second=number[contacts.second])
    masses = np.concatenate([a.masses, b.masses])[order]
    return Pile(contacts, masses, np.concatenate([a.coms, b.coms + shift])[order], a.gravity)


def test_piles_apart_tilt_as_the_weaker_one_does_and_push_as_the_newer_one_alone():
    a, b = figures(column(4)), figures(column(2))
    found = figures(beside(column(4), column(2)))  # a1 b1 a2 b2 a3 a4
    np.testing.assert_allclose(found[:, 1], [a[0, 1], b[0, 1], a[1, 1], b[1, 1], a[2, 1], a[3, 1]], atol=1e-4)
    weaker = np.minimum(a[[0, 0, 1, 1, 2, 3], 0], b[[0, 0, 0, 1, 1, 1], 0])
    np.testing.assert_allclose(found[:, 0], weaker, atol=1e-3)


def test_no_push_where_a_pile_apart_falls():
    falling = piles.overhang(0.01)
    both = beside(falling, column(3))
    first = int(np.flatnonzero(figures(both)[:, 0] == 0.0)[0])
    assert (figures(both)[first:] == 0.0).all()
    assert first < len(both.masses) - 1


def test_what_keeps_the_margin_rule_withstands_its_tilt():
    kept = 0
    for p in some_piles(7, 40):
        if check_margin(CHECKER, *p.args, MarginRule(8.0, 0.25))[-1].stable:
            assert strengths(p)[-1].tilt_deg >= 8.0 - 1e-3
            kept += 1
    assert kept >= 5


# The reference -------------------------------------------------------------------------------------------


def reference(p: Pile, loaded: list[int], mu: float) -> float:
    """The largest load in the worst direction, by CVXPY: forces, their pyramids by faces, and Newton item by item."""
    contacts = p.contacts
    up = np.array([0.0, 0.0, 1.0])
    a, b = tangents(contacts.normals, up)
    force = cp.Variable((len(contacts), 3))
    share = cp.Variable(nonneg=True)
    push = cp.sum(cp.multiply(force, contacts.normals), axis=1)
    along, across = (cp.sum(cp.multiply(force, t), axis=1) for t in (a, b))
    faces = 2.0 * np.pi * (np.arange(8) + 0.5) / 8
    cone = [
        along * np.cos(face) + across * np.sin(face) <= mu * np.cos(np.pi / 8) * push for face in faces
    ] + [push >= 0]
    direction = cp.Parameter(3)
    rules = list(cone)
    for k, (mass, com) in enumerate(zip(p.masses, p.coms, strict=True), start=1):
        sign = (contacts.second == k).astype(float) - (contacts.first == k)
        weight = 9.81 * mass
        pulled = share * direction if k in loaded else np.zeros(3)
        rules.append(sign @ force / weight + pulled == up)
        arms = contacts.points - com
        torque = [
            sign @ (cp.multiply(arms[:, i], force[:, j]) - cp.multiply(arms[:, j], force[:, i]))
            for i, j in ((1, 2), (2, 0), (0, 1))
        ]
        rules += [part / (weight * 0.1) == 0.0 for part in torque]
    problem = cp.Problem(cp.Maximize(share), [*rules, share <= 1.0])
    least = 1.0
    for way in tilt_directions():
        direction.value = way
        problem.solve(solver="CLARABEL")
        least = min(least, 0.0 if share.value is None else float(share.value))
    return least


def test_both_agree_with_a_reference_of_its_own_on_random_piles():
    standing = 0
    for p in some_piles(8, 14):
        n = len(p.masses)
        found = strengths(p)[-1]
        tilt = reference(p, list(range(1, n + 1)), CHECKER.mu)
        push = reference(p, [n], CHECKER.mu)
        assert np.tan(np.radians(found.tilt_deg)) == pytest.approx(tilt, abs=2e-3)
        assert found.push == pytest.approx(push, abs=2e-3)
        standing += tilt > 0.0
    assert standing >= 6


def test_where_the_program_fails_the_pile_is_asked_again_and_again(monkeypatch):
    tower = column(2)
    expected = figures(tower)
    monkeypatch.setattr(margins, "_ROUNDS", 0)
    np.testing.assert_allclose(figures(tower), expected, atol=0.01)
