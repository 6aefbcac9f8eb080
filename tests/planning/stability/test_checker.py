"""The stability checker: laws, closed forms, and that its shortcuts answer as the whole pile does."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.equilibrium import TOLERANCE, build_equilibrium, residuals
from packenv.planning.stability.margins import measure_margin, tilt_directions
from packenv.planning.stability.solvers import solve_cvxpy
from packenv.types import Contacts
from tests.planning.stability import piles
from tests.planning.stability.piles import Pile

CHECKER = StabilityChecker()


def stands(p: Pile, mu: float = 0.7, sides: int = 8) -> bool:
    return StabilityChecker(mu=mu, sides=sides, gravity=tuple(p.gravity)).check(*p.args).stable


def some_piles(seed: int, n: int) -> list[Pile]:
    rng = np.random.default_rng(seed)
    return [piles.random_pile(rng) for _ in range(n)]


def joined(a: Contacts, b: Contacts) -> Contacts:
    names = ("points", "normals", "first", "second", "gaps")
    return Contacts(*(np.concatenate([getattr(a, name), getattr(b, name)]) for name in names))


# Laws ----------------------------------------------------------------------------------------------------


def test_more_friction_never_makes_a_pile_fall():
    changes = 0
    for p in some_piles(1, 60):
        verdicts = [stands(p, mu) for mu in (0.0, 0.2, 0.5, 1.0, 2.0)]
        assert verdicts == sorted(verdicts)
        changes += verdicts[0] != verdicts[-1]
    assert changes >= 10


def test_more_contacts_never_make_a_pile_fall():
    rng = np.random.default_rng(2)
    changes = 0
    for p in some_piles(2, 80):
        order = rng.permutation(len(p.contacts))
        verdicts = [
            stands(replace(p, contacts=p.contacts.take(np.sort(order[:k]))))
            for k in (len(order) // 3, 2 * len(order) // 3, len(order))
        ]
        assert verdicts == sorted(verdicts)
        changes += verdicts[0] != verdicts[-1]
    assert changes >= 10


def test_scaling_all_masses_changes_nothing():
    for p in some_piles(3, 60):
        assert (
            stands(p)
            == stands(replace(p, masses=1e-3 * p.masses))
            == stands(replace(p, masses=1e3 * p.masses))
        )


def test_moving_the_pile_changes_nothing():
    for p in some_piles(4, 60):
        assert stands(p) == stands(piles.turned(p, np.eye(3), (0.3, -0.2, 0.5)))


def test_turning_the_pile_about_gravity_changes_nothing():
    """By eighths, which the eight-sided pyramids do not feel."""
    rng = np.random.default_rng(5)
    for _ in range(40):
        p = piles.stack_of_boxes(rng, int(rng.integers(1, 6)), 0.06)
        q = piles.rubble(rng, int(rng.integers(1, 5)), 6, 0.4)
        turn = Rotation.from_euler("z", 45 * int(rng.integers(1, 8)), degrees=True).as_matrix()
        assert stands(p) == stands(piles.turned(p, turn))
        assert stands(q) == stands(piles.turned(q, turn))


def test_turning_pile_and_gravity_changes_nothing_beyond_the_pyramids_yaw():
    """A turned pyramid contains the round cone of μ cos(π / 8) and lies inside that of μ."""
    slack = np.cos(np.pi / 8)
    for i, p in enumerate(some_piles(6, 60)):
        q = piles.turned(p, Rotation.random(random_state=i).as_matrix())
        if stands(p, 0.7 * slack):
            assert stands(q, 0.7)
        if not stands(p, 0.7 / slack):
            assert not stands(q, 0.7)


def test_numbering_of_items_and_sequence_of_contacts_change_nothing():
    rng = np.random.default_rng(7)
    for p in some_piles(7, 40):
        n, k = len(p.masses), len(p.contacts)
        item = rng.permutation(n)  # old item i + 1 becomes item[i] + 1
        rename = np.concatenate([[0], item + 1])
        c = p.contacts.take(rng.permutation(k))
        masses, coms = np.empty(n), np.empty((n, 3))
        masses[item], coms[item] = p.masses, p.coms
        assert stands(p) == stands(
            Pile(replace(c, first=rename[c.first], second=rename[c.second]), masses, coms, p.gravity)
        )


def test_which_body_is_called_first_changes_nothing():
    for p in some_piles(8, 40):
        c = p.contacts
        swap = (c.first > 0) & (np.arange(len(c)) % 2 == 0)
        other = replace(
            c,
            normals=np.where(swap[:, None], -c.normals, c.normals),
            first=np.where(swap, c.second, c.first),
            second=np.where(swap, c.first, c.second),
        )
        assert stands(p) == stands(replace(p, contacts=other))


# Shortcuts -----------------------------------------------------------------------------------------------


def grow(rng: np.random.Generator, tilt=None) -> Counter:
    """Build piles up item by item; what knows the pile before answers as the one that does not."""
    seen: Counter = Counter()
    n = 8
    p = (
        piles.stack_of_boxes(rng, n, float(rng.uniform(0.05, 0.12)), per_edge=3)
        if rng.random() < 0.5
        else piles.rubble(rng, n, 6, 0.3)
    )
    previous, kept = None, []
    for body in range(1, n + 1):
        # Leave out what fell: number the kept bodies and this one anew.
        bodies = [*kept, body]
        c = p.contacts.take(np.isin(p.contacts.second, bodies) & np.isin(p.contacts.first, [0, *bodies]))
        rename = np.zeros(n + 1, dtype=np.int64)
        rename[bodies] = np.arange(1, len(bodies) + 1)
        c = replace(c, first=rename[c.first], second=rename[c.second])
        index = np.array(bodies) - 1
        fast = CHECKER.check(c, p.masses[index], p.coms[index], previous=previous, tilt=tilt)
        slow = CHECKER.check(c, p.masses[index], p.coms[index], tilt=tilt)
        assert fast.stable == slow.stable
        assert fast.stable == (not fast.reason)
        if slow.stable:
            for result in (fast, slow):
                left = residuals(c, result.forces, p.masses[index], p.coms[index])
                left[:, :3] += 0.0 if tilt is None else tilt
                assert np.abs(left).max() <= 1.02 * TOLERANCE
            previous, kept = fast, bodies
        seen[fast.decided_by, fast.stable] += 1
    return seen


def test_shortcuts_answer_as_the_whole_pile_does():
    rng = np.random.default_rng(9)
    seen = sum((grow(rng) for _ in range(40)), Counter())
    assert seen["new-item", False] >= 20
    assert seen["first-order", True] >= 20
    assert seen["pile", True] >= 10
    assert ("new-item", True) not in seen


def test_shortcuts_answer_as_the_whole_pile_does_under_tilt():
    rng = np.random.default_rng(10)
    tilt = 0.1 * tilt_directions()[3]
    seen = sum((grow(rng, tilt) for _ in range(15)), Counter())
    assert seen["first-order", True] >= 5


def agree_on_large_piles(rng: np.random.Generator, n: int) -> Counter:
    """Ask about ``n`` piles of 30 to 60 bodies, as they are and with a heavy last one, and ask the reference, too."""
    seen: Counter = Counter()
    while True:
        p = piles.rubble(rng, 120, 7, float(rng.uniform(0.1, 0.3)), near=3)
        previous, kept = None, []
        for body in range(1, len(p.masses) + 1):
            bodies = [*kept, body]
            c = p.contacts.take(np.isin(p.contacts.second, bodies) & np.isin(p.contacts.first, [0, *bodies]))
            rename = np.zeros(len(p.masses) + 1, dtype=np.int64)
            rename[bodies] = np.arange(1, len(bodies) + 1)
            c = replace(c, first=rename[c.first], second=rename[c.second])
            index = np.array(bodies) - 1
            asked = CHECKER.check(c, p.masses[index], p.coms[index], previous=previous)
            if len(bodies) >= 30:
                heavy = np.where(index == body - 1, 30.0, 1.0) * p.masses[index]
                for masses in (p.masses[index], heavy):
                    result = CHECKER.check(c, masses, p.coms[index], previous=previous)
                    if result.decided_by == "new-item":
                        continue
                    reference = solve_cvxpy(build_equilibrium(c, masses, p.coms[index]))
                    assert reference.status != "undecided"
                    assert result.stable == (reference.status == "stable"), (len(bodies), result.reason)
                    seen[result.decided_by, result.stable] += 1
                    if sum(seen.values()) >= n:
                        return seen
            if asked.stable:
                previous, kept = asked, bodies
            if len(kept) >= 60:
                break
    return seen


def test_rings_answer_as_the_reference_does_of_large_piles():
    seen = agree_on_large_piles(np.random.default_rng(11), 60)
    assert seen["pile", True] + seen["pile", False] >= 2


@pytest.mark.slow
def test_rings_answer_as_the_reference_does_of_hundreds_of_large_piles():
    seen = agree_on_large_piles(np.random.default_rng(12), 400)
    assert seen["pile", True] >= 50
    assert seen["pile", False] >= 5
    assert seen["first-order", False] >= 30


def stacked(n: int = 3) -> Pile:
    """A tower of cubes."""
    points = np.vstack([piles.rectangle(0, 0.1, 0, 0.1, 0.1 * i) for i in range(n)])
    body = np.repeat(np.arange(n), 4)
    return piles.pile(
        points,
        [[0, 0, 1]] * 4 * n,
        body,
        body + 1,
        [1.0] * n,
        [[0.05, 0.05, 0.05 + 0.1 * i] for i in range(n)],
    )


def test_foreign_forces_are_not_believed():
    """A result of another pile, or a wrong one, as ``previous`` never changes the answer."""
    p = stacked()
    old = p.contacts.take(p.contacts.second < 3)
    right = CHECKER.check(old, p.masses[:2], p.coms[:2])
    assert right.stable
    wrong = [
        replace(right, forces=2.0 * right.forces),
        replace(right, forces=-right.forces),
        replace(right, contacts=replace(old, points=old.points + 0.01)),
        CHECKER.check(*piles.ball_in_corner().args),
    ]
    for previous in wrong:
        assert CHECKER.check(*p.args, previous=previous).stable
        falling = replace(p, coms=p.coms + np.array([[0, 0, 0], [0.2, 0, 0], [0, 0, 0]]))
        assert not CHECKER.check(*falling.args, previous=previous).stable


def test_previous_is_found_again_in_another_sequence_of_contacts():
    p = stacked(4)
    old = p.contacts.take(p.contacts.second < 4)
    previous = CHECKER.check(old, p.masses[:3], p.coms[:3])
    mixed = p.contacts.take(np.random.default_rng(0).permutation(len(p.contacts)))
    result = CHECKER.check(mixed, p.masses, p.coms, previous=previous)
    assert result.stable
    assert np.abs(residuals(mixed, result.forces, p.masses, p.coms)).max() <= 1.02 * TOLERANCE


def test_an_item_on_the_floor_beside_the_pile_is_decided_at_once():
    p = stacked()
    previous = CHECKER.check(*p.args)
    beside = piles.rectangle(0.2, 0.3, 0, 0.1, 0)
    c = joined(
        p.contacts,
        Contacts(beside, np.tile([0.0, 0, 1], (4, 1)), np.zeros(4, int), np.full(4, 4), np.zeros(4)),
    )
    result = CHECKER.check(c, [*p.masses, 1.0], [*p.coms, [0.25, 0.05, 0.05]], previous=previous)
    assert result.stable
    assert result.decided_by == "first-order"
    np.testing.assert_array_equal(result.forces[:12], previous.forces)


def test_who_falls_is_named():
    p = stacked()
    shifted = replace(p, coms=p.coms + np.array([[0, 0, 0], [0, 0, 0], [0.2, 0, 0]]))
    result = CHECKER.check(*shifted.args, new=1)
    assert not result.stable
    assert result.decided_by == "pile"
    assert "item 3" in result.reason
    assert CHECKER.check(*shifted.args).decided_by == "new-item"


def test_a_new_item_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="new item 2"):
        CHECKER.check(*piles.box_on_floor().args, new=2)


def test_an_empty_container_stands():
    p = piles.pile(np.empty((0, 3)), np.ones((0, 3)), [], [], [], np.empty((0, 3)))
    assert CHECKER.check(*p.args).stable
    assert measure_margin(CHECKER, *p.args).tilt_deg == pytest.approx(45.0)


# Closed forms --------------------------------------------------------------------------------------------


def test_box_on_the_floor_shares_its_weight():
    result = CHECKER.check(*piles.box_on_floor().args)
    assert result.stable
    np.testing.assert_allclose(result.forces.sum(axis=0), [0, 0, 9.81], atol=1e-4)


def test_box_beyond_its_edge_by_a_tenth_of_a_millimetre():
    assert stands(piles.overhang(-1e-4))
    assert not stands(piles.overhang(+1e-4))


@pytest.mark.parametrize("yaw", [0, 7, 22.5, 45, 61, 133, 290])
def test_ramp_at_the_friction_angle(yaw):
    angle = np.degrees(np.arctan(0.7))
    assert stands(piles.on_ramp(angle - 1, yaw))
    assert not stands(piles.on_ramp(angle + 1, yaw))


@pytest.mark.parametrize("angle", [40, 55, 70])
@pytest.mark.parametrize("fraction", [0.3, 0.5, 0.7])
def test_leaning_plank_needs_the_friction_of_its_closed_form(angle, fraction):
    needed = piles.plank_needs(angle, fraction)
    assert not stands(piles.plank(angle, fraction), needed - 0.01)
    assert stands(piles.plank(angle, fraction), needed + 0.01)
    found = measure_margin(StabilityChecker(mu=2.0), *piles.plank(angle, fraction).args, with_mu=True).mu
    assert found == pytest.approx(needed, abs=2e-3)


@pytest.mark.parametrize("half_angle", [60, 70, 80])
def test_thin_arch_needs_the_friction_of_its_closed_form(half_angle):
    needed = piles.arch_needs(half_angle)
    thin = piles.arch(1e-4, half_angle)
    assert not stands(thin, needed - 0.02)
    assert stands(thin, needed + 0.02)
    # A thick one has room for a better line of thrust.
    assert stands(piles.arch(0.02, half_angle), needed - 0.02)


def test_arch_without_its_keystone_falls():
    whole = piles.arch(0.02)
    c = whole.contacts
    left_only = c.take((c.second == 1) & (c.first == 0))
    assert stands(whole, 2.0)
    assert not stands(Pile(left_only, whole.masses[:1], whole.coms[:1], whole.gravity), 2.0)


def test_bridge_stands_only_when_complete():
    halves, whole = piles.bridge(key=False), piles.bridge(key=True)
    assert not CHECKER.check(*halves.args).stable
    assert CHECKER.check(*whole.args).stable
    c = whole.contacts
    for item in (1, 2):
        alone = c.take((c.first == 0) & (c.second == item))
        p = Pile(
            replace(alone, second=np.ones_like(alone.second)),
            whole.masses[:1],
            whole.coms[[item - 1]],
            whole.gravity,
        )
        assert CHECKER.check(*p.args).decided_by == "new-item"
