"""Compiled kernel that rasterizes a triangle mesh into conservative heightmaps.

Sampling the surface at cell centres misses whatever passes between them, and nearly every plan made
from such maps overlaps. Here each triangle is clipped to each cell that it touches, and the extremes
of the clipped polygon are exact, so a map bounds the surface over the whole cell.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

TOUCH_TOLERANCE = 1e-6
"""A surface that reaches less than this far (m) into a cell does not touch it.

Without it a 100 mm box whose corner is at 100.000000001 mm would fill a 51st cell. Two items can
therefore overlap by at most 2 µm, which is ten times below the audit's clearance.
"""


@njit(cache=True, nogil=True)
def _clip(src, n, dst, axis, bound, keep_above):  # type: ignore[no-untyped-def]
    """Clip a convex polygon to one side of an axis-aligned plane (Sutherland-Hodgman)."""
    m = 0
    for a in range(n):
        b = a + 1 if a + 1 < n else 0
        da = src[a, axis] - bound
        db = src[b, axis] - bound
        if not keep_above:
            da = -da
            db = -db
        if da >= 0.0:
            dst[m, 0] = src[a, 0]
            dst[m, 1] = src[a, 1]
            dst[m, 2] = src[a, 2]
            m += 1
        if (da > 0.0 and db < 0.0) or (da < 0.0 and db > 0.0):
            s = da / (da - db)
            dst[m, 0] = src[a, 0] + s * (src[b, 0] - src[a, 0])
            dst[m, 1] = src[a, 1] + s * (src[b, 1] - src[a, 1])
            dst[m, 2] = src[a, 2] + s * (src[b, 2] - src[a, 2])
            dst[m, axis] = bound
            m += 1
    return m


@njit(cache=True, nogil=True)
def _cell_range(lo, hi, cell, count, normal):  # type: ignore[no-untyped-def]
    """First and last cell that the interval [lo, hi] reaches into by more than the tolerance.

    An interval that lies on a cell boundary reaches into neither cell; it goes to the cell on the
    inner side of the surface, which the outward normal tells.
    """
    first = math.floor((lo + TOUCH_TOLERANCE) / cell)
    last = math.ceil((hi - TOUCH_TOLERANCE) / cell) - 1
    if last < first:
        if normal > 0.0:
            first = last
        else:
            last = first
    first = min(max(first, 0), count - 1)
    last = min(max(last, 0), count - 1)
    return first, last


@njit(cache=True, nogil=True)
def rasterize(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    cell: float,
    top: NDArray[np.float64],
    bottom: NDArray[np.float64],
) -> None:
    """Raise ``top`` and lower ``bottom`` to the exact extremes of the surface over every cell.

    Args:
        vertices: (n, 3) in the oriented frame, smallest x and y at 0, m.
        faces: (m, 3) vertex indices, counter-clockwise from outside.
        cell: side of a cell, m.
        top: (w, h) to be raised in place; start it at -inf.
        bottom: (w, h) to be lowered in place; start it at +inf.
    """
    w, h = top.shape
    triangle = np.empty((3, 3))
    poly_a = np.empty((12, 3))
    poly_b = np.empty((12, 3))
    poly_c = np.empty((12, 3))
    for f in range(faces.shape[0]):
        for c in range(3):
            v = faces[f, c]
            triangle[c, 0] = vertices[v, 0]
            triangle[c, 1] = vertices[v, 1]
            triangle[c, 2] = vertices[v, 2]
        ax = triangle[1, 0] - triangle[0, 0]
        ay = triangle[1, 1] - triangle[0, 1]
        az = triangle[1, 2] - triangle[0, 2]
        bx = triangle[2, 0] - triangle[0, 0]
        by = triangle[2, 1] - triangle[0, 1]
        bz = triangle[2, 2] - triangle[0, 2]
        normal_x = ay * bz - az * by
        normal_y = az * bx - ax * bz
        x_lo = min(triangle[0, 0], triangle[1, 0], triangle[2, 0])
        x_hi = max(triangle[0, 0], triangle[1, 0], triangle[2, 0])
        y_lo = min(triangle[0, 1], triangle[1, 1], triangle[2, 1])
        y_hi = max(triangle[0, 1], triangle[1, 1], triangle[2, 1])
        i0, i1 = _cell_range(x_lo, x_hi, cell, w, normal_x)
        j0, j1 = _cell_range(y_lo, y_hi, cell, h, normal_y)
        if i0 == i1 and j0 == j1:
            z_lo = min(triangle[0, 2], triangle[1, 2], triangle[2, 2])
            z_hi = max(triangle[0, 2], triangle[1, 2], triangle[2, 2])
            top[i0, j0] = max(top[i0, j0], z_hi)
            bottom[i0, j0] = min(bottom[i0, j0], z_lo)
            continue
        for i in range(i0, i1 + 1):
            # The outermost slabs are not cut on their outer side: what reaches less than the tolerance
            # beyond them still counts here.
            n = 3
            for c in range(3):
                for k in range(3):
                    poly_a[c, k] = triangle[c, k]
            if i > i0:
                n = _clip(poly_a, n, poly_b, 0, i * cell, True)
                for c in range(n):
                    for k in range(3):
                        poly_a[c, k] = poly_b[c, k]
            if i < i1:
                n = _clip(poly_a, n, poly_b, 0, (i + 1) * cell, False)
                for c in range(n):
                    for k in range(3):
                        poly_a[c, k] = poly_b[c, k]
            if n == 0:
                continue
            slab_lo = poly_a[0, 1]
            slab_hi = poly_a[0, 1]
            for c in range(1, n):
                slab_lo = min(slab_lo, poly_a[c, 1])
                slab_hi = max(slab_hi, poly_a[c, 1])
            s0, s1 = _cell_range(slab_lo, slab_hi, cell, h, normal_y)
            for j in range(s0, s1 + 1):
                m = n
                for c in range(n):
                    for k in range(3):
                        poly_b[c, k] = poly_a[c, k]
                if j > s0:
                    m = _clip(poly_b, m, poly_c, 1, j * cell, True)
                    for c in range(m):
                        for k in range(3):
                            poly_b[c, k] = poly_c[c, k]
                if j < s1:
                    m = _clip(poly_b, m, poly_c, 1, (j + 1) * cell, False)
                    for c in range(m):
                        for k in range(3):
                            poly_b[c, k] = poly_c[c, k]
                for c in range(m):
                    top[i, j] = max(top[i, j], poly_b[c, 2])
                    bottom[i, j] = min(bottom[i, j], poly_b[c, 2])
