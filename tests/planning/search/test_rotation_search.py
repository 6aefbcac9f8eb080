"""Whether an item fits a container at any rotation at all, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from packenv.config import CLEARANCE
from packenv.planning.search.rotation_search import regions_of_fit
from packenv.types import FloatArray, Item
from tests.shapes import ball, box, cylinder


def found(item: Item, size: tuple[float, float, float]) -> FloatArray:
    """What the search gives; each is a rotation, and at each the item is inside."""
    hull = item.vertices[ConvexHull(item.vertices).vertices]
    rotations = regions_of_fit(hull, item.com, size)
    for rotation in rotations:
        assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-9)
        assert np.linalg.det(rotation) > 0
        assert (np.ptp(item.vertices @ rotation.T, axis=0) <= np.add(size, CLEARANCE) + 1e-12).all()
    return rotations


@pytest.mark.parametrize("seed", range(20))
def test_a_rod_fits_as_far_as_the_space_diagonal(seed: int) -> None:
    """A segment fits up to the diagonal; the rod is inside the segment's capsule, and its own diagonal in it."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.1, 0.4, 3)
    side = rng.uniform(0.003, 0.02)
    turned = Rotation.random(rng=seed).as_matrix()
    for length, fits in (
        (np.linalg.norm(size - side * np.sqrt(2)) - 1e-3, True),
        (np.sqrt(np.sum(size**2) - 2 * side**2) + 3e-4, False),
    ):
        rod = box(length, side, side, "rod")
        rod = replace(rod, vertices=rod.vertices @ turned.T, com=turned @ rod.com)
        assert bool(len(found(rod, tuple(size)))) == fits


@pytest.mark.parametrize("seed", range(30))
def test_between_floor_and_lid_a_rectangle_must_fit_a_rectangle(seed: int) -> None:
    """Carver: p × q fits P × Q (p > P, q ≤ Q) where ((P+Q)/(p+q))² + ((P-Q)/(p-q))² ≥ 2."""
    rng = np.random.default_rng(seed)
    thick, (large, small) = 0.05, np.sort(rng.uniform(0.1, 0.4, 2))[::-1]
    long, wide = large * rng.uniform(1.005, 1.2), max(0.06, small * rng.uniform(0.1, 0.6))

    def fits(spare: float) -> bool:
        a, b = large - spare, small - spare
        return wide <= b and ((a + b) / (long + wide)) ** 2 + ((a - b) / (long - wide)) ** 2 >= 2

    rotations = found(box(long, wide, thick, "plank"), (large, small, thick))
    if fits(1e-3):
        assert len(rotations)
    if not fits(-3e-4):
        assert not len(rotations)


@pytest.mark.parametrize(("share", "fits"), [(1.05, True), (1.0, True), (1.063, False), (1.4, False)])
def test_a_square_plate_fits_a_cube_up_to_three_quarters_of_its_faces_diagonal(
    share: float, fits: bool
) -> None:
    """Prince Rupert's square: 3 √2 / 4 = 1.0607 times the cube's side."""
    plate = box(0.3 * share, 0.3 * share, 0.001, "plate")
    assert bool(len(found(plate, (0.3, 0.3, 0.3)))) == fits


def test_round_items_fit_by_their_width() -> None:
    round_ = ball(0.05)
    assert len(found(round_, (0.102, 0.102, 0.102)))
    assert not len(found(round_, (0.102, 0.102, 0.097)))
    can = cylinder(0.03, 0.1)
    assert not len(found(can, (0.2, 0.2, 0.055)))


@pytest.mark.parametrize("size", [(0.32, 0.32, 0.30), (0.30, 0.10, 0.30), (0.25, 0.35, 0.28)])
def test_gravity_takes_a_leaning_rod_to_the_walls(size: tuple[float, float, float]) -> None:
    """Given first is where the centre of mass is lowest: both ends in corners, at the walls on all four sides."""
    rod = box(0.85 * float(np.linalg.norm(size)), 0.012, 0.012, "rod")
    hull = rod.vertices
    rotations = found(rod, size)
    extents = np.array([np.ptp(hull @ rotation.T, axis=0) for rotation in rotations])
    heights = np.array([rotation[2] @ rod.com - (hull @ rotation[2]).min() for rotation in rotations])
    lowest = extents[heights <= heights.min() + 5e-4]
    assert np.subtract(size[:2], lowest[:, :2]) == pytest.approx(0.0, abs=3e-4)
    room = (np.array(size) - extents).min(axis=1)
    assert room.max() > 2e-3  # and one leaves the robot some room
    directions = {
        tuple(np.sign(rotation[:, 0] * np.sign(rotation[2, 0])).astype(int)) for rotation in rotations
    }
    assert len(directions) == 4  # on each of the four space diagonals
