"""Compiled kernels on voxels that are kept as runs along z: how much pieces share, and where a piece costs least.

The columns of a piece are laid down in layers: the lowest run of each column in the first, the next in the second, and
so on. A layer is a rectangle of columns with the bottom and the top of one run each; where there is none they are
``NOWHERE`` and minus that, so that it shares nothing with anything. Whole numbers below 2**24 are exact in single
precision in any sequence of sums, which lets the compiler take many columns at once.

All layers that are known are in one array ``pool``: the bottoms of a layer from its offset on, row by row, then its
tops. ``layers`` has a row for each: offset, x and y at which it begins, columns along x and y, lowest bottom and
highest top. ``shapes`` has a row for each shape: its first layer, and the one after its last.
"""

from __future__ import annotations

import numpy as np

from packenv.kernels import compiled, compiled_in_any_sequence

NOWHERE = 1e5
"""Bottom of a run that is none, voxels; the top of one that has no end."""

_NEIGHBOURS = np.array(
    sorted(
        ((i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if i or j or k),
        key=lambda step: np.count_nonzero(step),
    ),
    dtype=np.int64,
)
"""(26, 3) the steps to the voxels around one, along one axis first."""


@compiled
def most_runs(grid):  # type: ignore[no-untyped-def]
    """The largest number of runs that a column of ``grid`` (w, d, h) has."""
    w, d, h = grid.shape
    most = 0
    for i in range(w):
        for j in range(d):
            count, before = 0, False
            for k in range(h):
                if grid[i, j, k] and not before:
                    count += 1
                before = grid[i, j, k]
            most = max(most, count)
    return most


@compiled
def find_runs(grid, low, high):  # type: ignore[no-untyped-def]
    """Write bottoms and tops of the runs of ``grid`` (w, d, h) into ``low`` and ``high`` (layers, w, d)."""
    w, d, h = grid.shape
    low[:] = np.float32(NOWHERE)
    high[:] = np.float32(-NOWHERE)
    for i in range(w):
        for j in range(d):
            count, before = 0, False
            for k in range(h):
                if grid[i, j, k] and not before:
                    low[count, i, j] = k
                    count += 1
                if grid[i, j, k]:
                    high[count - 1, i, j] = k + 1
                before = grid[i, j, k]


@compiled_in_any_sequence
def _shared_of_layers(pool, a, wa, da, b, wb, db, x, y, z):  # type: ignore[no-untyped-def]
    """Voxels that two layers share, at offsets ``a`` and ``b``, if the first begins at (x, y, z) from the second."""
    x0, x1, y0, y1 = max(x, 0), min(x + wa, wb), max(y, 0), min(y + da, db)
    total = np.float32(0.0)
    if x1 <= x0 or y1 <= y0:
        return total
    # Unsigned: what cannot be negative is not looked up from the end, and is vectorized.
    up, n = np.float32(z), np.uint64(y1 - y0)
    tops_a, tops_b = np.uint64(wa * da), np.uint64(wb * db)
    p, q = np.uint64(a + (x0 - x) * da + y0 - y), np.uint64(b + x0 * db + y0)
    for _ in range(x1 - x0):
        for k in range(n):
            low, other = pool[p + k] + up, pool[q + k]
            low = low if low > other else other
            high, other = pool[p + tops_a + k] + up, pool[q + tops_b + k]
            high = high if high < other else other
            total += high - low if high > low else np.float32(0.0)
        p += np.uint64(da)
        q += np.uint64(db)
    return total


@compiled
def shared(pool, layers, shapes, a, x, y, z, b, at_b):  # type: ignore[no-untyped-def]
    """How many voxels shape ``a`` at (x, y, z) and shape ``b`` at ``at_b`` (3,) share."""
    x, y, z = x - at_b[0], y - at_b[1], z - at_b[2]
    total = 0.0
    for m in range(shapes[a, 0], shapes[a, 1]):
        for n in range(shapes[b, 0], shapes[b, 1]):
            if z + layers[m, 5] < layers[n, 6] and layers[n, 5] < z + layers[m, 6]:
                total += _shared_of_layers(
                    pool,
                    layers[m, 0],
                    layers[m, 3],
                    layers[m, 4],
                    layers[n, 0],
                    layers[n, 3],
                    layers[n, 4],
                    x + layers[m, 1] - layers[n, 1],
                    y + layers[m, 2] - layers[n, 2],
                    z,
                )
    return total


@compiled
def shared_with_each(pool, layers, shapes, own, at, others, places, counts):  # type: ignore[no-untyped-def]
    """Write how many voxels a shape at ``at`` (3,) shares with each of others (n,) at places (n, 3) into ``counts``."""
    for k in range(others.shape[0]):
        counts[k] = shared(pool, layers, shapes, own, at[0], at[1], at[2], others[k], places[k])


@compiled
def costs_along(pool, layers, shapes, own, at, others, places, penalties, axis, costs):  # type: ignore[no-untyped-def]
    """What a shape costs on a line: voxels that it shares with others, and a penalty for each with which it does.

    Args:
        pool: of all layers.
        layers: of all shapes.
        shapes: which layers each has.
        own: the shape that is moved.
        at: (3,) where it begins; its entry of the axis is not read.
        others: (n,) the other shapes.
        places: (n, 3) where they begin.
        penalties: (n,) of them.
        axis: 0, 1 or 2.
        costs: (m,) overwritten: of the places 0 to m - 1.
    """
    place = at.copy()
    for t in range(costs.shape[0]):
        place[axis] = t
        costs[t] = 0.0
        for k in range(others.shape[0]):
            count = shared(pool, layers, shapes, own, place[0], place[1], place[2], others[k], places[k])
            if count > 0.0:
                costs[t] += count + penalties[k]


@compiled
def _cost(pool, layers, shapes, own, x, y, z, others, places, weights, limit):  # type: ignore[no-untyped-def]
    """Weighted sum of the sizes of what a shape at (x, y, z) shares with others, or more than the limit if it is.

    A size is the side of a cube of as many voxels: shallow overlaps then do not count next to nothing.
    """
    total = 0.0
    for k in range(others.shape[0]):
        total += weights[k] * np.cbrt(shared(pool, layers, shapes, own, x, y, z, others[k], places[k]))
        if total > limit:
            break
    return total


@compiled
def descend(pool, layers, shapes, own, start, last, others, places, weights, step, along_x, along_y):  # type: ignore[no-untyped-def]
    """From a place go to a better one of its 26 neighbours, again and again, as long as there is one.

    Args:
        pool: of all layers.
        layers: of all shapes.
        shapes: which layers each has.
        own: the shape that is moved.
        start: x, y and z to begin at.
        last: the last place along x, y and z.
        others: (n,) the other shapes.
        places: (n, 3) where they begin.
        weights: (n,) of the size of what is shared with each.
        step: how far the neighbours are at first, voxels; halved until it is 1.
        along_x: of places without cost the lowest is taken, and of equally low ones: 1 prefers small x, -1 large.
        along_y: likewise.

    Returns:
        the cost there, and its x, y and z.
    """
    x, y, z = start
    best = _cost(pool, layers, shapes, own, x, y, z, others, places, weights, np.inf)
    aside = 2 * z + along_x * x + along_y * y
    while step > 0:
        m, failed = 0, 0
        while failed < 26:
            i, j, k = x + step * _NEIGHBOURS[m, 0], y + step * _NEIGHBOURS[m, 1], z + step * _NEIGHBOURS[m, 2]
            better = False
            if 0 <= i <= last[0] and 0 <= j <= last[1] and 0 <= k <= last[2]:
                new = 2 * k + along_x * i + along_y * j
                if best > 0.0 or new < aside:
                    cost = _cost(pool, layers, shapes, own, i, j, k, others, places, weights, best)
                    better = cost < best or (cost == best and new < aside)
                    if better:
                        best, aside, x, y, z = cost, new, i, j, k
            if better:
                failed = 0
            else:
                failed += 1
                m = (m + 1) % 26
        step //= 2
    return best, x, y, z


@compiled
def _add_ramp(line, begin, slope):  # type: ignore[no-untyped-def]
    """Add ``begin``, and so much more from each entry to the next, to a line of whole numbers."""
    value, slope = np.int32(begin), np.int32(slope)
    for k in range(line.shape[0]):
        line[k] = np.int32(line[k] + np.int32(value + np.int32(slope * np.int32(k))))


@compiled
def fill_sampled(pool, layers, shapes, others, places, weights, step, field):  # type: ignore[no-untyped-def]
    """Add up what shapes weigh below each level, on every ``step``-th column.

    Args:
        pool: of all layers.
        layers: of all shapes.
        shapes: which layers each has.
        others: (n,) shapes.
        places: (n, 3) where they begin.
        weights: (n,) int32 of a voxel of each.
        step: columns and levels that count as one.
        field: (cx, cy, cz) int32, overwritten.
    """
    field[:] = 0
    cx, cy, cz = field.shape
    half = step // 2
    for n in range(others.shape[0]):
        weight = weights[n]
        for m in range(shapes[others[n], 0], shapes[others[n], 1]):
            x, y = places[n, 0] + layers[m, 1], places[n, 1] + layers[m, 2]
            w, d = layers[m, 3], layers[m, 4]
            for i in range(max((x - half + step - 1) // step, 0), min((x + w - 1 - half) // step + 1, cx)):
                for j in range(
                    max((y - half + step - 1) // step, 0), min((y + d - 1 - half) // step + 1, cy)
                ):
                    at = layers[m, 0] + (step * i + half - x) * d + step * j + half - y
                    low = int(pool[at])
                    high = int(pool[at + w * d])
                    if high <= low:
                        continue
                    low, high = max(low + places[n, 2], 0), min(high + places[n, 2], step * cz)
                    first, end = (low + step - 1) // step, (high + step - 1) // step
                    _add_ramp(field[i, j, first:end], weight * (step * first - low), weight * step)
                    _add_ramp(field[i, j, end:], weight * (high - low), 0)


@compiled_in_any_sequence
def _add_difference(total, levels, low, high):  # type: ignore[no-untyped-def]
    """Add what is between two levels, ``low`` and ``high`` numbers further on in ``levels``, to ``total``."""
    above, below = levels[high : high + total.shape[0]], levels[low : low + total.shape[0]]
    for k in range(total.shape[0]):
        total[k] += np.float32(above[k] - below[k])


@compiled
def sampled_minima(pool, layers, shapes, own, last, step, field, along_x, along_y, found):  # type: ignore[no-untyped-def]
    """Where about a shape costs least, of every ``step``-th place: places with none cheaper around them.

    Args:
        pool: of all layers.
        layers: of all shapes.
        shapes: which layers each has.
        own: the shape that is moved.
        last: its last place along x, y and z.
        step: as for :func:`fill_sampled`.
        field: from there.
        along_x: as for :func:`descend`.
        along_y: likewise.
        found: (m, 4) float64, overwritten: cost, x, y and z of the best ones, the best first; no more have cost inf.
    """
    half = step // 2
    nx, ny, nz = (
        (last[0] + step - 1) // step + 1,
        (last[1] + step - 1) // step + 1,
        (last[2] + step - 1) // step + 1,
    )
    cx, cy, cz = field.shape
    # As long along z as the field: then one loop goes over y and z, and what is beyond the last place is not read.
    costs = np.zeros((nx, ny, cz), dtype=np.float32)
    flat, levels = costs.reshape(nx, ny * cz), field.reshape(cx, cy * cz)
    for m in range(shapes[own, 0], shapes[own, 1]):
        w, d, x, y = layers[m, 3], layers[m, 4], layers[m, 1], layers[m, 2]
        for a in range(x // step, (x + w - 1) // step + 1):
            i = step * a + half - x
            i = min(max(i, 0), w - 1)
            for b in range(y // step, (y + d - 1) // step + 1):
                j = min(max(step * b + half - y, 0), d - 1)
                at = layers[m, 0] + i * d + j
                if pool[at + w * d] <= pool[at]:
                    continue
                low, high = (int(pool[at]) + half) // step, (int(pool[at + w * d]) + half) // step
                if high == low:
                    high = low + 1
                for p in range(nx):
                    _add_difference(flat[p, : (ny - 1) * cz + nz], levels[p + a], b * cz + low, b * cz + high)
    found[:] = np.inf
    for p in range(nx):
        for q in range(ny):
            for r in range(nz):
                cost = costs[p, q, r]
                aside = 2 * r + along_x * p + along_y * q
                if cost + 1e-9 * aside >= found[-1, 0]:
                    continue
                lowest = True
                for n in range(26):
                    i, j, k = p + _NEIGHBOURS[n, 0], q + _NEIGHBOURS[n, 1], r + _NEIGHBOURS[n, 2]
                    if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
                        other = costs[i, j, k]
                        if other < cost or (other == cost and 2 * k + along_x * i + along_y * j < aside):
                            lowest = False
                            break
                if not lowest:
                    continue
                n = found.shape[0] - 1
                while n > 0 and found[n - 1, 0] > cost + 1e-9 * aside:
                    found[n] = found[n - 1]
                    n -= 1
                found[n, 0] = cost + 1e-9 * aside
                found[n, 1] = min(step * p, last[0])
                found[n, 2] = min(step * q, last[1])
                found[n, 3] = min(step * r, last[2])
