"""Friction of each item: laws, closed forms, and the two checks of a real pile with a slippery item in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from packenv.config import GridConfig
from packenv.planning.options import PlanOptions
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contact_finder import contact_finder, grounded
from packenv.planning.stability.contact_patches import tighten
from packenv.planning.stability.contacts import Body, join, with_friction
from packenv.planning.stability.equilibrium import build_equilibrium
from packenv.planning.stability.margins import MarginRule, check_margin, measure_margin
from packenv.planning.stability.settling import settled_tilt, settles
from packenv.planning.stability.solvers import solve_cvxpy
from packenv.robot.files import load_cell
from packenv.types import Contacts, Container, Item, Placement, Plan
from packenv.verification.stability_and_reach import recheck
from tests.planning.stability import piles
from tests.planning.stability.piles import Pile, pile
from tests.shapes import as_item, box
from tests.shelf_samples import shelf_of

CHECKER = StabilityChecker()


def rubbed(p: Pile, *own: float, container: float = 0.7) -> Contacts:
    """Contacts of a pile whose items have these coefficients: the lesser of each pair."""
    of = np.array([container, *own])
    return replace(p.contacts, mu=np.minimum(of[p.contacts.first], of[p.contacts.second]))


def answers(contacts: Contacts, p: Pile) -> list[object]:
    """All that is asked of a pile."""
    n = len(p.masses)
    question = (contacts, p.masses, p.coms)
    own = contacts.take((contacts.first == n) | (contacts.second == n))
    margin = measure_margin(CHECKER, *question, with_mu=True)
    checked = (CHECKER.check(*question), *check_margin(CHECKER, *question))
    return [
        *((r.stable, r.decided_by, r.forces is None or r.forces.tolist()) for r in checked),
        (margin.tilt_deg, margin.tilts_deg.tolist(), margin.mu),
        settles(CHECKER, own, p.coms[-1], n),
        settles(CHECKER, own, p.coms[-1], n, MarginRule()),
        settled_tilt(CHECKER, own, p.coms[-1], n, margin),
    ]


# Laws ----------------------------------------------------------------------------------------------------


def test_the_same_coefficient_everywhere_changes_no_number():
    rng = np.random.default_rng(0)
    for _ in range(25):
        n = int(rng.integers(1, 5))
        p = piles.rubble(rng, n, 6, float(rng.uniform(0.1, 1.0)))
        assert answers(rubbed(p, *[0.7] * n), p) == answers(p.contacts, p)


def test_more_friction_of_one_item_never_makes_a_pile_fall():
    rng = np.random.default_rng(1)
    changes = 0
    for _ in range(120):
        n = int(rng.integers(1, 5))
        p = piles.rubble(rng, n, 6, float(rng.uniform(0.3, 2.0)))
        own = rng.uniform(0.0, 0.8, n)
        before = verdicts(rubbed(p, *own), p)
        for item in rng.permutation(n):
            own[item] += rng.uniform(0.0, 0.8)
            now = verdicts(rubbed(p, *own), p)
            assert all(b or not a for a, b in zip(before, now, strict=True))
            changes += before != now
            before = now
    assert changes >= 20


def verdicts(contacts: Contacts, p: Pile) -> tuple[bool, bool]:
    """Balanced, and with a margin too."""
    question = (contacts, p.masses, p.coms)
    return CHECKER.check(*question).stable, check_margin(CHECKER, *question)[-1].stable


def test_more_friction_of_the_item_that_comes_never_keeps_it_from_settling():
    """And of one that it touches hardly ever: several coefficients are lowered together, not each by itself."""
    rng = np.random.default_rng(2)
    changes, worse, raised = 0, 0, 0
    for _ in range(400):
        p = piles.rubble(rng, 3, 7, float(rng.uniform(0.3, 3.0)))
        own = rng.uniform(0.0, 1.0, 3)
        before = settles(CHECKER, rubbed(p, *own), p.coms[2], 3)
        for item in (2, 0, 1):
            own[item] += rng.uniform(0.0, 1.0)
            now = settles(CHECKER, rubbed(p, *own), p.coms[2], 3)
            assert now or not before or item != 2
            changes += now and not before
            worse += before and not now
            raised += 1
            before = now
    assert changes >= 20
    assert worse <= 0.005 * raised


def test_the_checker_says_what_the_reference_says_where_coefficients_differ():
    rng = np.random.default_rng(3)
    said = []
    for _ in range(40):
        n = int(rng.integers(1, 4))
        p = piles.rubble(rng, n, 5, float(rng.uniform(0.1, 1.5)))
        contacts = rubbed(p, *rng.uniform(0.05, 1.2, n))
        mu = CHECKER.coefficients(contacts)
        reference = solve_cvxpy(build_equilibrium(contacts, p.masses, p.coms, mu=mu))
        result = CHECKER.check(contacts, p.masses, p.coms)
        assert result.stable == (reference.status == "stable")
        said.append(result.stable)
        if result.forces is not None:
            push = np.einsum("ij,ij->i", result.forces, contacts.normals)
            rub = np.linalg.norm(result.forces - push[:, None] * contacts.normals, axis=1)
            assert (rub <= mu * push + 1e-9).all()
    assert 5 <= sum(said) <= 35


def test_a_margin_counts_on_no_more_than_its_rule_and_on_no_more_than_there_is():
    weak = MarginRule(mu=0.25).weakened(CHECKER)
    p = piles.stack_of_boxes(np.random.default_rng(0), 3, 0.01)
    mu = weak.coefficients(rubbed(p, 0.1, 0.9, 0.9))
    assert set(mu.tolist()) == {0.1, 0.25}
    assert weak.coefficients(p.contacts) == 0.25


def test_joined_with_contacts_that_have_none_these_keep_the_checkers():
    p = piles.box_on_floor()
    both = join([p.contacts, rubbed(p, 0.2)])
    assert CHECKER.coefficients(both).tolist() == [0.7] * 4 + [0.2] * 4
    assert both.take(np.arange(3, 5)).mu.tolist()[1] == 0.2
    assert join([p.contacts, p.contacts]).mu is None


# Closed forms --------------------------------------------------------------------------------------------


def on_wedge(slope_deg: float) -> Pile:
    """Item 1 is a heavy wedge on the floor, item 2 a flat box on its slope, which rises along x."""
    turn = Rotation.from_euler("y", -slope_deg, degrees=True).as_matrix()
    middle = np.array([0.0, 0.0, 0.1])
    patch = piles.rectangle(-0.03, 0.03, -0.03, 0.03, 0.0) @ turn.T + middle
    floor = piles.rectangle(-0.1, 0.1, -0.1, 0.1, 0.0)
    return pile(
        np.concatenate([floor, patch]),
        [[0, 0, 1]] * 4 + [turn[:, 2]] * 4,
        [0] * 4 + [1] * 4,
        [1] * 4 + [2] * 4,
        [5.0, 0.3],
        [[0, 0, 0.04], middle + 0.005 * turn[:, 2]],
    )


@pytest.mark.parametrize(("lower", "upper"), [(0.2, 0.6), (0.6, 0.2), (0.9, 0.45), (0.3, 0.3), (0.85, 0.95)])
def test_a_box_on_an_item_slides_beyond_the_lesser_friction_angle(lower: float, upper: float):
    least = min(lower, upper)
    for share in (0.97, 1.03):
        p = on_wedge(np.degrees(np.arctan(share * least)))
        contacts = rubbed(p, lower, upper)
        assert CHECKER.check(contacts, p.masses, p.coms).stable == (share < 1.0)
        if share < 1.0:
            assert settles(CHECKER, contacts, p.coms[1], 2)
    flat = on_wedge(0.0)
    margin = measure_margin(CHECKER, rubbed(flat, lower, upper), flat.masses, flat.coms, free=[2])
    assert margin.tilt_deg == pytest.approx(np.degrees(np.arctan(least)), abs=0.01)
    needed = measure_margin(
        CHECKER, rubbed(on_wedge(8.0), lower, upper), flat.masses, on_wedge(8.0).coms, with_mu=True
    )
    assert needed.mu == pytest.approx(np.tan(np.radians(8.0)), abs=2e-3)


@pytest.mark.parametrize(("own", "container"), [(0.3, 0.7), (0.9, 0.5)])
def test_a_box_on_the_container_slides_beyond_the_lesser_friction_angle(own: float, container: float):
    checker = StabilityChecker(mu=container)
    for share in (0.97, 1.03):
        ramp = piles.on_ramp(np.degrees(np.arctan(share * min(own, container))), 20.0)
        contacts = rubbed(ramp, own, container=container)
        assert checker.check(contacts, ramp.masses, ramp.coms).stable == (share < 1.0)


def test_an_arch_stands_while_its_most_slippery_stone_has_what_it_needs():
    needs = piles.arch_needs()
    p = piles.arch(1e-4)
    for stone in range(3):
        for share in (0.95, 1.05):
            own = [5.0] * 3
            own[stone] = share * needs
            stands = StabilityChecker(mu=5.0).check(rubbed(p, *own, container=5.0), p.masses, p.coms).stable
            assert stands or share < 1.0
            if stone != 1:  # a springer carries a stone that needs it all
                assert stands == (share > 1.0)


# Real surfaces -------------------------------------------------------------------------------------------

BOX = Container(0.3, 0.3, 0.2)
GRID = GridConfig(cell_size=0.005, n_yaws=1)
SLOPE = 20.0


def wedge(friction: float | None) -> Item:
    """A block 14 cm long whose top rises by 20° along x; its smallest corner is the origin."""
    import trimesh

    rise = 0.14 * np.tan(np.radians(SLOPE))
    low = np.array([[0, 0, 0.0], [0.14, 0, 0], [0, 0.12, 0], [0.14, 0.12, 0]])
    high = low + np.array([[0, 0, 0.02], [0, 0, 0.02 + rise], [0, 0, 0.02], [0, 0, 0.02 + rise]])
    mesh = trimesh.Trimesh(vertices=np.concatenate([low, high])).convex_hull
    return replace(as_item(mesh, "wedge", 2000.0), friction=friction)


def block(friction: float | None) -> Item:
    """A flat box that lies on the slope."""
    return replace(box(0.05, 0.05, 0.02, "block"), friction=friction)


def on_slope() -> tuple[Placement, Placement]:
    """The wedge on the floor, the block on its slope."""
    turn = Rotation.from_euler("y", -SLOPE, degrees=True).as_matrix()
    middle = np.array([0.1 + 0.07, 0.1 + 0.06, 0.02 + 0.07 * np.tan(np.radians(SLOPE))])
    at = middle + turn @ np.array([-0.025, -0.025, 1e-4])
    corner = np.zeros(3)
    return (
        Placement("wedge", 1, np.eye(3), np.array([0.1, 0.1, 0.0]), corner, corner, 0, 0.0, 0.0, 1),
        Placement("block", 1, turn, at, corner, corner, 0, 0.0, 0.0, 1),
    )


@pytest.mark.parametrize("lying", [0, 1])
@pytest.mark.parametrize("stability", ["paper", "cautious"])
@pytest.mark.parametrize(
    ("lower", "upper", "cell", "falls"),
    [
        (None, None, 0.7, False),
        (None, None, 0.3, True),
        (0.1, None, 0.7, True),
        (None, 0.1, 0.7, True),
        (0.5, 0.5, 0.3, False),
        (0.5, None, 0.3, True),
        (0.34, 0.9, 0.7, True),
        (0.39, 0.9, 0.7, False),
    ],
)
def test_verify_believes_the_catalogues_friction(lower, upper, cell, falls, stability, lying):
    """Stands with more than tan 20° = 0.364, also where the wedge lay there before, as ground."""
    items = {item.name: item for item in (wedge(lower), block(upper))}
    options = PlanOptions(
        constraints="stability",
        stability=stability,
        grid=GRID,
        cell=load_cell({"robot": "tx90", "friction": cell}),
    )
    plan = replace(Plan(BOX, on_slope(), ()), lying=lying)
    found = recheck(plan, items, shelf_of(items, GRID).fields, options)
    assert found.unstable_steps == ((2,) if falls else ())


def test_the_planners_contacts_are_the_verifiers():
    """Found with the pile, or as ground: one coefficient, the lesser one."""
    items = {item.name: item for item in (wedge(0.2), block(0.5))}
    fields = shelf_of(items, GRID).fields
    bodies = [
        Body(fields[p.item], p.rotation, p.position, friction=items[p.item].friction) for p in on_slope()
    ]
    for rule in ("surface", "paper"):
        found = contact_finder(rule, 0.7, tight=True)(bodies[1], bodies[:1], BOX, 2)
        assert len(found)
        assert set(found.mu.tolist()) == {0.2}
        assert grounded(found, 1).mu.tolist() == found.mu.tolist()
        assert set(tighten(found).mu.tolist()) == {0.2}
        bare = [replace(b, friction=None) for b in bodies]
        assert contact_finder(rule, 0.7, tight=True)(bare[1], bare[:1], BOX, 2).mu is None
        assert with_friction(found, bare, 0.7) is found
