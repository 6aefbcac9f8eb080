"""Compiled kernel that finds the voxels which a triangle mesh touches."""

from __future__ import annotations

import math

import numpy as np

from packenv.geometry.raster_kernels import cell_range, clip_triangle
from packenv.kernels import compiled


@compiled
def touch(vertices, faces, pitch, grid):  # type: ignore[no-untyped-def]
    """Set every voxel that a face reaches into by more than the tolerance of the heightmaps.

    Each triangle is clipped to each column of voxels that it touches; what is left of it there is connected, so it
    touches every voxel between its lowest and its highest point and no other.

    Args:
        vertices: (n, 3) smallest x, y and z at 0, m.
        faces: (m, 3) vertex indices, counter-clockwise from outside.
        pitch: side of a voxel, m.
        grid: (w, d, h) bool, set in place.
    """
    w, d, h = grid.shape
    high = np.full((w, d), -np.inf)
    low = np.full((w, d), np.inf)
    triangle = np.empty((3, 3))
    a, b, c = np.empty((12, 3)), np.empty((12, 3)), np.empty((12, 3))
    for f in range(faces.shape[0]):
        for corner in range(3):
            for k in range(3):
                triangle[corner, k] = vertices[faces[f, corner], k]
        clip_triangle(triangle, pitch, high, low, a, b, c)
        up = (triangle[1, 0] - triangle[0, 0]) * (triangle[2, 1] - triangle[0, 1])
        up -= (triangle[1, 1] - triangle[0, 1]) * (triangle[2, 0] - triangle[0, 0])
        # One column more on either side: on a line between two, the clipping chooses by the normal.
        i0 = max(math.floor(min(triangle[0, 0], triangle[1, 0], triangle[2, 0]) / pitch) - 1, 0)
        i1 = min(math.floor(max(triangle[0, 0], triangle[1, 0], triangle[2, 0]) / pitch) + 1, w - 1)
        j0 = max(math.floor(min(triangle[0, 1], triangle[1, 1], triangle[2, 1]) / pitch) - 1, 0)
        j1 = min(math.floor(max(triangle[0, 1], triangle[1, 1], triangle[2, 1]) / pitch) + 1, d - 1)
        for i in range(min(i0, w - 1), i1 + 1):
            for j in range(min(j0, d - 1), j1 + 1):
                if low[i, j] == np.inf:
                    continue
                first, last = cell_range(low[i, j], high[i, j], pitch, h, up)
                for k in range(first, last + 1):
                    grid[i, j, k] = True
                low[i, j] = np.inf
                high[i, j] = -np.inf


@compiled
def add_weighted(field, grid, x, y, z, weight):  # type: ignore[no-untyped-def]
    """Add a weight to every voxel of ``field`` (nx, ny, nz) that ``grid`` (w, d, h) has set when it begins there."""
    w, d, h = grid.shape
    for i in range(w):
        for j in range(d):
            for k in range(h):
                if grid[i, j, k]:
                    field[x + i, y + j, z + k] += weight


@compiled
def shared(a, at_a, b, at_b):  # type: ignore[no-untyped-def]
    """How many voxels two grids (w, d, h) share that begin at these voxels (3,)."""
    x0, x1 = max(at_a[0], at_b[0]), min(at_a[0] + a.shape[0], at_b[0] + b.shape[0])
    y0, y1 = max(at_a[1], at_b[1]), min(at_a[1] + a.shape[1], at_b[1] + b.shape[1])
    z0, z1 = max(at_a[2], at_b[2]), min(at_a[2] + a.shape[2], at_b[2] + b.shape[2])
    count = 0
    for x in range(x0, x1):
        for y in range(y0, y1):
            for z in range(z0, z1):
                if a[x - at_a[0], y - at_a[1], z - at_a[2]] and b[x - at_b[0], y - at_b[1], z - at_b[2]]:
                    count += 1
    return count


@compiled
def _bounds_of_runs(voxels, place, axis, bounds):  # type: ignore[no-untyped-def]
    """Where runs of set voxels begin and end, in turn, along a line; ``place`` is moved along it.

    Returns:
        How many bounds there are; so many are filled.
    """
    length = voxels.shape[axis]
    count = 0
    before = False
    for k in range(length):
        place[axis] = k
        now = voxels[place[0], place[1], place[2]]
        if now != before:
            bounds[count] = k
            count += 1
            before = now
    if before:
        bounds[count] = length
        count += 1
    return count


@compiled
def shared_along(a, at_a, b, at_b, axis, counts):  # type: ignore[no-untyped-def]
    """How many voxels two grids share for every place of the first one on a line along an axis.

    Args:
        a: (w, d, h) bool, moved along the axis from voxel 0 on.
        at_a: (3,) where it begins; its entry of the axis is not read.
        b: (w, d, h) bool, stays.
        at_b: (3,) where it begins.
        axis: 0, 1 or 2.
        counts: (n,) int64, overwritten: for the places 0 to n - 1.
    """
    counts[:] = 0
    p, q = (axis + 1) % 3, (axis + 2) % 3
    p0, p1 = max(at_a[p], at_b[p]), min(at_a[p] + a.shape[p], at_b[p] + b.shape[p])
    q0, q1 = max(at_a[q], at_b[q]), min(at_a[q] + a.shape[q], at_b[q] + b.shape[q])
    if p0 >= p1 or q0 >= q1:
        return
    n = counts.shape[0]
    # Second differences: two runs of length r and s that begin x apart share a trapezoid of x.
    ramps = np.zeros(n + 1, dtype=np.int64)
    place = np.zeros(3, dtype=np.int64)
    other = np.zeros(3, dtype=np.int64)
    long_a, long_b = a.shape[axis], b.shape[axis]
    bounds_a = np.empty(long_a + 2, dtype=np.int64)
    bounds_b = np.empty(long_b + 2, dtype=np.int64)
    for u in range(p0, p1):
        for v in range(q0, q1):
            place[p], place[q] = u - at_a[p], v - at_a[q]
            other[p], other[q] = u - at_b[p], v - at_b[q]
            count_a = _bounds_of_runs(a, place, axis, bounds_a)
            if count_a == 0:
                continue
            count_b = _bounds_of_runs(b, other, axis, bounds_b)
            for m in range(count_a):
                for k in range(count_b):
                    # |b ∩ [bound_a + t, ∞)| and the like: each pair of bounds begins a ramp of t.
                    at = at_b[axis] + bounds_b[k] - bounds_a[m]
                    sign = -1 if (m + k) % 2 == 0 else 1
                    # max(0, t - at), from t = at + 1 on
                    if at < 0:
                        counts[0] += sign * -at
                        ramps[0] += sign
                    elif at < n:
                        ramps[at] += sign
    # counts[0] has the value at 0 of all ramps that begin before it; ramps[t] the slopes that begin at t.
    value, slope = counts[0], 0
    for t in range(n):
        counts[t] = value
        slope += ramps[t]
        value += slope


@compiled
def least(costs, along_x, along_y):  # type: ignore[no-untyped-def]
    """The place of least cost, and of equal ones the lowest in a corner.

    Args:
        costs: (nx, ny, nz) cost of each place; what is below a half is rounding, and nothing.
        along_x: 1 prefers small x, -1 large.
        along_y: likewise.

    Returns:
        its cost, and its x, y and z.
    """
    nx, ny, nz = costs.shape
    best, best_aside = np.inf, np.inf
    at = (0, 0, 0)
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                cost = costs[x, y, z]
                if cost > best:
                    continue
                if cost < 0.5:
                    cost = 0.0
                aside = 2 * z + along_x * x + along_y * y
                if cost < best or aside < best_aside:
                    best, best_aside, at = cost, aside, (x, y, z)
    return best, at[0], at[1], at[2]


@compiled
def halved(field, sums):  # type: ignore[no-untyped-def]
    """Sum blocks of 2 x 2 x 2 of ``field`` (nx, ny, nz) into ``sums`` (half of each, rounded up), which is all 0."""
    nx, ny, nz = field.shape
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                sums[x // 2, y // 2, z // 2] += field[x, y, z]


@compiled
def weight_at(field, grid, x, y, z):  # type: ignore[no-untyped-def]
    """Sum of ``field`` (nx, ny, nz) over the voxels of ``grid`` (w, d, h) when it begins there."""
    w, d, h = grid.shape
    total = 0.0
    for i in range(w):
        for j in range(d):
            for k in range(h):
                if grid[i, j, k]:
                    total += field[x + i, y + j, z + k]
    return total


@compiled
def descend(field, grid, at, places, along_x, along_y):  # type: ignore[no-untyped-def]
    """From a place go to the best of its 26 neighbours, again and again, as long as that is better.

    Args:
        field: (nx, ny, nz) cost of each voxel.
        grid: (w, d, h) bool.
        at: x, y and z to begin at.
        places: numbers of places along x, y and z.
        along_x: as in :func:`least`.
        along_y: likewise.

    Returns:
        the cost there, and its x, y and z.
    """
    x, y, z = at
    best = weight_at(field, grid, x, y, z)
    best_aside = 2 * z + along_x * x + along_y * y
    while True:
        found = (x, y, z)
        for i in range(max(x - 1, 0), min(x + 2, places[0])):
            for j in range(max(y - 1, 0), min(y + 2, places[1])):
                for k in range(max(z - 1, 0), min(z + 2, places[2])):
                    aside = 2 * k + along_x * i + along_y * j
                    if best == 0.0 and aside >= best_aside:
                        continue
                    cost = weight_at(field, grid, i, j, k)
                    if cost < best or (cost == best and aside < best_aside):
                        best, best_aside, found = cost, aside, (i, j, k)
        if found == (x, y, z):
            return best, x, y, z
        x, y, z = found
