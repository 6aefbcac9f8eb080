"""Quaternions against scipy's, and exact right angles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from packenv.geometry.transforms import quaternion_to_rotation, rotation_to_quaternion, yaw_rotation

HALF_TURNS = [np.diag(d) for d in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1], [1, 1, 1])]


@pytest.mark.parametrize("seed", range(200))
def test_quaternions_equal_another_library(seed: int) -> None:
    rotation = Rotation.random(random_state=np.random.default_rng(seed))
    matrix = rotation.as_matrix()
    np.testing.assert_allclose(rotation_to_quaternion(matrix), rotation.as_quat(canonical=True), atol=1e-15)
    np.testing.assert_allclose(quaternion_to_rotation(rotation.as_quat()), matrix, atol=1e-15)


@pytest.mark.parametrize("matrix", HALF_TURNS)
def test_half_turns_come_back(matrix: np.ndarray) -> None:
    back = quaternion_to_rotation(rotation_to_quaternion(matrix.astype(float)))
    np.testing.assert_allclose(back, matrix, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, math.pi / 2, math.pi, 1.5 * math.pi])
def test_right_angles_are_exact(angle: float) -> None:
    assert set(np.abs(yaw_rotation(angle)).ravel()) == {0.0, 1.0}
