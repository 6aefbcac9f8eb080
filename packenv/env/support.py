"""How well the cells below carry an item: a quick figure of the heightmaps, no test of stability."""

from __future__ import annotations

import math

import numpy as np

from packenv.kernels import compiled


@compiled
def support_margin(heights, bottom, ix, iy, z, gap, cell, x, y):  # type: ignore[no-untyped-def]
    """How far inside the convex hull of the supported cells a point lies, seen from above.

    A footprint cell is supported where the item's bottom is within ``gap`` of the container heightmap; its
    whole square belongs to the hull.

    Args:
        heights: (nx, ny) container heightmap, m.
        bottom: (w, h) bottom heightmap of the item, m; +inf outside the footprint.
        ix: cell of the item's smallest x.
        iy: cell of the item's smallest y.
        z: height of its lowest point, m.
        gap: m.
        cell: side of a cell, m.
        x: of the point in the item's own frame, m.
        y: of the point in the item's own frame, m.

    Returns:
        distance to the hull's boundary, m, negative outside; minus infinity where no cell is supported.
    """
    w, h = bottom.shape
    # Of each row of cells only the ends can be corners of the hull: four corners a row.
    low = np.empty(w + 1, dtype=np.int64)
    high = np.empty(w + 1, dtype=np.int64)
    low[:] = h + 1
    high[:] = -1
    for i in range(w):
        for j in range(h):
            if z + bottom[i, j] - heights[ix + i, iy + j] <= gap:
                for k in (i, i + 1):
                    low[k] = min(low[k], j)
                    high[k] = max(high[k], j + 1)
    hull = np.empty((2 * (w + 1) + 1, 2), dtype=np.float64)
    n = 0
    for side in (1, -1):
        start = n
        for row in range(w + 1):
            i = row if side == 1 else w - row
            if high[i] < 0:
                continue
            px = i * cell
            py = (low[i] if side == 1 else high[i]) * cell
            while n - start >= 2:
                ax = hull[n - 1, 0] - hull[n - 2, 0]
                ay = hull[n - 1, 1] - hull[n - 2, 1]
                if ax * (py - hull[n - 1, 1]) - ay * (px - hull[n - 1, 0]) <= 0.0:
                    n -= 1
                else:
                    break
            hull[n, 0] = px
            hull[n, 1] = py
            n += 1
    if n == 0:
        return -math.inf
    inside = math.inf
    nearest = math.inf
    for k in range(n):
        ax, ay = hull[k]
        bx, by = hull[(k + 1) % n]
        ex, ey = bx - ax, by - ay
        length = math.hypot(ex, ey)
        if length == 0.0:
            continue
        inside = min(inside, (ex * (y - ay) - ey * (x - ax)) / length)
        t = min(max((ex * (x - ax) + ey * (y - ay)) / length**2, 0.0), 1.0)
        nearest = min(nearest, math.hypot(x - ax - t * ex, y - ay - t * ey))
    return inside if inside >= 0.0 else -nearest
