"""Compiled closed-form kinematics of six-axis arms: kernels over arrays, no checks.

The arms have an ortho-parallel basis and a spherical wrist, so their inverse kinematics is closed (Pieper 1968;
Brandstötter et al. 2014, whose seven lengths a1, a2, b, c1 to c4 and whose numbering of branches are kept).
All angles here are *model angles* θ: all are 0 where the arm stands straight up, every axis turns the way its
letter says (z, y, y, z, y, z), and :mod:`packenv.robot.opw` makes an arm's own joint angles of them. With the
wrist centre p = flange - c4 · z:

- joint 1 turns p into the plane y = b of link 1: two *shoulder* branches;
- in that plane the upper arm (c2), the line from elbow to wrist centre (length √(a2² + c3²), turned by
  ψ = atan2(a2, c3) from the forearm's axis) and the distance to p form a triangle: two *elbow* branches;
- what orientation is left is Rz(θ4) Ry(θ5) Rz(θ6): two *wrist* branches, (θ4, θ5, θ6) and
  (θ4 + π, -θ5, θ6 + π).

Slot = 4 · wrist + 2 · shoulder + elbow, where wrist 0 has θ5 ≥ 0, shoulder 0 reaches forward (x ≥ 0 in link
1), elbow 0 has θ3 + ψ ≥ 0.

θ5 and θ6 are computed from the orientation that is left once θ4 is fixed, never from the small numbers that
give θ4: the error of θ4 near the wrist's singularity is thereby taken back, and the pose is met to rounding
everywhere. Where sin θ5 is below ``WRIST_TOLERANCE`` only θ4 + θ6 matters, and θ4 is 0.

An arm is one array of ``SIZE`` numbers, at the places that are named here.
"""

from __future__ import annotations

from math import acos, atan2, cos, pi, sin, sqrt

import numpy as np

from packenv.kernels import compiled

A1, A2, B, C1, C2, C3, C4 = range(7)
"""The seven lengths, m."""
FOREARM, PSI = 7, 8
"""√(a2² + c3²), m, and atan2(a2, c3), rad."""
LOWER, UPPER, ZERO = 9, 15, 21
"""First of six: smallest and largest model angle, and the one where the arm's own joint angle is 0, rad."""
SIZE = 27

REACH_TOLERANCE = 1e-10
"""A wrist centre that is out of reach by less than this is taken to be on the border, m."""
WRIST_TOLERANCE = 1e-9
"""sin θ5 below this is the wrist's singularity: joints 4 and 6 are in line."""
LIMIT_TOLERANCE = 1e-9
"""Rounding that the joint limits forgive, rad."""
_TURN = 2.0 * pi


@compiled
def link_frames(arm, q, frames):  # type: ignore[no-untyped-def]
    """Frames of the base and of links 1 to 6 in the base frame.

    Args:
        arm: (SIZE,).
        q: (n, 6) model angles, rad.
        frames: (n, 7, 4, 4), overwritten; the last is the flange.
    """
    a1, a2, b, c1, c2, c3, c4 = arm[A1], arm[A2], arm[B], arm[C1], arm[C2], arm[C3], arm[C4]
    for k in range(q.shape[0]):
        out = frames[k]
        out[:] = 0.0
        for i in range(7):
            out[i, 3, 3] = 1.0
        for i in range(3):
            out[0, i, i] = 1.0
        _turn_z(out[0], 0.0, 0.0, c1, q[k, 0], out[1])
        _turn_y(out[1], a1, 0.0, 0.0, q[k, 1], out[2])
        _turn_y(out[2], 0.0, b, c2, q[k, 2], out[3])
        _turn_z(out[3], a2, 0.0, 0.0, q[k, 3], out[4])
        _turn_y(out[4], 0.0, 0.0, c3, q[k, 4], out[5])
        _turn_z(out[5], 0.0, 0.0, c4, q[k, 5], out[6])


@compiled
def _turn_z(parent, x, y, z, angle, child):  # type: ignore[no-untyped-def]
    c, s = cos(angle), sin(angle)
    for i in range(3):
        child[i, 0] = c * parent[i, 0] + s * parent[i, 1]
        child[i, 1] = c * parent[i, 1] - s * parent[i, 0]
        child[i, 2] = parent[i, 2]
        child[i, 3] = parent[i, 0] * x + parent[i, 1] * y + parent[i, 2] * z + parent[i, 3]


@compiled
def _turn_y(parent, x, y, z, angle, child):  # type: ignore[no-untyped-def]
    c, s = cos(angle), sin(angle)
    for i in range(3):
        child[i, 0] = c * parent[i, 0] - s * parent[i, 2]
        child[i, 1] = parent[i, 1]
        child[i, 2] = c * parent[i, 2] + s * parent[i, 0]
        child[i, 3] = parent[i, 0] * x + parent[i, 1] * y + parent[i, 2] * z + parent[i, 3]


@compiled
def wrapped(angle):  # type: ignore[no-untyped-def]
    """The same angle within [-π, π]."""
    return angle - _TURN * np.rint(angle / _TURN)


@compiled
def branches(arm, pose, q):  # type: ignore[no-untyped-def]
    """All branches of one flange pose, whatever the limits.

    Args:
        arm: (SIZE,).
        pose: (4, 4) flange in the base frame.
        q: (8, 6), overwritten: model angles, rad, θ3 within π + |ψ|, the others within π; NaN where the
            branch does not exist.
    """
    q[:] = np.nan
    a1, b, upper_arm, c4, forearm, psi = arm[A1], arm[B], arm[C2], arm[C4], arm[FOREARM], arm[PSI]
    px = pose[0, 3] - c4 * pose[0, 2]
    py = pose[1, 3] - c4 * pose[1, 2]
    w = pose[2, 3] - c4 * pose[2, 2] - arm[C1]
    # The radius is compared before it is squared: squares lose the tolerance near the border.
    radius = sqrt(px * px + py * py)
    if radius < abs(b) - REACH_TOLERANCE:
        return
    along = sqrt(max(0.0, (radius - b) * (radius + b)))
    for shoulder in range(2):
        x = along if shoulder == 0 else -along
        q1 = wrapped(atan2(py, px) - atan2(b, x))
        c1, s1 = cos(q1), sin(q1)
        u = x - a1
        distance = sqrt(u * u + w * w)
        longest, shortest = upper_arm + forearm, abs(upper_arm - forearm)
        if not shortest - REACH_TOLERANCE <= distance <= longest + REACH_TOLERANCE:
            continue
        cosine = (distance**2 - upper_arm**2 - forearm**2) / (2.0 * upper_arm * forearm)
        bend = acos(min(1.0, max(-1.0, cosine)))
        for elbow in range(2):
            angle = bend if elbow == 0 else -bend
            q2 = wrapped(atan2(u, w) - atan2(forearm * sin(angle), upper_arm + forearm * cos(angle)))
            q3 = angle - psi
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


@compiled
def _within(arm, j, angle):  # type: ignore[no-untyped-def]
    """Whether a model angle is within the limits of joint j + 1."""
    return arm[LOWER + j] - LIMIT_TOLERANCE <= angle <= arm[UPPER + j] + LIMIT_TOLERANCE


@compiled
def into_limits(arm, q):  # type: ignore[no-untyped-def]
    """Move every joint by whole turns into its limits, nearest to its zero, where that is possible.

    Args:
        arm: (SIZE,).
        q: (6,) model angles, rad, changed in place.

    Returns:
        True where all joints are within their limits.
    """
    inside = True
    for j in range(6):
        value = wrapped(q[j])
        best = np.inf
        low, high, zero = arm[LOWER + j] - LIMIT_TOLERANCE, arm[UPPER + j] + LIMIT_TOLERANCE, arm[ZERO + j]
        for turn in range(-1, 2):
            turned = value + turn * _TURN
            if low <= turned <= high and abs(turned - zero) < abs(best - zero):
                best = turned
        if best == np.inf:
            inside = False
            q[j] = value
        else:
            q[j] = best
    return inside


@compiled
def inverse(arm, poses, q, valid):  # type: ignore[no-untyped-def]
    """All branches of many flange poses, moved into the limits where possible.

    Args:
        arm: (SIZE,).
        poses: (m, 4, 4).
        q: (m, 8, 6) model angles, overwritten; NaN where the branch does not exist.
        valid: (m, 8) bool, overwritten: the branch exists within the limits.
    """
    for k in range(poses.shape[0]):
        branches(arm, poses[k], q[k])
        for slot in range(8):
            valid[k, slot] = False
            if not np.isnan(q[k, slot, 0]):
                valid[k, slot] = into_limits(arm, q[k, slot])


@compiled
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


@compiled
def _bends_within(arm, q):  # type: ignore[no-untyped-def]
    """Whether joints 2, 3 and 5, which few arms can turn by whole turns, are within their limits."""
    for j in (1, 2, 4):
        turned = _within(arm, j, q[j]) or _within(arm, j, q[j] - _TURN) or _within(arm, j, q[j] + _TURN)
        if not turned:
            return False
    return True


@compiled
def _copy_angles(source, target):  # type: ignore[no-untyped-def]
    for j in range(6):
        target[j] = source[j]


@compiled
def follow(arm, path, max_step, q, state):  # type: ignore[no-untyped-def]
    """Continue every branch of the first pose along a path.

    A branch keeps its slot while its joints step by no more than ``max_step``; else it goes on in the slot
    that is nearest. So a path may run through the wrist's singularity, where the slot changes and the joints
    do not jump. Whole turns are chosen last, for the path as a whole: a joint that may turn by 540° is
    unwrapped and then moved to where all of it fits.

    Args:
        arm: (SIZE,).
        path: (m, 4, 4), m ≥ 1.
        max_step: largest step of any joint between two poses, rad.
        q: (8, m, 6) model angles, overwritten where ``state`` is 0.
        state: (8,) int8, overwritten: 0 continuous and within the limits, 1 out of reach or a jump, 2
            leaves the limits.
    """
    m = path.shape[0]
    every = np.empty((m, 8, 6))
    for k in range(m):
        branches(arm, path[k], every[k])
    trial = np.empty(6)
    for start in range(8):
        state[start] = 1
        if np.isnan(every[0, start, 0]):
            continue
        line = q[start]
        _copy_angles(every[0, start], line[0])
        if abs(line[0, 4]) < WRIST_TOLERANCE:
            # The first pose leaves q4 free: take what the first pose outside the singularity asks for.
            for k in range(1, m):
                later = every[k, start]
                if abs(later[4]) >= WRIST_TOLERANCE:
                    line[0, 5] = line[0, 3] + line[0, 5] - later[3]
                    line[0, 3] = later[3]
                    break
        state[start] = 0 if _bends_within(arm, line[0]) else 2
        slot = start
        for k in range(1, m):
            if state[start] != 0:
                break
            before = line[k - 1]
            nearest = np.inf
            if not np.isnan(every[k, slot, 0]):
                _copy_angles(every[k, slot], trial)
                nearest = _step(before, trial, max_step)
            if nearest == np.inf:
                for other in range(8):
                    if np.isnan(every[k, other, 0]):
                        continue
                    _copy_angles(every[k, other], trial)
                    step = _step(before, trial, max_step)
                    if step < nearest:
                        nearest = step
                        slot = other
                if nearest == np.inf:
                    state[start] = 1
                    break
                _copy_angles(every[k, slot], trial)
                _step(before, trial, max_step)
            for j in range(6):
                line[k, j] = before[j] + wrapped(trial[j] - before[j])
            if not _bends_within(arm, line[k]):
                state[start] = 2
        if state[start] == 0 and not _turn_path(arm, line):
            state[start] = 2


@compiled
def _turn_path(arm, line):  # type: ignore[no-untyped-def]
    """Move each joint's whole line by the whole turns that bring it into its limits, nearest to its zero."""
    for j in range(6):
        low, high = line[0, j], line[0, j]
        for k in range(1, line.shape[0]):
            low = min(low, line[k, j])
            high = max(high, line[k, j])
        nearest = -_TURN * np.rint(((low + high) / 2.0 - arm[ZERO + j]) / _TURN)
        found = False
        for turn in (0.0, -_TURN, _TURN):
            shift = nearest + turn
            if _within(arm, j, low + shift) and _within(arm, j, high + shift):
                found = True
                for k in range(line.shape[0]):
                    line[k, j] += shift
                break
        if not found:
            return False
    return True
