"""The force balance: laws of the matrices, three solvers with one meaning, and forces that really balance."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from packenv.planning.stability import solvers
from packenv.planning.stability.equilibrium import (
    TOLERANCE,
    build_equilibrium,
    falls_alone,
    residuals,
)
from packenv.planning.stability.solvers import Solution, solve_clarabel, solve_cvxpy, solve_highs, solve_nnls
from tests.planning.stability import piles
from tests.planning.stability.piles import Pile


def build(p: Pile, **options):
    return build_equilibrium(*p.args, gravity=p.gravity, **options)


def unit_normals(seed: int, k: int = 200) -> np.ndarray:
    n = np.random.default_rng(seed).normal(size=(k, 3))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def pyramids(normals, mu, sides=8):
    """Edges that the force balance gives to contacts of the container with one item: (k, sides, 3)."""
    k = len(normals)
    p = piles.pile(np.zeros((k, 3)), normals, np.zeros(k), np.ones(k), [1.0], np.zeros((1, 3)))
    return build(p, mu=mu, sides=sides).edges


@pytest.mark.parametrize("sides", [3, 4, 8, 13])
@pytest.mark.parametrize("mu", [0.0, 0.3, 1.5])
def test_pyramid_is_inscribed_and_its_edges_lie_on_the_cone(mu, sides):
    normals = np.vstack([unit_normals(0), np.eye(3), -np.eye(3)])
    edges = pyramids(normals, mu, sides)
    assert edges.shape == (len(normals), sides, 3)
    push = np.einsum("ksj,kj->ks", edges, normals)
    across = np.linalg.norm(edges - push[..., None] * normals[:, None, :], axis=2)
    np.testing.assert_allclose(push, 1.0, atol=1e-12)
    np.testing.assert_allclose(across, mu, atol=1e-12)
    # Combinations of edges stay inside the cone.
    mix = np.random.default_rng(1).dirichlet(np.ones(sides), len(normals))
    force = np.einsum("ks,ksj->kj", mix, edges)
    along = np.einsum("kj,kj->k", force, normals)
    assert (np.linalg.norm(force - along[:, None] * normals, axis=1) <= mu * along + 1e-12).all()


def test_first_edge_points_uphill():
    normals = unit_normals(2)
    edges = pyramids(normals, 0.5)
    uphill = np.array([0.0, 0.0, 1.0]) - normals[:, 2:] * normals
    uphill /= np.linalg.norm(uphill, axis=1, keepdims=True)
    np.testing.assert_allclose((edges[:, 0] - normals) / 0.5, uphill, atol=1e-9)


@pytest.mark.parametrize(("mu", "sides"), [(-0.1, 8), (np.nan, 8), (np.inf, 8), (0.7, 2)])
def test_pyramid_refuses_nonsense(mu, sides):
    with pytest.raises(ValueError, match="friction"):
        pyramids(np.eye(3), mu, sides)


def test_matrix_is_the_balance_of_the_forces():
    """A x − b, built column by column, is what the forces leave unbalanced, computed without a matrix."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        p = piles.random_pile(rng)
        eq = build(p)
        x = rng.exponential(size=eq.n_columns)
        left = residuals(p.contacts, eq.forces(x), p.masses, p.coms, gravity=p.gravity)
        np.testing.assert_allclose(eq.matrix @ x - eq.rhs, left.ravel(), atol=1e-9 * max(1.0, x.sum()))
        np.testing.assert_allclose(eq.dense, eq.matrix.toarray())
        y = rng.normal(size=eq.n_rows)
        np.testing.assert_allclose(eq.work(y), eq.matrix.T @ y, atol=1e-9)
        some = rng.permutation(eq.n_columns)[:7]
        start, index, value = eq.columns(some)
        for j, column in enumerate(some):
            got = np.zeros(eq.n_rows)
            got[index[start[j] : start[j + 1]]] = value[start[j] : start[j + 1]]
            np.testing.assert_allclose(got, eq.dense[:, column])


def test_actio_is_reactio():
    """Of a contact between two items nothing is left for the pile as a whole."""
    p = piles.pile(
        [[0.01, 0.02, 0.1]], [[0.3, -0.2, 1.0]], [1], [2], [1.0, 3.0], [[0, 0, 0.05], [0, 0, 0.15]]
    )
    eq = build(p)
    wrench = (eq.dense * np.repeat(eq.weights, 6)[:, None]).reshape(2, 6, -1)
    np.testing.assert_allclose(wrench[0, :3] + wrench[1, :3], 0.0, atol=1e-12)
    about_origin = [
        wrench[i, 3:] * eq.length + np.cross(p.coms[i], wrench[i, :3], axisb=0).T for i in range(2)
    ]
    np.testing.assert_allclose(about_origin[0] + about_origin[1], 0.0, atol=1e-12)


def test_matrix_does_not_feel_the_scale_of_the_masses():
    p = piles.stack_of_boxes(np.random.default_rng(4), 5, 0.05)
    a, b = build(p), build(Pile(p.contacts, 1e4 * p.masses, p.coms, p.gravity))
    np.testing.assert_allclose(a.value, b.value, rtol=1e-12)
    np.testing.assert_allclose(a.rhs, b.rhs)


def test_held_items_are_as_the_container():
    p = piles.stack_of_boxes(np.random.default_rng(5), 5, 0.03)
    eq = build(p, free=[5])
    on_five = p.contacts.take((p.contacts.first == 5) | (p.contacts.second == 5))
    alone = Pile(
        replace(on_five, first=np.zeros_like(on_five.first), second=np.ones_like(on_five.second)),
        p.masses[4:],
        p.coms[4:],
        p.gravity,
    )
    np.testing.assert_allclose(eq.dense, build(alone).dense)
    assert len(eq.contacts) == len(on_five) < len(p.contacts)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"masses": [0.0]}, "mass"),
        ({"masses": [np.nan]}, "mass"),
        ({"masses": [1.0, 1.0]}, "centres"),
        ({"gravity": (0, 0, 0)}, "gravity"),
    ],
)
def test_build_refuses_nonsense(change, message):
    p = piles.box_on_floor()
    masses = change.pop("masses", p.masses)
    with pytest.raises(ValueError, match=message):
        build_equilibrium(p.contacts, masses, p.coms, **change)


def test_build_refuses_contacts_of_no_one():
    p = piles.box_on_floor()
    c = p.contacts
    for bad in (
        replace(c, second=c.second + 1),
        replace(c, first=c.second),
        replace(c, first=c.first - 1),
        replace(c, points=c.points * np.nan),
    ):
        with pytest.raises(ValueError, match=r"contact|bodies"):
            build_equilibrium(bad, p.masses, p.coms)


def agree(rng: np.random.Generator, n: int) -> Counter:
    """Ask all solvers about ``n`` random piles; count their answers, and those near the boundary."""
    seen: Counter = Counter()
    for number in range(n):
        p = piles.random_pile(rng)
        eq = build(p)
        answers = {
            "highs": solve_highs(eq),
            "warm": solve_highs(eq, rng.integers(0, max(eq.n_columns, 1), 5) if eq.n_columns else None),
            "nnls": solve_nnls(eq),
            "clarabel": solve_clarabel(eq) if eq.n_columns else solve_nnls(eq),
            "cvxpy": solve_cvxpy(eq),
        }
        words = {name: a.status for name, a in answers.items()}
        # An interior point ends a little off the edge: others are asked after it.
        if words["clarabel"] == "undecided":
            seen["left open"] += 1
            del words["clarabel"]
        assert len(set(words.values())) == 1, (number, words)
        assert words["highs"] != "undecided", number
        for answer in answers.values():
            if answer.status == "stable":
                check_forces(p, eq, answer)
        tight, loose = (solve_highs(build(p, tolerance=t)).status for t in (TOLERANCE / 100, TOLERANCE * 100))
        seen[words["highs"]] += 1
        seen["near"] += tight != loose
    return seen


def check_forces(p: Pile, eq, answer: Solution) -> None:
    left = residuals(p.contacts, answer.forces, p.masses, p.coms, gravity=p.gravity)
    assert np.abs(left).max(initial=0.0) <= 1.01 * TOLERANCE
    push = np.einsum("kj,kj->k", answer.forces, p.contacts.normals)
    friction = np.linalg.norm(answer.forces - push[:, None] * p.contacts.normals, axis=1)
    assert (push >= -1e-9).all()
    assert (friction <= eq.mu * push + 1e-9).all()


def test_all_solvers_agree_on_random_piles():
    seen = agree(np.random.default_rng(6), 300)
    # The question must be open, or agreement is worth nothing.
    assert seen["stable"] >= 90
    assert seen["unstable"] >= 90
    assert seen["near"] <= 6
    assert seen["left open"] == 0


@pytest.mark.slow
def test_all_solvers_agree_on_thousands_of_random_piles():
    seen = agree(np.random.default_rng(7), 5000)
    assert min(seen["stable"], seen["unstable"]) >= 1500
    assert seen["near"] <= 100
    assert seen["left open"] <= 5


def test_one_item_falls_alone_exactly_where_the_solver_says_so():
    rng, seen = np.random.default_rng(21), Counter()
    for _ in range(150):
        p = piles.random_pile(rng)
        up = -p.gravity / np.linalg.norm(p.gravity)
        sideways = np.linalg.svd(up[None])[2][1]
        tilts = np.array([0.0, 0.1, -0.2])[:, None] * sideways
        for body in range(1, len(p.masses) + 1):
            own = p.contacts.take((p.contacts.first == body) | (p.contacts.second == body))
            motion = falls_alone(own, p.coms[body - 1], body, tilts, gravity=p.gravity)
            questions = [build(p, free=[body]).tilted(tilt) for tilt in tilts]
            falls = any(solve_highs(eq).status == "unstable" for eq in questions)
            assert falls == (motion is not None)
            if motion is not None:
                assert np.abs(motion).sum() == pytest.approx(1.0)
                assert any(eq.refuted_by(motion) for eq in questions)
            seen[falls] += 1
    assert min(seen[True], seen[False]) >= 50


def test_a_centre_of_mass_counts_where_it_is_said_to_be_off():
    """The same answer as of an item whose centre of mass lies there; with a tolerance of torque about each."""
    rng, seen = np.random.default_rng(22), Counter()
    for _ in range(150):
        p = piles.random_pile(rng)
        up = -p.gravity / np.linalg.norm(p.gravity)
        way = np.linalg.svd(up[None])[2][1]
        for body in range(1, len(p.masses) + 1):
            own = p.contacts.take((p.contacts.first == body) | (p.contacts.second == body))
            com = p.coms[body - 1]
            for tilt in (0.1 * way, -0.2 * way):
                aside = float(rng.uniform(0.0, 0.3))
                there = com + aside * tilt / np.linalg.norm(tilt)
                moved = falls_alone(own, there, body, tilt[None], gravity=p.gravity)
                said = falls_alone(own, com, body, tilt[None], aside=aside, gravity=p.gravity)
                eq = build(p, free=[body]).tilted(tilt, aside)
                assert (said is None) == (moved is None) == (solve_highs(eq).status == "stable")
                seen[said is None] += 1
    assert min(seen[True], seen[False]) >= 50


def test_fast_solvers_agree_where_it_is_close():
    """A box whose centre of mass is d beyond its edge: all agree on both sides of the tolerance."""
    for d, expected in ((-1e-6, "stable"), (5e-8, "stable"), (1e-6, "unstable"), (1e-5, "unstable")):
        eq = build(piles.overhang(d))
        words = {solve(eq).status for solve in (solve_highs, solve_nnls, solve_cvxpy)}
        assert words == {expected}, d


def test_a_pile_without_contacts_falls_and_one_without_items_stands():
    nothing = piles.pile(np.empty((0, 3)), np.ones((0, 3)), [], [], [1.0], [[0, 0, 1.0]])
    none = piles.pile(np.empty((0, 3)), np.ones((0, 3)), [], [], [], np.empty((0, 3)))
    for solve in (solve_highs, solve_nnls, solve_cvxpy):
        assert solve(build(nothing)).status == "unstable"
        assert solve(build(none)).status == "stable"


def test_one_floating_item_is_enough_to_fall():
    box = piles.box_on_floor()
    p = Pile(box.contacts, np.array([1.0, 1.0]), np.vstack([box.coms, [[1, 1, 1]]]), box.gravity)
    for solve in (solve_highs, solve_nnls, solve_cvxpy):
        assert solve(build(p)).status == "unstable"


def test_motion_that_proves_instability_is_a_fall():
    """The proof can be read: no contact resists the motion, and gravity drives it."""
    eq = build(piles.overhang(0.01))
    answer = solve_highs(eq)
    assert answer.status == "unstable"
    assert (eq.work(answer.motion) <= 1e-9).all()
    assert eq.rhs @ answer.motion > 0.0
    assert not eq.refuted_by(np.zeros(6))
    assert not eq.refuted_by(-answer.motion)


def test_forces_that_do_not_balance_are_not_believed():
    eq = build(piles.box_on_floor())
    x = solve_highs(eq).x
    assert eq.balanced(x)
    assert not eq.balanced(1.001 * x)
    assert not eq.balanced(np.full_like(x, np.nan))
    pair = np.flatnonzero(x)[0]
    pushed = x.copy()
    pushed[pair] = -pushed[pair]
    assert not eq.balanced(pushed)


def test_a_failing_solver_is_asked_another_way(monkeypatch):
    """Every run of the first kind fails: the answer still comes, from the next."""
    real = solvers._by_columns
    asked = []

    def fails_once(eq, chosen, options):
        asked.append(options)
        return Solution("undecided", "highs") if len(asked) == 1 else real(eq, chosen, options)

    monkeypatch.setattr(solvers, "_by_columns", fails_once)
    assert solve_highs(build(piles.box_on_floor())).status == "stable"
    assert len(asked) == 2


def undecided(*_):
    return Solution("undecided", "none")


@pytest.mark.parametrize(("dense_rows", "solver"), [(6, "nnls"), (0, "clarabel")])
def test_where_all_of_highs_fails_least_squares_and_then_the_reference_are_asked(
    monkeypatch, dense_rows, solver
):
    monkeypatch.setattr(solvers, "_by_columns", undecided)
    monkeypatch.setattr(solvers, "_DENSE_ROWS", dense_rows)
    for d, expected in ((-0.01, "stable"), (0.01, "unstable")):
        answer = solve_highs(build(piles.overhang(d)))
        assert (answer.status, answer.solver) == (expected, solver)
    monkeypatch.setattr(solvers, "_fit", undecided)
    monkeypatch.setattr(solvers, "solve_clarabel", undecided)
    for d, expected in ((-0.01, "stable"), (0.01, "unstable")):
        answer = solve_highs(build(piles.overhang(d)))
        assert answer.status == expected
        assert answer.solver.startswith("cvxpy")
    monkeypatch.setattr(solvers, "solve_cvxpy", no_cvxpy)
    assert solve_highs(build(piles.overhang(-0.01))).status == "undecided"


def no_cvxpy(eq):
    raise ImportError("cvxpy")


def test_wrench_of_a_rotated_pile_has_the_same_size():
    p = piles.stack_of_boxes(np.random.default_rng(8), 4, 0.05)
    turn = Rotation.from_euler("xyz", [0.3, -0.8, 1.9]).as_matrix()
    forces = np.random.default_rng(9).normal(size=(len(p.contacts), 3))
    q = piles.turned(p, turn, (0.3, -0.1, 0.2))
    a = residuals(p.contacts, forces, p.masses, p.coms, gravity=p.gravity).reshape(-1, 3)
    b = residuals(q.contacts, forces @ turn.T, q.masses, q.coms, gravity=q.gravity).reshape(-1, 3)
    np.testing.assert_allclose(a @ turn.T, b, atol=1e-9)
