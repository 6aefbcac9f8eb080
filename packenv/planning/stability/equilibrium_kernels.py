"""Compiled parts of the equilibrium: the columns of its matrix, and least squares of few rows."""

from __future__ import annotations

import math

import numpy as np

from packenv.kernels import compiled

_LEVEL = 1e-12
"""Square of the uphill part of a unit normal's tangent below which a contact is level."""

_DEPENDENT = 1e-12
"""A column that adds less than this share of its length to those before it depends on them."""


@compiled
def fill_columns(  # type: ignore[no-untyped-def]
    points, normals, first, second, slot, units, weight, centre, length, mu, up, level, wheel,
    edges, start, index, value,
):  # fmt: skip
    """Edges of the friction pyramids, and the matrix in compressed columns.

    Args:
        points: (k, 3) contacts, m.
        normals: (k, 3) unit, into ``second``.
        first: (k,) bodies.
        second: (k,) bodies.
        slot: (n + 1,) place of each body among the free ones, -1 where it is held.
        units: (k,) force that a contact's columns are measured in, N.
        weight: (n + 1,) of each body, N.
        centre: (n + 1, 3) of mass, m.
        length: m, that torques are measured by.
        mu: (k,) coefficient of friction of each contact.
        up: (3,) unit, against gravity.
        level: (3,) axis that the first tangent of a level contact follows.
        wheel: (sides, 2) cosine and sine of each edge's angle.
        edges: (k, sides, 3) filled.
        start: (k · sides + 1,) int32 filled.
        index: int32 filled, room for 12 k · sides.
        value: likewise.

    Returns:
        number of entries.
    """
    entry = 0
    column = 0
    tangent = np.empty(3)
    across = np.empty(3)
    start[0] = 0
    for k in range(len(points)):
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        along = nx * up[0] + ny * up[1] + nz * up[2]
        size = 0.0
        for axis in range(3):
            tangent[axis] = up[axis] - along * normals[k, axis]
            size += tangent[axis] ** 2
        if size < _LEVEL:
            along = nx * level[0] + ny * level[1] + nz * level[2]
            size = 0.0
            for axis in range(3):
                tangent[axis] = level[axis] - along * normals[k, axis]
                size += tangent[axis] ** 2
        size = math.sqrt(size)
        for axis in range(3):
            tangent[axis] /= size
        across[0] = ny * tangent[2] - nz * tangent[1]
        across[1] = nz * tangent[0] - nx * tangent[2]
        across[2] = nx * tangent[1] - ny * tangent[0]
        for s in range(len(wheel)):
            for axis in range(3):
                edges[k, s, axis] = normals[k, axis] + mu[k] * (
                    wheel[s, 0] * tangent[axis] + wheel[s, 1] * across[axis]
                )
            ex, ey, ez = edges[k, s, 0], edges[k, s, 1], edges[k, s, 2]
            for side in range(2):
                body = first[k] if side == 0 else second[k]
                if slot[body] < 0:
                    continue
                scale = (-units[k] if side == 0 else units[k]) / weight[body]
                ax = (points[k, 0] - centre[body, 0]) / length
                ay = (points[k, 1] - centre[body, 1]) / length
                az = (points[k, 2] - centre[body, 2]) / length
                value[entry] = scale * ex
                value[entry + 1] = scale * ey
                value[entry + 2] = scale * ez
                value[entry + 3] = scale * (ay * ez - az * ey)
                value[entry + 4] = scale * (az * ex - ax * ez)
                value[entry + 5] = scale * (ax * ey - ay * ex)
                for row in range(6):
                    index[entry + row] = 6 * slot[body] + row
                entry += 6
            column += 1
            start[column] = entry
    return entry


@compiled
def add_wrenches(points, forces, first, second, centre, length, total):  # type: ignore[no-untyped-def]
    """Add what contact forces do to each body.

    Args:
        points: (k, 3) contacts, m.
        forces: (k, 3) N, on ``second``; the opposite acts on ``first``.
        first: (k,) bodies.
        second: (k,) bodies.
        centre: (n + 1, 3) of mass, m.
        length: m, that torques are measured by.
        total: (n + 1, 6) force and torque over ``length``, N; grows.
    """
    for k in range(len(points)):
        fx, fy, fz = forces[k, 0], forces[k, 1], forces[k, 2]
        for side in range(2):
            body = first[k] if side == 0 else second[k]
            sign = -1.0 if side == 0 else 1.0
            ax = (points[k, 0] - centre[body, 0]) / length
            ay = (points[k, 1] - centre[body, 1]) / length
            az = (points[k, 2] - centre[body, 2]) / length
            total[body, 0] += sign * fx
            total[body, 1] += sign * fy
            total[body, 2] += sign * fz
            total[body, 3] += sign * (ay * fz - az * fy)
            total[body, 4] += sign * (az * fx - ax * fz)
            total[body, 5] += sign * (ax * fy - ay * fx)


@compiled
def least_squares(columns, rhs, most, x, left):  # type: ignore[no-untyped-def]
    """Non-negative least squares (Lawson and Hanson 1974, NNLS) for a matrix of few rows.

    The columns in use are kept orthogonalized (modified Gram-Schmidt, twice), anew in every iteration: with
    few rows they are few.

    Args:
        columns: (n, rows) the matrix, transposed.
        rhs: (rows,).
        most: iterations after which it gives up.
        x: (n,) filled with the solution.
        left: (rows,) filled with what it leaves of ``rhs``.

    Returns:
        True where it ended by itself.
    """
    n, rows = columns.shape
    used = np.empty(rows, dtype=np.int64)
    basis = np.empty((rows, rows))
    upper = np.empty((rows, rows))
    found = np.empty(rows)
    barred = np.zeros(n, dtype=np.bool_)
    scale = 0.0
    for row in range(rows):
        left[row] = rhs[row]
        scale += rhs[row] ** 2
    scale = math.sqrt(scale)
    x[:] = 0.0
    count = 0
    for _ in range(most):
        size = 0.0
        for row in range(rows):
            size += left[row] ** 2
        if math.sqrt(size) <= 1e-13 * scale or count == rows:
            return True
        best, entering = 1e-14 * scale, -1
        for j in range(n):
            if barred[j] or x[j] > 0.0:
                continue
            gain = 0.0
            for row in range(rows):
                gain += columns[j, row] * left[row]
            if gain > best:
                best, entering = gain, j
        if entering < 0:
            return True
        used[count] = entering
        count += 1
        fresh = True
        while True:
            if not _solve(columns, rhs, used, count, basis, upper, found) or (
                fresh and found[count - 1] <= 0.0
            ):
                # The column that came last cannot help: rounding made it seem so.
                if not fresh:
                    return False
                barred[entering] = True
                count -= 1
                break
            fresh = False
            step, leaving = 1.0, -1
            for k in range(count):
                j = used[k]
                if found[k] <= 0.0:
                    ratio = x[j] / (x[j] - found[k]) if x[j] > found[k] else 0.0
                    if ratio < step:
                        step, leaving = ratio, k
            if leaving < 0:
                for k in range(count):
                    x[used[k]] = found[k]
                barred[:] = False
                break
            for k in range(count):
                j = used[k]
                x[j] += step * (found[k] - x[j])
            x[used[leaving]] = 0.0
            kept = 0
            for k in range(count):
                if x[used[k]] > 0.0:
                    used[kept] = used[k]
                    kept += 1
                else:
                    x[used[k]] = 0.0
            count = kept
            if count == 0:
                break
        for row in range(rows):
            left[row] = rhs[row]
        for k in range(count):
            j = used[k]
            for row in range(rows):
                left[row] -= x[j] * columns[j, row]
    return False


@compiled
def first_refuted(  # type: ignore[no-untyped-def]
    points, normals, ahead, com, length, mu, up, level, wheel, loads, tolerance, proof, motion
):  # fmt: skip
    """The first of several loads under which one item falls though everything else is held, proved by a motion.

    A motion is a proof as in :meth:`packenv.planning.stability.equilibrium.Equilibrium.refuted_by`.

    Args:
        points: (k, 3) contacts of the item, m.
        normals: (k, 3) unit.
        ahead: (k,) whether a normal points into the item.
        com: (3,) its centre of mass, m.
        length: m, that torques are measured by.
        mu: (k,) coefficient of friction of each contact.
        up: (3,) unit, against gravity.
        level: (3,) axis that the first tangent of a level contact follows.
        wheel: (sides, 2) cosine and sine of each edge's angle.
        loads: (d, 6) what the contacts have to balance, over the item's weight.
        tolerance: largest residual of a row that counts as balanced.
        proof: forces, over the item's weight, up to which a proof must hold.
        motion: (6,) filled with the proof, summing to 1 in size.

    Returns:
        index of the load; -1 where least squares refutes none.
    """
    k, n = len(points), len(points) * len(wheel)
    second = np.empty(k, np.int64)
    for i in range(k):
        second[i] = 1 if ahead[i] else 0
    slot, centre = np.array([-1, 0]), np.zeros((2, 3))
    for axis in range(3):
        centre[1, axis] = com[axis]
    start, index, value = np.empty(n + 1, np.int32), np.empty(12 * n, np.int32), np.empty(12 * n)
    fill_columns(
        points, normals, 1 - second, second, slot, np.ones(k), np.ones(2), centre, length, mu, up, level, wheel,
        np.empty((k, len(wheel), 3)), start, index, value,
    )  # fmt: skip
    columns = value[: 6 * n].reshape(n, 6)
    x = np.empty(n)
    for d in range(len(loads)):
        least_squares(columns, loads[d], 3 * n, x, motion)
        size = 0.0
        for row in range(6):
            size += abs(motion[row])
        if not 0.0 < size < np.inf:
            continue
        gap, worst = -tolerance, 0.0
        for row in range(6):
            motion[row] /= size
            gap += loads[d, row] * motion[row]
        for j in range(n):
            work = 0.0
            for row in range(6):
                work += columns[j, row] * motion[row]
            worst = max(worst, work)
        if gap > 0.0 and worst * proof <= gap:
            return d
    return -1


@compiled
def _solve(columns, rhs, used, count, basis, upper, found):  # type: ignore[no-untyped-def]
    """Least squares of the columns in use; False where one of them depends on those before it."""
    rows = columns.shape[1]
    for k in range(count):
        j = used[k]
        size = 0.0
        for row in range(rows):
            basis[k, row] = columns[j, row]
            size += basis[k, row] ** 2
        for m in range(k):
            upper[m, k] = 0.0
        for _ in range(2):
            for m in range(k):
                dot = 0.0
                for row in range(rows):
                    dot += basis[m, row] * basis[k, row]
                upper[m, k] += dot
                for row in range(rows):
                    basis[k, row] -= dot * basis[m, row]
        new = 0.0
        for row in range(rows):
            new += basis[k, row] ** 2
        if new <= _DEPENDENT**2 * size:
            return False
        new = math.sqrt(new)
        upper[k, k] = new
        for row in range(rows):
            basis[k, row] /= new
    for k in range(count):
        dot = 0.0
        for row in range(rows):
            dot += basis[k, row] * rhs[row]
        found[k] = dot
    for back in range(count):
        k = count - 1 - back
        for m in range(k + 1, count):
            found[k] -= upper[k, m] * found[m]
        found[k] /= upper[k, k]
    return True
