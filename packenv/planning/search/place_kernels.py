"""Compiled loops over places of one orientation that are not all on one grid."""

from __future__ import annotations

from math import ceil, floor

import numpy as np
from numpy import float32

from packenv.kernels import compiled

_ROUNDING = 1e-3
"""Share of a cell that is taken for rounding."""


@compiled
def flush_places(sides, length, width, ex, ey, hair, places):  # type: ignore[no-untyped-def]
    """Places at which two sides of an item lie against walls or against sides of placed items.

    Along each axis an item may lie before or behind a placed one, or at a wall. Of the pairs of an x and a y those
    count whose owners the item then faces. Besides, an item may be centred over a placed one, as nested ones are.

    Args:
        sides: (n, 4) smallest x, y and largest x, y of the placed items, m.
        length: of the container along x, m.
        width: likewise along y.
        ex: extent of the item along x, m.
        ey: likewise along y.
        hair: how far it may reach over a wall, m.
        places: ((2 n + 2)² + n, 2) x and y, filled, m.

    Returns:
        The number of places; some may be there twice.
    """
    n = sides.shape[0]
    sizes, own = (length, width), (ex, ey)
    # Value, and the interval along the other axis that the item has to reach into.
    options = np.empty((2, 2 * n + 2, 3))
    counts = np.zeros(2, dtype=np.int64)
    for axis in range(2):
        last = sizes[axis] - own[axis]
        for k in range(2 * n + 2):
            low, high = -np.inf, np.inf
            if k < 2:
                value = 0.0 if k == 0 else max(last, 0.0)
            else:
                item = sides[(k - 2) // 2]
                value = item[2 + axis] if k % 2 == 0 else item[axis] - own[axis]
                low, high = item[1 - axis], item[3 - axis]
            if 0.0 <= value <= last + hair or k == 0:
                options[axis, counts[axis], 0] = value
                options[axis, counts[axis], 1] = low
                options[axis, counts[axis], 2] = high
                counts[axis] += 1
    found = 0
    for a in range(counts[0]):
        x, low_y, high_y = options[0, a]
        for b in range(counts[1]):
            y, low_x, high_x = options[1, b]
            if y < high_y and y + ey > low_y and x < high_x and x + ex > low_x:
                places[found, 0], places[found, 1] = x, y
                found += 1
    for k in range(n):
        x = 0.5 * (sides[k, 0] + sides[k, 2] - ex)
        y = 0.5 * (sides[k, 1] + sides[k, 3] - ey)
        if 0.0 <= x <= length - ex + hair and 0.0 <= y <= width - ey + hair:
            places[found, 0], places[found, 1] = x, y
            found += 1
    return found


@compiled
def heights_at(heights, bottom, cell, ex, ey, places, whole, most, z):  # type: ignore[no-untyped-def]
    """How low an item comes at each place, by the heightmaps.

    Args:
        heights: (nx, ny) container heightmap, m.
        bottom: (w, h) bottom heightmap of the item at the edge of its first cell, m.
        cell: cell size, m.
        ex: extent of the item along x, m.
        ey: likewise along y.
        places: (n, 2) smallest x and y, m.
        whole: True where all places are at edges of cells: the heights are then bounds. Else only the cells that the
            item covers from side to side are looked at, as if it began at the nearest edge: an estimate, since
            the cells at its sides are shared with what it lies against.
        most: what is higher is of no use, m.
        z: (n,) float64, filled, m; infinite where there is no use.
    """
    nx, ny = heights.shape
    w, h = bottom.shape
    row = np.empty(h + 1, dtype=np.float32)
    for p in range(places.shape[0]):
        ax, ay = places[p, 0] / cell, places[p, 1] / cell
        sx, sy = floor(ax + 0.5), floor(ay + 0.5)
        if whole:
            i0, i1, j0, j1 = sx, sx + w, sy, sy + h
        else:
            i0, i1 = ceil(ax - _ROUNDING), floor(ax + ex / cell + _ROUNDING)
            j0, j1 = ceil(ay - _ROUNDING), floor(ay + ey / cell + _ROUNDING)
            # Less than a cell wide: all of it counts.
            if i0 >= i1:
                i0, i1 = sx, sx + 1
            if j0 >= j1:
                j0, j1 = sy, sy + 1
        i0, i1 = max(i0, sx), min(i1, nx, sx + w)
        j0, j1 = max(j0, sy), min(j1, ny, sy + h)
        best = float32(0.0)
        m = j1 - j0
        for i in range(i0, i1):
            own = bottom[i - sx, j0 - sy : j1 - sy]
            under = heights[i, j0:j1]
            acc = row[:m]
            for j in range(m):
                acc[j] = under[j] - own[j]
            for j in range(m):
                best = max(best, acc[j])
            if best > most:
                break
        z[p] = np.inf if best > most else best


@compiled
def raised(heights, top, cell, places, z, total):  # type: ignore[no-untyped-def]
    """By how much all heights together grow at each place, as if the item began at the nearest edge of a cell.

    Args:
        heights: (nx, ny) container heightmap, m.
        top: (w, h) top heightmap of the item, m; 0 outside the footprint.
        cell: cell size, m.
        places: (n, 2) smallest x and y, m.
        z: (n,) heights of the lowest point, m.
        total: (n,) float64, filled, m.
    """
    nx, ny = heights.shape
    w, h = top.shape
    for p in range(places.shape[0]):
        sx, sy = floor(places[p, 0] / cell + 0.5), floor(places[p, 1] / cell + 0.5)
        grown = 0.0
        for i in range(min(w, nx - sx)):
            for j in range(min(h, ny - sy)):
                if top[i, j] > 0.0:
                    grown += max(0.0, z[p] + top[i, j] - heights[sx + i, sy + j])
        total[p] = grown


@compiled
def touched_area(heights, top, bottom, cell, wall, places, z, area):  # type: ignore[no-untyped-def]
    """Area that touches items, walls and floor at each place, as if the item began at the nearest edge of a cell.

    Args:
        heights: (nx, ny) container heightmap, m.
        top: (w, h) top heightmap of the item, m.
        bottom: (w, h) bottom heightmap, m; infinite outside the footprint.
        cell: cell size, m.
        wall: height of the walls, m.
        places: (n, 2) smallest x and y, m.
        z: (n,) heights of the lowest point, m.
        area: (n,) float64, filled, m².
    """
    nx, ny = heights.shape
    w, h = top.shape
    for p in range(places.shape[0]):
        sx, sy = floor(places[p, 0] / cell + 0.5), floor(places[p, 1] / cell + 0.5)
        below, beside = 0, 0.0
        for i in range(min(w, nx - sx)):
            for j in range(min(h, ny - sy)):
                if not bottom[i, j] < float32(1e30):
                    continue
                low = z[p] + bottom[i, j]
                if abs(low - heights[sx + i, sy + j]) <= cell / 2:
                    below += 1
                for side in range(4):
                    a = i + (1 if side == 0 else 0) - (1 if side == 1 else 0)
                    b = j + (1 if side == 2 else 0) - (1 if side == 3 else 0)
                    if 0 <= a < w and 0 <= b < h and bottom[a, b] < float32(1e30):
                        continue
                    inside = 0 <= sx + a < nx and 0 <= sy + b < ny
                    column = heights[sx + a, sy + b] if inside else wall
                    beside += max(0.0, min(z[p] + top[i, j], column) - low)
        area[p] = below * cell**2 + beside * cell
