"""The roll and pitch grid of the fallback: Euler angles, what is in it, what is in it once only."""

from __future__ import annotations

import dataclasses
import gc
import math

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.spatial.transform import Rotation

from packenv.config import GridConfig
from packenv.geometry.prepare import PreparedItem, prepare_item
from packenv.planning.search import orientations
from packenv.planning.search.orientations import PERTURBATION, OrientationMemory, euler_zyx, perturbations
from packenv.types import FloatArray, Item, StablePose
from tests.shapes import box, cup, cylinder

GRID = GridConfig(cell_size=0.005, n_yaws=2)
ROOM = (1.0, 1.0, 1.0)
"""A container into which everything fits in every orientation."""

N = 8
"""Steps of Δr in a full turn."""

ANGLE = st.floats(-math.pi, math.pi)


def compose(gamma: float, phi: float, psi: float) -> FloatArray:
    """R_z(γ) R_y(φ) R_x(ψ), by another library."""
    return (
        Rotation.from_euler("z", gamma) * Rotation.from_euler("y", phi) * Rotation.from_euler("x", psi)
    ).as_matrix()


def turned(item: Item, seed: int) -> Item:
    """The same item in a mesh file with other axes."""
    turn = Rotation.random(random_state=np.random.default_rng(seed)).as_matrix()
    return dataclasses.replace(item, vertices=item.vertices @ turn.T, com=turn @ item.com)


ITEMS = {
    item.name: item
    for item in (
        box(0.05, 0.04, 0.03, "brick"),
        dataclasses.replace(turned(box(0.05, 0.04, 0.03), 1), name="turned brick"),
        cylinder(0.02, 0.05, sections=16),
        dataclasses.replace(turned(cup(0.03, 0.05), 2), name="turned cup"),
    )
}


@pytest.fixture(scope="module")
def prepared() -> dict[str, PreparedItem]:
    return {name: prepare_item(item, GRID) for name, item in ITEMS.items()}


# ----------------------------------------------------------------------------------------- Euler angles


@given(ANGLE, ANGLE, ANGLE)
def test_composing_the_angles_gives_the_rotation(gamma: float, phi: float, psi: float) -> None:
    assume(abs(math.cos(phi)) > 1e-6)  # the poles have tests of their own
    rotation = compose(gamma, phi, psi)
    np.testing.assert_allclose(compose(*euler_zyx(rotation)), rotation, atol=1e-7)


@given(ANGLE, st.floats(-math.pi / 2 + 1e-3, math.pi / 2 - 1e-3), ANGLE)
def test_the_angles_of_a_composition_are_its_own(gamma: float, phi: float, psi: float) -> None:
    """Off the poles the angles are unique, γ and ψ up to a full turn."""
    found = euler_zyx(compose(gamma, phi, psi))
    np.testing.assert_allclose(
        np.exp(1j * np.array(found)), np.exp(1j * np.array([gamma, phi, psi])), atol=1e-9
    )


@pytest.mark.parametrize("down", [-1.0, 1.0])
def test_exact_poles(down: float) -> None:
    for gamma in np.linspace(-3.0, 3.0, 13):
        c, s = math.cos(gamma), math.sin(gamma)
        rotation = np.array([[0.0, -s, -down * c], [0.0, c, -down * s], [down, 0.0, 0.0]])
        np.testing.assert_allclose(compose(*euler_zyx(rotation)), rotation, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_poles_with_the_rounding_of_a_product(seed: int) -> None:
    """What a stable pose of an axis-aligned box is, up to the last bit."""
    rng = np.random.default_rng(seed)
    for _ in range(500):
        gamma, psi = rng.uniform(-math.pi, math.pi, 2)
        rotation = compose(gamma, rng.choice([-1, 1]) * math.pi / 2, psi)
        np.testing.assert_allclose(compose(*euler_zyx(rotation)), rotation, atol=1e-9)


# --------------------------------------------------------------------------------------- perturbed poses


@pytest.mark.parametrize("name", ITEMS)
def test_the_first_group_is_the_unperturbed_orientations(
    name: str, prepared: dict[str, PreparedItem]
) -> None:
    """Alg. 4 begins with t_r = t_p = 0: same sequence, same maps."""
    item = prepared[name]
    first = next(perturbations(ITEMS[name], item.poses, GRID, ROOM))
    assert len(first) == len(item.orientations) > 0
    for ours, stable in zip(first, item.orientations, strict=True):
        np.testing.assert_allclose(ours.rotation, stable.rotation, rtol=0, atol=1e-9)
        assert (ours.pose_index, ours.yaw, ours.item) == (stable.pose_index, stable.yaw, name)
        np.testing.assert_allclose(ours.extents, stable.extents, rtol=0, atol=1e-9)
        assert ours.top.shape == stable.top.shape
        both = ours.footprint & stable.footprint
        np.testing.assert_allclose(ours.top[both], stable.top[both], rtol=0, atol=1e-5)


@pytest.mark.parametrize("name", ITEMS)
def test_the_grid_is_that_of_alg_4_and_has_no_rotation_twice(
    name: str, prepared: dict[str, PreparedItem]
) -> None:
    """Every R_z(θ + γ) R_y(φ + t_r) R_x(ψ + t_p) is there, nothing else is, and each is there once."""
    poses = prepared[name].poses
    angles = [euler_zyx(pose.rotation) for pose in poses]
    wanted = np.array(
        [
            compose(gamma + k * math.pi / GRID.n_yaws, phi + roll * PERTURBATION, psi + pitch * PERTURBATION)
            for gamma, phi, psi in angles
            for roll in range(N)
            for pitch in range(N)
            for k in range(GRID.n_yaws)
        ]
    )
    groups = list(perturbations(ITEMS[name], poses, GRID, ROOM))
    found = np.array([oriented.rotation for group in groups for oriented in group])
    assert len(groups) == N * N
    assert len(poses) * GRID.n_yaws <= len(found) <= len(wanted)
    assert _largest_angle_to_nearest(wanted, found) < 1e-5
    assert _largest_angle_to_nearest(found, wanted) < 1e-5
    among = np.einsum("aij,bij->ab", found, found)
    np.fill_diagonal(among, -1.0)
    # The trace of Rᵃᵀ Rᵇ is 3 where they are equal; two rotations of 1e-4 rad difference have 3 - 1e-8.
    assert among.max() < 3.0 - 1e-8


@pytest.mark.parametrize("name", ITEMS)
def test_a_group_has_one_roll_and_pitch_offset(name: str, prepared: dict[str, PreparedItem]) -> None:
    """Groups come with the roll offset outside, the pitch offset inside, as Alg. 4 loops."""
    poses = prepared[name].poses
    angles = [euler_zyx(pose.rotation) for pose in poses]
    grid = np.array(
        [
            [
                [
                    compose(
                        gamma + k * math.pi / GRID.n_yaws,
                        phi + roll * PERTURBATION,
                        psi + pitch * PERTURBATION,
                    )
                    for k in range(GRID.n_yaws)
                ]
                for gamma, phi, psi in angles
            ]
            for roll in range(N)
            for pitch in range(N)
        ]
    )
    last = -1
    for group in perturbations(ITEMS[name], poses, GRID, ROOM):
        fits = np.ones(N * N, dtype=bool)
        for oriented in group:
            same = grid[:, oriented.pose_index, round(oriented.yaw / (math.pi / GRID.n_yaws))]
            fits &= np.abs(same - oriented.rotation).max(axis=(1, 2)) < 1e-9
        if not group:
            continue
        assert fits.any()
        assert int(np.argmax(fits)) > last
        last = int(np.argmax(fits))


@pytest.mark.parametrize("size", [(0.05, 0.05, 0.05), (0.2, 0.04, 0.2), (0.04, 0.05, 0.03), (0.01, 0.2, 0.2)])
@pytest.mark.parametrize("name", ITEMS)
def test_what_does_not_fit_the_container_is_left_out(
    name: str, size: tuple[float, float, float], prepared: dict[str, PreparedItem]
) -> None:
    """That and nothing else, offset by offset."""
    poses = prepared[name].poses
    everywhere = list(perturbations(ITEMS[name], poses, GRID, ROOM))
    fitting = list(perturbations(ITEMS[name], poses, GRID, size))
    assert len(fitting) == len(everywhere)
    for some, group in zip(fitting, everywhere, strict=True):
        wanted = [o for o in group if np.all(o.extents <= np.add(size, 1e-8))]
        assert [o.rotation.tolist() for o in some] == [o.rotation.tolist() for o in wanted]


def test_a_rotation_of_two_poses_is_there_once() -> None:
    item = ITEMS["brick"]
    pose = StablePose(np.eye(3), 0.5, 0.015)
    alone = sum(len(g) for g in perturbations(item, [pose], GRID, ROOM))
    twice = sum(len(g) for g in perturbations(item, [pose, pose], GRID, ROOM))
    assert alone == twice


def test_maps_are_those_of_the_rotation(prepared: dict[str, PreparedItem]) -> None:
    item = ITEMS["turned brick"]
    for group in perturbations(item, prepared["turned brick"].poses[:1], GRID, ROOM):
        for oriented in group:
            placed = item.vertices @ oriented.rotation.T + oriented.offset
            np.testing.assert_allclose(placed.min(axis=0), 0.0, atol=1e-12)
            np.testing.assert_allclose(placed.max(axis=0), oriented.extents, atol=1e-12)
            assert oriented.height == pytest.approx(oriented.extents[2], abs=2e-6)


def _largest_angle_to_nearest(rotations: FloatArray, others: FloatArray) -> float:
    """How far the loneliest of ``rotations`` is from the nearest of ``others``, rad."""
    traces = np.einsum("aij,bij->ab", rotations, others).max(axis=1)
    worst = int(np.argmin(traces))
    nearest = int(np.argmax(np.einsum("ij,bij->b", rotations[worst], others)))
    return float(Rotation.from_matrix(rotations[worst].T @ others[nearest]).magnitude())


# ------------------------------------------------------------------------------- maps that are remembered


def _all(item: Item, poses: tuple[StablePose, ...], size: tuple[float, float, float] = ROOM) -> list:
    return [oriented for group in perturbations(item, poses, GRID, size) for oriented in group]


def _assert_same(found: list, wanted: list) -> None:
    assert len(found) == len(wanted)
    for one, other in zip(found, wanted, strict=True):
        assert (one.item, one.pose_index, one.yaw) == (other.item, other.pose_index, other.yaw)
        for name in ("rotation", "offset", "extents", "com", "top", "bottom"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("budget", [0, 20_000, 2**30])
@pytest.mark.parametrize("name", ITEMS)
def test_memory_changes_nothing(
    name: str, budget: int, prepared: dict[str, PreparedItem], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever was asked before, of this item or another, in this container or another."""
    item, poses = ITEMS[name], prepared[name].poses
    monkeypatch.setattr(orientations, "RECENT", OrientationMemory(0))
    small = (0.2, 0.04, 0.2)
    wanted = [_all(item, poses), _all(item, poses, small), _all(item, poses[:1])]
    monkeypatch.setattr(orientations, "RECENT", OrientationMemory(budget))
    for _ in range(2):
        _assert_same(_all(item, poses, small), wanted[1])
        _all(ITEMS["brick"], prepared["brick"].poses[:1])
        _assert_same(_all(item, poses[:1]), wanted[2])
        _assert_same(_all(item, poses), wanted[0])


def test_memory_keeps_to_its_budget_and_forgets_what_was_used_longest_ago(
    prepared: dict[str, PreparedItem], monkeypatch: pytest.MonkeyPatch
) -> None:
    brick, can, cup_ = ITEMS["brick"], ITEMS["can"], ITEMS["turned cup"]
    need = {}
    for item in (brick, can, cup_):
        memory = OrientationMemory(2**30)
        monkeypatch.setattr(orientations, "RECENT", memory)
        maps = _all(item, prepared[item.name].poses)
        need[item.name] = memory.bytes
        assert memory.bytes == sum(o.top.nbytes + o.bottom.nbytes for o in maps)
    memory = OrientationMemory(sum(need.values()) - 1)
    monkeypatch.setattr(orientations, "RECENT", memory)
    first = {item.name: _all(item, prepared[item.name].poses) for item in (brick, can, brick, cup_)}
    assert memory.bytes == need["brick"] + need["turned cup"]
    again = _all(brick, prepared["brick"].poses)
    assert all(a is b for a, b in zip(again, first["brick"], strict=True))
    again = _all(can, prepared["can"].poses)
    assert not any(a is b for a, b in zip(again, first["can"], strict=True))
    assert memory.bytes <= memory.budget


def test_two_items_of_one_mesh_hash_are_not_mixed_up(prepared: dict[str, PreparedItem]) -> None:
    """``turned`` keeps the hash of the mesh that it turns."""
    poses = prepared["brick"].poses[:1]
    other = dataclasses.replace(turned(ITEMS["brick"], 7), name="other")
    assert other.sha256 == ITEMS["brick"].sha256
    _all(ITEMS["brick"], poses)
    for oriented in _all(other, poses):
        np.testing.assert_allclose(
            oriented.extents, np.ptp(other.vertices @ oriented.rotation.T, axis=0), atol=1e-12
        )


def test_an_item_that_is_gone_takes_its_maps_along(
    prepared: dict[str, PreparedItem], monkeypatch: pytest.MonkeyPatch
) -> None:
    memory = OrientationMemory(2**30)
    monkeypatch.setattr(orientations, "RECENT", memory)
    item = dataclasses.replace(ITEMS["brick"])
    _all(item, prepared["brick"].poses)
    assert memory.bytes > 0
    del item
    gc.collect()
    assert memory.bytes == 0
