"""Compiled kernels that rasterize a triangle mesh into conservative heightmaps.

Sampling the surface at cell centres misses whatever passes between them, and nearly every plan made
from such maps overlaps. Here each triangle is clipped to each cell that it touches, and the extremes
of the clipped polygon are exact, so a map bounds the surface over the whole cell.

Clipping every triangle to every cell is that definition, word for word. :func:`rasterize` finds the same
extremes without the polygons, 2.5 times as fast on scans of 16,000 triangles. A corner of triangle ∩ cell is a vertex,
or where an edge crosses a line between cells, or a corner of the cell inside the triangle; each is computed
once, not once for every triangle and cell that it belongs to. What the tolerance decides is left to the
definition: a triangle with a vertex or a crossing that is so close to a line goes through the clipping.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from packenv.kernels import compiled, compiled_like_numpy

TOUCH_TOLERANCE = 1e-6
"""A surface that reaches less than this far (m) into a cell does not touch it.

Without it a 100 mm box whose corner is at 100.000000001 mm would fill a 51st cell. Two items can
therefore overlap by at most 2 µm, which is ten times below the audit's clearance.
"""

_CLOSE = 2 * TOUCH_TOLERANCE
"""So close (m) to a line of cells, the tolerance may have a say; farther away it has none."""


@compiled
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


@compiled
def cell_range(lo, hi, cell, count, normal):  # type: ignore[no-untyped-def]
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


@compiled
def clip_triangle(triangle, cell, top, bottom, poly_a, poly_b, poly_c):  # type: ignore[no-untyped-def]
    """Clip one triangle to every cell that it touches; the polygons are scratch of 12 corners each."""
    w, h = top.shape
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
    i0, i1 = cell_range(x_lo, x_hi, cell, w, normal_x)
    j0, j1 = cell_range(y_lo, y_hi, cell, h, normal_y)
    if i0 == i1 and j0 == j1:
        z_lo = min(triangle[0, 2], triangle[1, 2], triangle[2, 2])
        z_hi = max(triangle[0, 2], triangle[1, 2], triangle[2, 2])
        top[i0, j0] = max(top[i0, j0], z_hi)
        bottom[i0, j0] = min(bottom[i0, j0], z_lo)
        return
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
        s0, s1 = cell_range(slab_lo, slab_hi, cell, h, normal_y)
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


@compiled
def _tell(top, bottom, i, j, z):  # type: ignore[no-untyped-def]
    """Widen the extremes of a cell; without branches, which nobody could predict."""
    high, low = top[i, j], bottom[i, j]
    top[i, j] = z if z > high else high
    bottom[i, j] = z if z < low else low


@compiled_like_numpy
def rasterize(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    edges: NDArray[np.int64],
    face_edges: NDArray[np.int64],
    cell: float,
    top: NDArray[np.float64],
    bottom: NDArray[np.float64],
) -> None:
    """Raise ``top`` and lower ``bottom`` to the exact extremes of the surface over every cell.

    Args:
        vertices: (n, 3) in the oriented frame, smallest x and y at 0, m.
        faces: (m, 3) vertex indices, counter-clockwise from outside.
        edges: (k, 2) vertex indices of every edge, once.
        face_edges: (m, 3) the edges of each face, in any order.
        cell: side of a cell, m.
        top: (w, h) to be raised in place; start it at -inf.
        bottom: (w, h) to be lowered in place; start it at +inf.
    """
    per_cell = 1.0 / cell
    close = _CLOSE * per_cell
    # The cell of each vertex; column -1 where it is so close to a line that the tolerance may have a say.
    cell_x = np.empty(vertices.shape[0], dtype=np.int64)
    cell_y = np.empty(vertices.shape[0], dtype=np.int64)
    for v in range(vertices.shape[0]):
        x, y = vertices[v, 0] * per_cell, vertices[v, 1] * per_cell
        i, j = int(x), int(y)
        beyond_x, beyond_y = x - i, y - j
        clear = (beyond_x > close) & (beyond_x < 1.0 - close) & (beyond_y > close) & (beyond_y < 1.0 - close)
        cell_x[v] = i if clear else -1
        cell_y[v] = j

    crossings = 0
    for e in range(edges.shape[0]):
        crossings += abs(cell_x[edges[e, 0]] - cell_x[edges[e, 1]])
    # Where edges cross lines of constant x; those of one edge one after another, by growing x.
    cross_y, cross_z = np.empty(crossings), np.empty(crossings)
    cross_j = np.empty(crossings, dtype=np.int64)
    first = np.empty(edges.shape[0], dtype=np.int64)
    n = 0
    for e in range(edges.shape[0]):
        p, q = edges[e, 0], edges[e, 1]
        if cell_x[p] > cell_x[q]:
            p, q = q, p
        i, last, j = cell_x[p], cell_x[q], cell_y[p]
        if i < 0:
            first[e] = -1
            continue
        x, y, z = vertices[p, 0], vertices[p, 1], vertices[p, 2]
        clear = True
        first[e] = n
        if i < last:
            run = 1.0 / (vertices[q, 0] - x)
            slope_y, slope_z = (vertices[q, 1] - y) * run, (vertices[q, 2] - z) * run
            for k in range(i + 1, last + 1):
                ahead = k * cell - x
                at = y + ahead * slope_y
                scaled = at * per_cell
                cross_y[n] = at
                cross_z[n] = z + ahead * slope_z
                cross_j[n] = int(scaled)
                clear &= (scaled - int(scaled) > close) & (scaled - int(scaled) < 1.0 - close)
                n += 1
        if not clear:
            n = first[e]
            first[e] = -1
            continue
        _tell(top, bottom, i, j, z)
        _tell(top, bottom, last, cell_y[q], vertices[q, 2])
        for k in range(i, last + 1):
            # Column k holds the edge from (y, z) to (y_to, z_to).
            if k == last:
                y_to, z_to, j_to = vertices[q, 1], vertices[q, 2], cell_y[q]
            else:
                at = first[e] + k - i
                y_to, z_to, j_to = cross_y[at], cross_z[at], cross_j[at]
                _tell(top, bottom, k, j_to, z_to)
                _tell(top, bottom, k + 1, j_to, z_to)
            if j_to != j:
                slope = (z_to - z) / (y_to - y)
                for line in range(min(j, j_to) + 1, max(j, j_to) + 1):
                    height = z + (line * cell - y) * slope
                    _tell(top, bottom, k, line - 1, height)
                    _tell(top, bottom, k, line, height)
            y, z, j = y_to, z_to, j_to

    triangle = np.empty((3, 3))
    poly_a = np.empty((12, 3))
    poly_b = np.empty((12, 3))
    poly_c = np.empty((12, 3))
    for f in range(faces.shape[0]):
        ea, eb, ec = face_edges[f, 0], face_edges[f, 1], face_edges[f, 2]
        if first[ea] < 0 or first[eb] < 0 or first[ec] < 0:
            for c in range(3):
                for k in range(3):
                    triangle[c, k] = vertices[faces[f, c], k]
            clip_triangle(triangle, cell, top, bottom, poly_a, poly_b, poly_c)
            continue
        ia, ib, ic = cell_x[faces[f, 0]], cell_x[faces[f, 1]], cell_x[faces[f, 2]]
        i0, i1 = min(ia, ib, ic), max(ia, ib, ic)
        if i0 == i1:
            continue
        # A line of constant x crosses two of the edges: the longest, called a, and b or c.
        span_b = abs(cell_x[edges[eb, 0]] - cell_x[edges[eb, 1]])
        if span_b == i1 - i0:
            ea, eb = eb, ea
        elif abs(cell_x[edges[ec, 0]] - cell_x[edges[ec, 1]]) == i1 - i0:
            ea, ec = ec, ea
        b0 = min(cell_x[edges[eb, 0]], cell_x[edges[eb, 1]])
        b1 = max(cell_x[edges[eb, 0]], cell_x[edges[eb, 1]])
        c0 = min(cell_x[edges[ec, 0]], cell_x[edges[ec, 1]])
        for i in range(i0 + 1, i1 + 1):
            a = first[ea] + i - i0 - 1
            b = first[eb] + i - b0 - 1 if b0 < i <= b1 else first[ec] + i - c0 - 1
            j, j_to = cross_j[a], cross_j[b]
            if j == j_to:
                continue
            y, z = cross_y[a], cross_z[a]
            slope = (cross_z[b] - z) / (cross_y[b] - y)
            for line in range(min(j, j_to) + 1, max(j, j_to) + 1):
                height = z + (line * cell - y) * slope
                _tell(top, bottom, i - 1, line - 1, height)
                _tell(top, bottom, i - 1, line, height)
                _tell(top, bottom, i, line - 1, height)
                _tell(top, bottom, i, line, height)


@compiled
def settle(vertices, low, extents):  # type: ignore[no-untyped-def]
    """Move vertices (n, 3) so that the smallest x, y and z are 0; ``low`` and ``extents`` (3,) are filled."""
    for k in range(3):
        low[k] = np.inf
        extents[k] = -np.inf
    for v in range(vertices.shape[0]):
        for k in range(3):
            low[k] = min(low[k], vertices[v, k])
            extents[k] = max(extents[k], vertices[v, k])
    for k in range(3):
        extents[k] -= low[k]
    for v in range(vertices.shape[0]):
        for k in range(3):
            vertices[v, k] -= low[k]


@compiled_like_numpy
def round_outward(top, bottom, quantum, noise, tops, bottoms):  # type: ignore[no-untyped-def]
    """Round the extremes of :func:`rasterize` outward to whole quanta.

    Args:
        top: (w, h) m.
        bottom: (w, h) m; +inf outside the footprint.
        quantum: m, a power of two.
        noise: a height this little past a quantum is that quantum, m.
        tops: (w, h) float32, overwritten; 0 outside the footprint.
        bottoms: (w, h) float32, overwritten; +inf outside the footprint.
    """
    for i in range(top.shape[0]):
        for j in range(top.shape[1]):
            if bottom[i, j] < np.inf:
                tops[i, j] = np.ceil((top[i, j] - noise) / quantum) * quantum
                bottoms[i, j] = np.floor((bottom[i, j] + noise) / quantum) * quantum
            else:
                tops[i, j] = 0.0
                bottoms[i, j] = np.inf


@compiled
def spread_back(top, bottom, along_x, along_y, tops, bottoms):  # type: ignore[no-untyped-def]
    """The extremes of each cell and of those before it, as an item moved by less than a cell shows.

    Args:
        top: (w, h) m; 0 outside the footprint.
        bottom: (w, h) m; +inf outside the footprint.
        along_x: whether it is moved along x.
        along_y: likewise along y.
        tops: (w or w + 1, h or h + 1), filled, m.
        bottoms: likewise.
    """
    w, h = top.shape
    for i in range(tops.shape[0]):
        for j in range(tops.shape[1]):
            highest, lowest = np.float32(0.0), np.float32(np.inf)
            for a in range(max(0, i - 1 if along_x else i), min(i + 1, w)):
                for b in range(max(0, j - 1 if along_y else j), min(j + 1, h)):
                    highest = max(highest, top[a, b])
                    lowest = min(lowest, bottom[a, b])
            tops[i, j], bottoms[i, j] = highest, lowest
