"""The margin: laws, closed forms, and that its shortcuts answer as the plain check does."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from packenv.planning.stability import margins
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.equilibrium import TOLERANCE, residuals
from packenv.planning.stability.margins import MarginRule, check_margin, measure_margin, upright_forces
from packenv.planning.stability.solvers import solve_highs
from tests.planning.stability import piles
from tests.planning.stability.piles import Pile

CHECKER = StabilityChecker()


def survives(p: Pile, tilt_deg: float = 8.0, mu: float = 0.25) -> bool:
    checker = StabilityChecker(gravity=tuple(p.gravity))
    return check_margin(checker, *p.args, MarginRule(tilt_deg, mu))[-1].stable


def some_piles(seed: int, n: int) -> list[Pile]:
    """Towers and rubble under vertical gravity."""
    rng = np.random.default_rng(seed)
    return [
        piles.stack_of_boxes(rng, int(rng.integers(1, 5)), float(rng.uniform(0.03, 0.12)))
        if rng.random() < 0.5
        else piles.rubble(rng, int(rng.integers(1, 5)), int(rng.integers(4, 9)), float(rng.uniform(0.1, 0.6)))
        for _ in range(n)
    ]


# Laws ----------------------------------------------------------------------------------------------------


def test_more_friction_never_makes_a_pile_fall_under_tilt():
    changes = 0
    for p in some_piles(1, 50):
        verdicts = [survives(p, 5.0, mu) for mu in (0.0, 0.1, 0.3, 0.5, 0.7)]
        assert verdicts == sorted(verdicts)
        changes += verdicts[0] != verdicts[-1]
    assert changes >= 10


def test_more_tilt_never_makes_a_pile_stand():
    changes = 0
    for p in some_piles(2, 50):
        verdicts = [survives(p, tilt, 0.5) for tilt in (20.0, 10.0, 5.0, 2.0, 0.0)]
        assert verdicts == sorted(verdicts)
        changes += verdicts[0] != verdicts[-1]
    assert changes >= 10


def test_what_survives_a_margin_stands_for_the_paper():
    seen: Counter[tuple[bool, bool]] = Counter()
    for p in some_piles(3, 80):
        seen[survives(p), CHECKER.check(*p.args).stable] += 1
    assert not seen[True, False]
    assert min(seen[True, True], seen[False, True], seen[False, False]) >= 5


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_turning_the_scene_by_quarters_changes_nothing(quarter):
    turn = Rotation.from_euler("z", 90 * quarter, degrees=True).as_matrix()
    seen: Counter[bool] = Counter()
    for p in some_piles(4 + quarter, 30):
        q = piles.turned(p, turn, (0.1, -0.2, 0.0))
        assert survives(p) == survives(q)
        assert measure_margin(CHECKER, *p.args).tilt_deg == pytest.approx(
            measure_margin(CHECKER, *q.args).tilt_deg, abs=1e-3
        )
        seen[survives(p)] += 1
    assert min(seen[True], seen[False]) >= 5


def test_the_rule_asks_every_direction_and_nothing_else():
    """Against the whole linear program of each direction, without shortcuts."""
    rule = MarginRule(6.0, 0.4)
    seen: Counter[bool] = Counter()
    for p in some_piles(8, 60):
        eq = rule.weakened(CHECKER).build(*p.args, None)
        whole = all(solve_highs(eq.tilted(pull)).status == "stable" for pull in rule.pulls())
        results = check_margin(CHECKER, *p.args, rule)
        assert results[-1].stable == whole
        assert len(results) == 8 or not whole
        seen[whole] += 1
    assert min(seen[True], seen[False]) >= 10


def test_forces_without_tilt_are_the_mean_of_those_under_all_tilts():
    asked = 0
    for p in some_piles(9, 40):
        results = check_margin(CHECKER, *p.args, MarginRule(5.0, 0.4))
        if not results[-1].stable:
            with pytest.raises(ValueError, match="does not stand"):
                upright_forces(results)
            continue
        forces = upright_forces(results)
        assert np.abs(residuals(p.contacts, forces, p.masses, p.coms)).max() <= 1.02 * TOLERANCE
        push = np.einsum("ij,ij->i", forces, p.contacts.normals)
        friction = np.linalg.norm(forces - push[:, None] * p.contacts.normals, axis=1)
        assert (friction <= 0.4 * push + 1e-9).all()
        asked += 1
    assert asked >= 10


def test_the_rule_never_counts_on_more_friction_than_there_is():
    ramp = piles.on_ramp(20.0, 0.0)
    slippery = StabilityChecker(mu=0.3, gravity=tuple(ramp.gravity))
    assert not check_margin(slippery, *ramp.args, MarginRule(0.0, 0.7))[-1].stable
    assert survives(ramp, 0.0, 0.7)


# The rule and the figure ---------------------------------------------------------------------------------


def test_the_rule_is_the_figure_at_its_friction():
    rng = np.random.default_rng(12)
    seen: Counter[bool] = Counter()
    rule = MarginRule(5.0, 0.25)
    for _ in range(40):
        p = piles.stack_of_boxes(rng, 3, 0.1)
        tilt = measure_margin(rule.weakened(CHECKER), *p.args).tilt_deg
        if abs(tilt - 5.0) > 0.01:
            verdict = check_margin(CHECKER, *p.args, rule)[-1].stable
            assert verdict == (tilt > 5.0)
            seen[verdict] += 1
    assert min(seen[True], seen[False]) >= 4


def test_a_pile_grows_as_it_would_from_nothing():
    """Forces of the step before, one set a direction, change no verdict."""
    rng = np.random.default_rng(13)
    seen: Counter[bool] = Counter()
    for _ in range(12):
        p = piles.stack_of_boxes(rng, 6, float(rng.uniform(0.05, 0.12)), per_edge=3)
        previous = None
        for n in range(1, 7):
            part = p.contacts.take(p.contacts.second <= n)
            question = (part, p.masses[:n], p.coms[:n])
            grown = check_margin(CHECKER, *question, previous=previous)
            assert grown[-1].stable == check_margin(CHECKER, *question)[-1].stable
            seen[grown[-1].stable] += 1
            if not grown[-1].stable:
                break
            previous = grown
    assert min(seen[True], seen[False]) >= 8


@pytest.mark.parametrize(
    ("tilt_deg", "mu", "named"),
    [(-1.0, 0.3, "-1"), (90.0, 0.3, "90"), (5.0, -0.1, "-0.1"), (5.0, np.nan, "nan")],
)
def test_a_rule_out_of_range_is_refused(tilt_deg, mu, named):
    with pytest.raises(ValueError, match=named):
        MarginRule(tilt_deg, mu)


def test_nothing_survives_everything():
    p = piles.pile(np.empty((0, 3)), np.ones((0, 3)), [], [], [], np.empty((0, 3)))
    assert [result.stable for result in check_margin(CHECKER, *p.args)] == [True] * 8


# Closed forms --------------------------------------------------------------------------------------------


def test_a_flat_box_survives():
    assert survives(piles.box_on_floor())


def test_ball_in_a_corner_and_on_the_floor_stand_for_the_paper_and_not_for_the_margin():
    for ball in (piles.ball_on_floor(), piles.ball_in_corner()):
        assert CHECKER.check(*ball.args).stable
        assert not survives(ball)
        assert measure_margin(CHECKER, *ball.args).tilt_deg == pytest.approx(0.0, abs=0.01)


def wedged(overhang_deg: float, foot: float = 0.0, radius: float = 0.04) -> Pile:
    """A ball between two faces that lean over it by an angle each: only friction keeps it up.

    Scanned surfaces touch in patches: each of ours is two points, ``foot`` to either side.
    """
    a = np.radians(overhang_deg)
    normals = np.array([[np.cos(a), 0.0, -np.sin(a)], [-np.cos(a), 0.0, -np.sin(a)]]).repeat(2, axis=0)
    centre = np.array([0.1, 0.1, 0.1])
    points = centre - radius * normals + np.outer([-foot, foot, -foot, foot], [0.0, 1.0, 0.0])
    return piles.pile(points, normals, [0] * 4, [1] * 4, [0.2], [centre])


def test_a_ball_that_friction_alone_holds_needs_the_friction_of_its_closed_form():
    """Self-locking: it holds, under any load, where μ exceeds the tangent of the overhang."""
    for angle in (5.0, 15.0, 30.0):
        needed = np.tan(np.radians(angle))
        assert StabilityChecker(mu=needed + 0.01).check(*wedged(angle).args).stable
        assert not StabilityChecker(mu=needed - 0.01).check(*wedged(angle).args).stable


def test_a_ball_that_friction_alone_holds_is_stable_for_the_paper_and_rejected_for_its_friction():
    ball = wedged(20.0, foot=0.003)
    assert CHECKER.check(*ball.args).stable
    assert survives(ball, 8.0, 0.7)  # tilt alone does not find it
    assert not survives(ball)


def test_a_plank_that_leans_on_friction_is_stable_for_the_paper_alone():
    plank = piles.plank(55.0, 0.5)
    assert 0.25 < piles.plank_needs(55.0, 0.5) < 0.7
    assert CHECKER.check(*plank.args).stable
    assert not survives(plank, 0.0, 0.25)
    assert not survives(plank)


@pytest.mark.parametrize(("inside", "expected"), [(0.010, True), (0.004, False)])
def test_a_box_beyond_an_edge_survives_as_far_as_its_centre_of_mass_is_inside(inside, expected):
    """It topples at atan(inside / height of the centre of mass)."""
    box = piles.overhang(-inside)
    lever = float(box.coms[-1, 2] - box.contacts.points[:, 2].min())
    assert (np.degrees(np.arctan(inside / lever)) > 8.0) == expected
    assert survives(box) == expected


def test_margin_of_a_standing_box_is_its_edge_or_its_friction():
    """It topples at atan(half width / height of the centre of mass) or slides at atan μ, the sooner."""
    for height, mu in ((0.05, 0.7), (0.12, 0.7), (0.3, 0.7), (0.12, 0.2)):
        box = piles.box_on_floor(com=(0.05, 0.05, height))
        found = measure_margin(StabilityChecker(mu=mu), *box.args)
        expected = np.degrees(np.arctan(min(mu, 0.05 / height)))
        assert found.tilt_deg == pytest.approx(expected, abs=0.01)
        assert found.stable


def test_margin_is_capped_and_zero_for_what_falls():
    found = measure_margin(
        StabilityChecker(mu=3.0), *piles.box_on_floor(com=(0.05, 0.05, 0.01)).args, cap_deg=30.0
    )
    np.testing.assert_allclose(found.tilts_deg, 30.0)
    fallen = measure_margin(CHECKER, *piles.overhang(0.01).args, with_mu=True)
    assert not fallen.stable
    assert fallen.tilt_deg == 0.0
    assert fallen.mu is None


def test_margin_is_where_the_tilted_pile_begins_to_fall():
    """The linear program's tilt, asked of the plain check on either side."""
    rng = np.random.default_rng(11)
    asked = 0
    while asked < 12:
        p = piles.stack_of_boxes(rng, 5, 0.06)
        found = measure_margin(CHECKER, *p.args)
        if not found.stable:
            continue
        asked += 1
        for direction, tilt in zip(found.directions, found.tilts_deg, strict=True):
            below, above = (np.tan(np.radians(max(tilt + d, 0.0))) for d in (-0.01, 0.01))
            assert CHECKER.check(*p.args, tilt=below * direction).stable
            if tilt < 45.0:
                assert not CHECKER.check(*p.args, tilt=above * direction).stable


def test_margin_falls_back_on_asking_when_its_program_fails(monkeypatch):
    box = piles.box_on_floor(com=(0.05, 0.05, 0.12))
    expected = measure_margin(CHECKER, *box.args).tilts_deg
    monkeypatch.setattr(margins, "_ROUNDS", 0)
    np.testing.assert_allclose(measure_margin(CHECKER, *box.args).tilts_deg, expected, atol=0.02)
