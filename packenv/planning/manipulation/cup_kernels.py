"""Compiled loops over the heightmap cells under the suction cup, and of the arm beside the held item.

The cup and the gripper's tube are one disc seen from above. A cell is *under* the disc where they overlap by
more than ``TOUCH_TOLERANCE``: every touched cell counts, as in the heightmaps themselves.
"""

from __future__ import annotations

from math import ceil, floor, hypot, sqrt

import numpy as np

from packenv.kernels import compiled

TOUCH_TOLERANCE = 1e-6
"""A disc that reaches less than this (m) into a cell, or into a wall, does not touch it."""


PAIRS = 8
"""Cells of a cup, the first of the list, that are looked at before the others."""


@compiled
def disc_cells(x, y, radius, cell, cells, offsets):  # type: ignore[no-untyped-def]
    """List the cells under a disc.

    Args:
        x: of the disc's centre, m.
        y: likewise.
        radius: m.
        cell: cell size, m.
        cells: (n, 2) int64, filled: the cells' indices, negative ones included.
        offsets: (n, 2) filled: their centres less the disc's, m.

    Returns:
        How many there are.
    """
    count = 0
    reach = radius - TOUCH_TOLERANCE
    for i in range(floor((x - radius) / cell), ceil((x + radius) / cell)):
        for j in range(floor((y - radius) / cell), ceil((y + radius) / cell)):
            dx, dy = (i + 0.5) * cell - x, (j + 0.5) * cell - y
            if hypot(max(0.0, abs(dx) - 0.5 * cell), max(0.0, abs(dy) - 0.5 * cell)) < reach:
                cells[count, 0] = i
                cells[count, 1] = j
                offsets[count, 0] = dx
                offsets[count, 1] = dy
                count += 1
    return count


@compiled
def highest_under(heights, x, y, radius, cell):  # type: ignore[no-untyped-def]
    """Highest cell of a heightmap under a disc, m; minus infinity where no cell of the map is under it."""
    highest = -np.inf
    reach = radius - TOUCH_TOLERANCE
    nx, ny = heights.shape
    for i in range(max(0, floor((x - radius) / cell)), min(nx, ceil((x + radius) / cell))):
        for j in range(max(0, floor((y - radius) / cell)), min(ny, ceil((y + radius) / cell))):
            dx = max(0.0, abs((i + 0.5) * cell - x) - 0.5 * cell)
            dy = max(0.0, abs((j + 0.5) * cell - y) - 0.5 * cell)
            if hypot(dx, dy) < reach:
                highest = max(highest, float(heights[i, j]))
    return highest


@compiled
def seal(top, bottom, ci, cj, cells, offsets, least, relief):  # type: ignore[no-untyped-def]
    """How an item's surface lies under the cup.

    Args:
        top: (w, h) top heightmap, m.
        bottom: (w, h) bottom heightmap; infinite outside the footprint.
        ci: added to the indices in ``cells``.
        cj: likewise.
        cells: (n, 2) cells under the cup; quickest with those that are first to leave a footprint first.
        offsets: (n, 2) as in :func:`disc_cells`, m.
        least: smallest number of cells that must belong to the footprint; with fewer, nothing is computed.
        relief: of interest, m; as soon as it is passed, the relief is infinite.

    Returns:
        Cells in the footprint; highest of them, m; slope of their best plane; largest height above that plane
        less the smallest (the relief), m.
    """
    w, h = top.shape
    n = cells.shape[0]
    missing = n - least
    covered, base, highest = 0, 0.0, 0.0
    sz, sx, sy, sxx, sxy, syy, sxz, syz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        i, j = ci + cells[c, 0], cj + cells[c, 1]
        if not (0 <= i < w and 0 <= j < h and bottom[i, j] < np.inf):
            missing -= 1
            if missing < 0:
                return covered, 0.0, np.inf, np.inf
            continue
        z = float(top[i, j])
        if covered == 0:
            base = z
        covered += 1
        highest = max(highest, z)
        x, y = offsets[c, 0], offsets[c, 1]
        # Less the first height: differences keep their digits when they are squared and subtracted.
        z -= base
        sz += z
        sx += x
        sy += y
        sxx += x * x
        sxy += x * y
        syy += y * y
        sxz += x * z
        syz += y * z
    if covered < 3:
        return covered, highest, np.inf, np.inf
    sxx -= sx * sx / covered
    sxy -= sx * sy / covered
    syy -= sy * sy / covered
    sxz -= sx * sz / covered
    syz -= sy * sz / covered
    determinant = sxx * syy - sxy * sxy
    if determinant <= 1e-9 * sxx * syy:
        return covered, highest, np.inf, np.inf
    gx = (syy * sxz - sxy * syz) / determinant
    gy = (sxx * syz - sxy * sxz) / determinant
    low, high = np.inf, -np.inf
    for c in range(n):
        i, j = ci + cells[c, 0], cj + cells[c, 1]
        if 0 <= i < w and 0 <= j < h and bottom[i, j] < np.inf:
            rest = top[i, j] - base - gx * offsets[c, 0] - gy * offsets[c, 1]
            low, high = min(low, rest), max(high, rest)
            if high - low > relief:
                return covered, highest, hypot(gx, gy), np.inf
    return covered, highest, hypot(gx, gy), high - low


@compiled
def _hopeless(top, bottom, ci, cj, cells, offsets, pairs, slope, relief):  # type: ignore[no-untyped-def]
    """Whether a few cells alone show that a spot is too steep or too uneven; never wrong.

    Heights are plane plus rest, and two rests differ by at most the relief. So the heights at opposite cells
    ±d differ by at most 2 |d| slope + relief, and their mean is at most the relief from the middle's.
    Cells outside the footprint say nothing.
    """
    w, h = top.shape
    if not (0 <= ci < w and 0 <= cj < h and bottom[ci, cj] < np.inf):
        return False
    middle = float(top[ci, cj])
    for p in range(pairs):
        i, j = cells[p, 0], cells[p, 1]
        if not (0 <= ci - i < w and 0 <= ci + i < w and 0 <= cj - j < h and 0 <= cj + j < h):
            continue
        if not (bottom[ci - i, cj - j] < np.inf and bottom[ci + i, cj + j] < np.inf):
            continue
        a, b = float(top[ci + i, cj + j]), float(top[ci - i, cj - j])
        across = 2.0 * hypot(offsets[p, 0], offsets[p, 1]) * slope + relief
        if abs(a - b) > across + 1e-9 or abs(a + b - 2.0 * middle) > 2.0 * relief + 1e-9:
            return True
    return False


@compiled
def by_distance(bottom, x, y):  # type: ignore[no-untyped-def]
    """Footprint cells by their distance from a point, nearest first, in whole cells; then row by row.

    Args:
        bottom: (w, h) infinite outside the footprint.
        x: of the point, in cells.
        y: likewise.

    Returns:
        (n,) flat indices.
    """
    w, h = bottom.shape
    count = np.zeros(w + h + 2, dtype=np.int64)
    ring = np.full(w * h, -1, dtype=np.int64)
    for i in range(w):
        for j in range(h):
            if bottom[i, j] < np.inf:
                r = min(w + h, int(sqrt((i + 0.5 - x) ** 2 + (j + 0.5 - y) ** 2)))
                ring[i * h + j] = r
                count[r + 1] += 1
    start = np.cumsum(count)
    ordered = np.empty(start[-1], dtype=np.int64)
    for k in range(w * h):
        if ring[k] >= 0:
            ordered[start[ring[k]]] = k
            start[ring[k]] += 1
    return ordered


@compiled
def flat_spots(  # type: ignore[no-untyped-def]
    top, bottom, order, cells, offsets, cell, relief, slope, apart, spots, found
):
    """Add flat spots in the given order, each at least ``apart`` from those before it.

    Args:
        top: as in :func:`seal`.
        bottom: likewise.
        order: (n,) flat indices of the cells whose centres are tried.
        cells: (m, 2) cells under a cup on the centre of cell (0, 0), those at its lip first.
        offsets: (m, 2) as in :func:`disc_cells`, m.
        cell: cell size, m.
        relief: largest height above the best plane less the smallest, m.
        slope: of the best plane, at most.
        apart: m.
        spots: (limit, 5) x, y, highest, slope, relief; the first ``found`` are there already.
        found: how many there are.

    Returns:
        How many there are now.
    """
    h = top.shape[1]
    m = cells.shape[0]
    for k in order:
        if found == spots.shape[0]:
            break
        i, j = k // h, k % h
        x, y = (i + 0.5) * cell, (j + 0.5) * cell
        free = True
        for s in range(found):
            free = free and hypot(x - spots[s, 0], y - spots[s, 1]) >= apart
        if not free:
            continue
        if _hopeless(top, bottom, i, j, cells, offsets, PAIRS, slope, relief):
            continue
        covered, highest, tilt, rest = seal(top, bottom, i, j, cells, offsets, m, relief)
        if covered == m and tilt <= slope and rest <= relief:
            spots[found, 0] = x
            spots[found, 1] = y
            spots[found, 2] = highest
            spots[found, 3] = tilt
            spots[found, 4] = rest
            found += 1
    return found


@compiled
def rough_spots(  # type: ignore[no-untyped-def]
    top, bottom, order, cells, offsets, cell, radius, relief, slope, least, apart, spots
):
    """Find the spots on which a soft cup seals best, each at least ``apart`` from the better ones.

    What the lip has to take up is the relief and the tilt over its diameter; a spot that is wholly covered
    goes before one that is not. Arguments are as in :func:`flat_spots`; ``least`` as in :func:`seal`.

    Returns:
        How many there are.
    """
    h = top.shape[1]
    m = cells.shape[0]
    values = np.empty((order.size, 5))
    costs = np.empty(order.size)
    n = 0
    for k in order:
        i, j = k // h, k % h
        if _hopeless(top, bottom, i, j, cells, offsets, PAIRS, slope, relief):
            continue
        covered, highest, tilt, rest = seal(top, bottom, i, j, cells, offsets, least, relief)
        if covered >= least and tilt <= slope and rest <= relief:
            values[n, 0] = (i + 0.5) * cell
            values[n, 1] = (j + 0.5) * cell
            values[n, 2] = highest
            values[n, 3] = tilt
            values[n, 4] = rest
            costs[n] = rest + 2.0 * radius * tilt + (0.0 if covered == m else 1.0)
            n += 1
    found = 0
    while found < spots.shape[0] and n > 0:
        best = np.argmin(costs[:n])
        if costs[best] == np.inf:
            break
        spots[found] = values[best]
        for c in range(n):
            if hypot(values[c, 0] - spots[found, 0], values[c, 1] - spots[found, 1]) < apart:
                costs[c] = np.inf
        costs[best] = np.inf
        found += 1
    return found


@compiled
def meets_box(ends, radii, low, high, pieces, hit):  # type: ignore[no-untyped-def]
    """Whether any capsule meets a box with parallel axes; conservative.

    Each capsule is covered by ``pieces`` balls, so it may be called a hit up to half a piece of its axis
    outside the box, never the other way.

    Args:
        ends: (k, m, p, 2, 3) axis ends along k paths of m poses, m.
        radii: (p,) m.
        low: (m, 3) lowest corner of the box at each pose, m.
        high: (m, 3) highest.
        pieces: balls for each capsule.
        hit: (k,) bool, overwritten: some capsule meets the box at some pose.
    """
    for k in range(ends.shape[0]):
        hit[k] = False
        for m in range(ends.shape[1]):
            for p in range(radii.size):
                a, b = ends[k, m, p, 0], ends[k, m, p, 1]
                apart = False
                for d in range(3):
                    beyond = min(a[d], b[d]) - radii[p] > high[m, d]
                    apart = apart or beyond or max(a[d], b[d]) + radii[p] < low[m, d]
                if apart:
                    continue
                length = sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
                reach = radii[p] + 0.5 * length / pieces
                for s in range(pieces):
                    t = (s + 0.5) / pieces
                    total = 0.0
                    for d in range(3):
                        v = a[d] + t * (b[d] - a[d])
                        gap = max(low[m, d] - v, v - high[m, d], 0.0)
                        total += gap * gap
                    if total < reach * reach:
                        hit[k] = True
                        break
                if hit[k]:
                    break
            if hit[k]:
                break
