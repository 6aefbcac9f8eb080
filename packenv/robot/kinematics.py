"""Compiled closed-form kinematics of the TX90: kernels over arrays, no checks.

The arm has an ortho-parallel basis and a spherical wrist, so its inverse kinematics is closed (Pieper 1968;
Brandstötter et al. 2014, whose numbering of branches is kept). With the wrist centre p = flange - FLANGE · z:

- joint 1 turns p into the plane y = LATERAL_OFFSET of link 1: two *shoulder* branches;
- in that plane the two arm segments and the distance to p form a triangle: two *elbow* branches;
- what orientation is left is Rz(q4) Ry(q5) Rz(q6): two *wrist* branches, (q4, q5, q6) and
  (q4 + π, -q5, q6 + π).

Slot = 4 · wrist + 2 · shoulder + elbow, where wrist 0 has q5 ≥ 0, shoulder 0 reaches forward (x ≥ 0 in link
1), elbow 0 has q3 ≥ 0.

q5 and q6 are computed from the orientation that is left once q4 is fixed, never from the small numbers that
give q4: the error of q4 near the wrist's singularity is thereby taken back, and the pose is met to rounding
everywhere. Where sin q5 is below ``WRIST_TOLERANCE`` only q4 + q6 matters, and q4 is 0.
"""

from __future__ import annotations

from math import acos, atan2, cos, pi, sin, sqrt

import numpy as np
from numba import njit

from packenv.robot.tx90_data import (
    BASE_HEIGHT,
    FLANGE,
    FOREARM,
    LATERAL_OFFSET,
    LOWER,
    SHOULDER_OFFSET,
    UPPER,
    UPPER_ARM,
)

REACH_TOLERANCE = 1e-10
"""A wrist centre that is out of reach by less than this is taken to be on the border, m."""
WRIST_TOLERANCE = 1e-9
"""sin q5 below this is the wrist's singularity: joints 4 and 6 are in line."""
LIMIT_TOLERANCE = 1e-9
"""Rounding that the joint limits forgive, rad."""
_TURN = 2.0 * pi


@njit(cache=True, nogil=True)
def link_frames(q, frames):  # type: ignore[no-untyped-def]
    """Frames of the base and of links 1 to 6 in the base frame.

    Args:
        q: (n, 6) rad.
        frames: (n, 7, 4, 4), overwritten; the last is the flange.
    """
    for k in range(q.shape[0]):
        out = frames[k]
        out[:] = 0.0
        for i in range(7):
            out[i, 3, 3] = 1.0
        for i in range(3):
            out[0, i, i] = 1.0
        _turn_z(out[0], 0.0, 0.0, BASE_HEIGHT, q[k, 0], out[1])
        _turn_y(out[1], SHOULDER_OFFSET, 0.0, 0.0, q[k, 1], out[2])
        _turn_y(out[2], 0.0, LATERAL_OFFSET, UPPER_ARM, q[k, 2], out[3])
        _turn_z(out[3], 0.0, 0.0, 0.0, q[k, 3], out[4])
        _turn_y(out[4], 0.0, 0.0, FOREARM, q[k, 4], out[5])
        _turn_z(out[5], 0.0, 0.0, FLANGE, q[k, 5], out[6])


@njit(cache=True, nogil=True)
def _turn_z(parent, x, y, z, angle, child):  # type: ignore[no-untyped-def]
    c, s = cos(angle), sin(angle)
    for i in range(3):
        child[i, 0] = c * parent[i, 0] + s * parent[i, 1]
        child[i, 1] = c * parent[i, 1] - s * parent[i, 0]
        child[i, 2] = parent[i, 2]
        child[i, 3] = parent[i, 0] * x + parent[i, 1] * y + parent[i, 2] * z + parent[i, 3]


@njit(cache=True, nogil=True)
def _turn_y(parent, x, y, z, angle, child):  # type: ignore[no-untyped-def]
    c, s = cos(angle), sin(angle)
    for i in range(3):
        child[i, 0] = c * parent[i, 0] - s * parent[i, 2]
        child[i, 1] = parent[i, 1]
        child[i, 2] = c * parent[i, 2] + s * parent[i, 0]
        child[i, 3] = parent[i, 0] * x + parent[i, 1] * y + parent[i, 2] * z + parent[i, 3]


@njit(cache=True, nogil=True)
def wrapped(angle):  # type: ignore[no-untyped-def]
    """The same angle within [-π, π]."""
    return angle - _TURN * np.rint(angle / _TURN)


@njit(cache=True, nogil=True)
def branches(pose, q):  # type: ignore[no-untyped-def]
    """All branches of one flange pose, whatever the limits.

    Args:
        pose: (4, 4) flange in the base frame.
        q: (8, 6), overwritten: rad within [-π, π], NaN where the branch does not exist.
    """
    q[:] = np.nan
    px = pose[0, 3] - FLANGE * pose[0, 2]
    py = pose[1, 3] - FLANGE * pose[1, 2]
    w = pose[2, 3] - FLANGE * pose[2, 2] - BASE_HEIGHT
    # The radius is compared before it is squared: squares lose the tolerance near the border.
    radius = sqrt(px * px + py * py)
    if radius < LATERAL_OFFSET - REACH_TOLERANCE:
        return
    along = sqrt(max(0.0, (radius - LATERAL_OFFSET) * (radius + LATERAL_OFFSET)))
    for shoulder in range(2):
        x = along if shoulder == 0 else -along
        q1 = wrapped(atan2(py, px) - atan2(LATERAL_OFFSET, x))
        c1, s1 = cos(q1), sin(q1)
        u = x - SHOULDER_OFFSET
        distance = sqrt(u * u + w * w)
        longest, shortest = UPPER_ARM + FOREARM, abs(UPPER_ARM - FOREARM)
        if not shortest - REACH_TOLERANCE <= distance <= longest + REACH_TOLERANCE:
            continue
        cosine = (distance**2 - UPPER_ARM**2 - FOREARM**2) / (2.0 * UPPER_ARM * FOREARM)
        bend = acos(min(1.0, max(-1.0, cosine)))
        for elbow in range(2):
            q3 = bend if elbow == 0 else -bend
            q2 = wrapped(atan2(u, w) - atan2(FOREARM * sin(q3), UPPER_ARM + FOREARM * cos(q3)))
            c23, s23 = cos(q2 + q3), sin(q2 + q3)
            # Rows 0 to 2 of (Rz(q1) Ry(q2 + q3))ᵀ, times the columns of the pose's rotation.
            r0 = np.empty(3)
            r1 = np.empty(3)
            r22 = 0.0
            for j in range(3):
                ahead = c1 * pose[0, j] + s1 * pose[1, j]
                r0[j] = c23 * ahead - s23 * pose[2, j]
                r1[j] = c1 * pose[1, j] - s1 * pose[0, j]
                if j == 2:
                    r22 = s23 * ahead + c23 * pose[2, j]
            singular = sqrt(r0[2] * r0[2] + r1[2] * r1[2]) < WRIST_TOLERANCE
            for wrist in range(2):
                q4 = 0.0 if singular else atan2(r1[2], r0[2])
                if wrist == 1:
                    q4 = wrapped(q4 + pi)
                c4, s4 = cos(q4), sin(q4)
                slot = 4 * wrist + 2 * shoulder + elbow
                q[slot, 0] = q1
                q[slot, 1] = q2
                q[slot, 2] = q3
                q[slot, 3] = q4
                q[slot, 4] = atan2(c4 * r0[2] + s4 * r1[2], r22)
                q[slot, 5] = atan2(c4 * r1[0] - s4 * r0[0], c4 * r1[1] - s4 * r0[1])


@njit(cache=True, nogil=True)
def into_limits(q):  # type: ignore[no-untyped-def]
    """Move every joint by whole turns into its limits, nearest to 0, where that is possible.

    Args:
        q: (6,) rad, changed in place.

    Returns:
        True where all joints are within their limits.
    """
    inside = True
    for j in range(6):
        value = wrapped(q[j])
        best = np.inf
        for turn in range(-1, 2):
            turned = value + turn * _TURN
            fits = LOWER[j] - LIMIT_TOLERANCE <= turned <= UPPER[j] + LIMIT_TOLERANCE
            if fits and abs(turned) < abs(best):
                best = turned
        if best == np.inf:
            inside = False
            q[j] = value
        else:
            q[j] = best
    return inside


@njit(cache=True, nogil=True)
def inverse(poses, q, valid):  # type: ignore[no-untyped-def]
    """All branches of many flange poses, moved into the limits where possible.

    Args:
        poses: (m, 4, 4).
        q: (m, 8, 6), overwritten; NaN where the branch does not exist.
        valid: (m, 8) bool, overwritten: the branch exists within the limits.
    """
    for k in range(poses.shape[0]):
        branches(poses[k], q[k])
        for slot in range(8):
            valid[k, slot] = False
            if not np.isnan(q[k, slot, 0]):
                valid[k, slot] = into_limits(q[k, slot])


@njit(cache=True, nogil=True)
def _step(before, after, bound):  # type: ignore[no-untyped-def]
    """Largest joint step, turns left aside; infinite as soon as it passes the bound.

    At the wrist's singularity q4 stays and q6 makes up for it: ``after`` is changed.
    """
    if abs(after[4]) < WRIST_TOLERANCE:
        after[5] = after[3] + after[5] - before[3]
        after[3] = before[3]
    largest = 0.0
    for j in range(6):
        step = abs(wrapped(after[j] - before[j]))
        if step > bound:
            return np.inf
        largest = max(largest, step)
    return largest


@njit(cache=True, nogil=True)
def _rigid_limits(q):  # type: ignore[no-untyped-def]
    """Whether joints 2, 3 and 5, which no whole turn can save, are within their limits."""
    inside = True
    for j in (1, 2, 4):
        inside = inside and LOWER[j] - LIMIT_TOLERANCE <= q[j] <= UPPER[j] + LIMIT_TOLERANCE
    return inside


@njit(cache=True, nogil=True)
def follow(path, max_step, q, state):  # type: ignore[no-untyped-def]
    """Continue every branch of the first pose along a path.

    A branch keeps its slot while its joints step by no more than ``max_step``; else it goes on in the slot
    that is nearest. So a path may run through the wrist's singularity, where the slot changes and the joints
    do not jump. Whole turns are chosen last, for the path as a whole: a joint that may turn by 540° is
    unwrapped and then moved to where all of it fits.

    Args:
        path: (m, 4, 4), m ≥ 1.
        max_step: largest step of any joint between two poses, rad.
        q: (8, m, 6), overwritten where ``state`` is 0.
        state: (8,) int8, overwritten: 0 continuous and within the limits, 1 out of reach or a jump, 2
            leaves the limits.
    """
    m = path.shape[0]
    every = np.empty((m, 8, 6))
    for k in range(m):
        branches(path[k], every[k])
    trial = np.empty(6)
    for start in range(8):
        state[start] = 1
        if np.isnan(every[0, start, 0]):
            continue
        line = q[start]
        line[0] = every[0, start]
        if abs(line[0, 4]) < WRIST_TOLERANCE:
            # The first pose leaves q4 free: take what the first pose outside the singularity asks for.
            for k in range(1, m):
                later = every[k, start]
                if abs(later[4]) >= WRIST_TOLERANCE:
                    line[0, 5] = line[0, 3] + line[0, 5] - later[3]
                    line[0, 3] = later[3]
                    break
        state[start] = 0 if _rigid_limits(line[0]) else 2
        slot = start
        for k in range(1, m):
            if state[start] != 0:
                break
            before = line[k - 1]
            nearest = np.inf
            if not np.isnan(every[k, slot, 0]):
                trial[:] = every[k, slot]
                nearest = _step(before, trial, max_step)
            if nearest == np.inf:
                for other in range(8):
                    if np.isnan(every[k, other, 0]):
                        continue
                    trial[:] = every[k, other]
                    step = _step(before, trial, max_step)
                    if step < nearest:
                        nearest = step
                        slot = other
                if nearest == np.inf:
                    state[start] = 1
                    break
                trial[:] = every[k, slot]
                _step(before, trial, max_step)
            for j in range(6):
                line[k, j] = before[j] + wrapped(trial[j] - before[j])
            if not _rigid_limits(line[k]):
                state[start] = 2
        if state[start] == 0 and not _turn_path(line):
            state[start] = 2


@njit(cache=True, nogil=True)
def _turn_path(line):  # type: ignore[no-untyped-def]
    """Move each joint's whole line by the whole turns that bring it into its limits, nearest to 0."""
    for j in range(6):
        low, high = line[0, j], line[0, j]
        for k in range(1, line.shape[0]):
            low = min(low, line[k, j])
            high = max(high, line[k, j])
        nearest = -_TURN * np.rint((low + high) / 2.0 / _TURN)
        found = False
        for turn in (0.0, -_TURN, _TURN):
            shift = nearest + turn
            if low + shift >= LOWER[j] - LIMIT_TOLERANCE and high + shift <= UPPER[j] + LIMIT_TOLERANCE:
                found = True
                for k in range(line.shape[0]):
                    line[k, j] += shift
                break
        if not found:
            return False
    return True
