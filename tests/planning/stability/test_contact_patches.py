"""Which contacts can touch together: laws, a reference without shortcuts, balls and boxes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contact_patches import HULL, ROCKING, TOUCHING, thin, tighten
from packenv.planning.stability.margins import measure_margin
from packenv.types import Contacts

THRESHOLD = 1.5e-3


def contacts(points, normals, gaps, first=0, second=1) -> Contacts:
    n = len(points)
    return Contacts(
        np.asarray(points, float),
        np.broadcast_to(np.asarray(normals, float), (n, 3)).copy(),
        np.broadcast_to(np.asarray(first, np.int64), n).copy(),
        np.broadcast_to(np.asarray(second, np.int64), n).copy(),
        np.asarray(gaps, float),
    )


def scattered(seed: int, n: int = 150) -> Contacts:
    """Contacts of three bodies all around them, on bumpy ground."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.05, 0.05, (n, 3))
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    gaps = THRESHOLD * rng.random(n) ** 2
    first = rng.integers(0, 2, n)
    return contacts(points, normals, gaps, first, first + 1 + rng.integers(0, 2, n))


def reference(c: Contacts, slack: float, rocking: float) -> np.ndarray:
    """Every contact against every other."""
    keep = np.ones(len(c), bool)
    axis = np.abs(c.normals).argmax(axis=1)
    for i in range(len(c)):
        for j in range(len(c)):
            same = (
                c.first[i] == c.first[j]
                and c.second[i] == c.second[j]
                and axis[i] == axis[j]
                and (c.normals[i, axis[i]] > 0) == (c.normals[j, axis[j]] > 0)
            )
            reach = slack + rocking * np.linalg.norm(c.points[i] - c.points[j])
            keep[i] &= not (same and c.gaps[i] - c.gaps[j] > reach)
    return keep


def under_ball(radius: float) -> tuple[Contacts, float]:
    """The floor under a ball, every half millimetre up to the threshold, and the ball's height of centre."""
    xy = np.stack(np.meshgrid(*[np.arange(-0.02, 0.0201, 0.0005)] * 2), axis=-1).reshape(-1, 2)
    r2 = (xy**2).sum(axis=1)
    xy, r2 = xy[r2 < 0.99 * radius**2], r2[r2 < 0.99 * radius**2]
    gaps = radius - np.sqrt(radius**2 - r2)
    near = gaps <= THRESHOLD
    points = np.column_stack([xy[near], np.zeros(near.sum())])
    return contacts(points, [0, 0, 1], gaps[near]), radius


@pytest.mark.parametrize(("slack", "rocking"), [(TOUCHING, ROCKING), (0.0, 0.01), (2e-4, 0.0)])
def test_kept_are_those_that_no_other_excludes(slack, rocking):
    dropped = 0
    for seed in range(6):
        c = scattered(seed)
        keep = reference(c, slack, rocking)
        np.testing.assert_array_equal(tighten(c, slack=slack, rocking=rocking).points, c.points[keep])
        dropped += int((~keep).sum())
    assert dropped >= 50


def test_sequence_of_contacts_changes_nothing():
    c = scattered(7)
    mixed = c.take(np.random.default_rng(0).permutation(len(c)))
    names = {tuple(p) for p in tighten(c).points}
    assert names == {tuple(p) for p in tighten(mixed).points}
    assert 0 < len(names) < len(c)


def test_more_slack_and_more_rocking_keep_more():
    c = scattered(8)
    kept = [
        {tuple(p) for p in tighten(c, slack=slack, rocking=rocking).points}
        for slack, rocking in ((0.0, 0.0), (5e-5, 0.0), (5e-5, 0.02), (2e-4, 0.02), (2e-4, 0.1))
    ]
    assert all(less <= more for less, more in itertools.pairwise(kept))
    assert len(kept[0]) < len(kept[2]) < len(kept[-1])


def test_tightening_twice_is_tightening_once():
    once = tighten(scattered(9))
    np.testing.assert_array_equal(tighten(once).points, once.points)


def test_every_pair_and_side_keeps_its_nearest():
    c = scattered(10)
    kept = {tuple(p) for p in tighten(c, slack=0.0, rocking=0.0).points}
    axis = np.abs(c.normals).argmax(axis=1)
    sides = np.column_stack([c.first, c.second, axis, c.normals[np.arange(len(c)), axis] > 0])
    for side in np.unique(sides, axis=0):
        of_side = np.flatnonzero((sides == side).all(axis=1))
        assert tuple(c.points[of_side[np.argmin(c.gaps[of_side])]]) in kept


@pytest.mark.parametrize("radius", [0.015, 0.02, 0.035, 0.06, 0.12])
def test_a_ball_of_any_size_stands_on_a_foot_that_a_margin_overturns(radius):
    """On a foot of radius ρ a ball of radius r overturns at atan(ρ / r), and ρ is little more than 2 κ r.

    Contacts within the threshold alone carry a small ball past 20°.
    """
    floor, height = under_ball(radius)
    com = [[0.0, 0.0, height]]
    tilt = measure_margin(StabilityChecker(), tighten(floor), [0.2], com).tilt_deg
    widest = ROCKING * radius + np.sqrt((ROCKING * radius) ** 2 + 2 * radius * TOUCHING)
    assert tilt <= np.degrees(np.arctan(widest / radius)) + 0.01
    assert tilt < 8.0
    assert measure_margin(StabilityChecker(), floor, [0.2], com).tilt_deg > 1.5 * tilt


def test_a_box_on_uneven_ground_keeps_its_corners():
    """One corner 0.8 mm farther than the others: it rocks by half a degree and touches."""
    corners = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]]
    assert len(tighten(contacts(corners, [0, 0, 1], [0.0, 1e-4, 2e-4, 8e-4]))) == 4


def test_a_face_parallel_to_the_ground_keeps_all_of_itself():
    xy = np.stack(np.meshgrid(*[np.linspace(0, 0.1, 11)] * 2), axis=-1).reshape(-1, 2)
    face = np.column_stack([xy, np.zeros(len(xy))])
    assert len(tighten(contacts(face, [0, 0, 1], np.full(len(face), 5e-4)))) == len(face)


def test_a_slope_steeper_than_rocking_touches_at_its_edge():
    x = np.linspace(0.0, 0.1, 51)
    points = np.column_stack([x, 0 * x, 0 * x])
    steep, gentle = (tighten(contacts(points, [0, 0, 1], k * ROCKING * x)) for k in (1.5, 0.9))
    # Beyond the edge only what the slack reaches: 0.5 κ x <= slack.
    assert steep.points[:, 0].max() <= TOUCHING / (0.5 * ROCKING) + 1e-9
    assert len(gentle) == len(points)


def test_nothing_is_tightened_to_nothing():
    assert len(tighten(contacts(np.empty((0, 3)), [0, 0, 1], []))) == 0


def test_a_small_thick_patch_whose_farthest_points_lie_one_above_the_other_keeps_its_rim():
    angles = np.arange(12) * np.pi / 6
    rim = 0.38e-3 * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    points = np.vstack([rim, [[5e-5, 0.0, -7e-4], [-5e-5, 0.0, 7e-4]]])
    every = contacts(points, [0, 0, 1], np.zeros(len(points)))
    kept = thin(every)
    sides = np.column_stack([np.cos(angles), np.sin(angles)])
    all_ways, kept_ways = every.points[:, :2] @ sides.T, kept.points[:, :2] @ sides.T
    assert (all_ways.max(axis=0) - kept_ways.max(axis=0) <= HULL).all()
    assert len(kept) > 2
