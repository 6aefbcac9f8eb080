"""Compiled kernels that evaluate one orientation at every translation of the grid at once.

Translations advance by ``step`` cells, so the container cells that one footprint cell meets are
``step`` apart: strided loads, which no vector unit likes. The container heightmap is therefore
stored *polyphase*: ``step`` × ``step`` sub-grids, each holding the cells of one residue class
contiguously. For one footprint cell, all translations then read one contiguous run, and the loop over
translations is a plain vector loop. The translations go through in blocks small enough that the block
of results and the window of the map stay in the first-level cache.

Heights are multiples of ``HEIGHT_QUANTUM`` and sums in float32 are emptied into float64 before they
can pass 16 m, so every result is exact and equal to the reference whatever the order of summation.
"""

from __future__ import annotations

import numpy as np
from numpy import float32, float64

from packenv.kernels import compiled, compiled_like_numpy

_BLOCK = 1024


@compiled
def polyphase(heights, step, wall, flat, rows, stride):  # type: ignore[no-untyped-def]
    """Store a heightmap as sub-grids, with a margin of ``step`` cells at the height of the walls.

    Args:
        heights: (nx, ny) float32, m.
        step: cells between translations.
        wall: height of the walls, m.
        flat: (step * step * rows * stride,) float32, filled in place.
        rows: sub-grid cells along x, margin included.
        stride: sub-grid cells along y, margin included.
    """
    nx, ny = heights.shape
    size = rows * stride
    for p in range(step):
        for q in range(step):
            base = (p * step + q) * size
            for a in range(rows):
                i = (a - 1) * step + p
                for b in range(stride):
                    j = (b - 1) * step + q
                    if 0 <= i < nx and 0 <= j < ny:
                        flat[base + a * stride + b] = heights[i, j]
                    else:
                        flat[base + a * stride + b] = wall


@compiled
def cell_offset(i, j, step, rows, stride):  # type: ignore[no-untyped-def]
    """Index, at translation 0, of footprint cell (i, j) in the polyphase map; i, j ≥ -step."""
    i += step
    j += step
    phase = (i % step) * step + j % step
    return (phase * rows + i // step) * stride + j // step


@compiled
def footprint_cells(bottom, step, rows, stride, offsets, bottoms):  # type: ignore[no-untyped-def]
    """List the footprint cells of an orientation, sub-grid by sub-grid.

    Returns:
        The number of cells n; ``offsets[:n]`` (:func:`cell_offset`) and ``bottoms[:n]`` are filled.
    """
    w, h = bottom.shape
    n = 0
    for p in range(step):
        for q in range(step):
            row = cell_offset(p, q, step, rows, stride)
            for i in range(p, w, step):
                at = row
                for j in range(q, h, step):
                    if bottom[i, j] < float32(1e30):
                        offsets[n] = at
                        bottoms[n] = bottom[i, j]
                        n += 1
                    at += 1
                row += stride
    return n


@compiled
def side_cells(bottom, step, rows, stride, own, beside):  # type: ignore[no-untyped-def]
    """List the footprint cells that have a side neighbour outside the footprint, once for each side.

    Returns:
        The number of sides n; ``own[:n]`` (flat cell index i * h + j) and ``beside[:n]`` (offset of the
        neighbour in the polyphase map) are filled.
    """
    w, h = bottom.shape
    n = 0
    for i in range(w):
        for j in range(h):
            if not bottom[i, j] < float32(1e30):
                continue
            for side in range(4):
                a = i + (1 if side == 0 else 0) - (1 if side == 1 else 0)
                b = j + (1 if side == 2 else 0) - (1 if side == 3 else 0)
                if 0 <= a < w and 0 <= b < h and bottom[a, b] < float32(1e30):
                    continue
                own[n] = i * h + j
                beside[n] = cell_offset(a, b, step, rows, stride)
                n += 1
    return n


@compiled
def lowest_at(heights, bottom, ix, iy):  # type: ignore[no-untyped-def]
    """Lowest height at which an item at one place is above everything: max over its footprint of H_c - H_b, m.

    The footprint must lie inside the map.
    """
    lowest = 0.0
    w, h = bottom.shape
    for i in range(w):
        for j in range(h):
            lowest = max(lowest, float64(heights[ix + i, iy + j]) - float64(bottom[i, j]))
    return lowest


@compiled_like_numpy
def lowest_z(flat, offsets, bottoms, n, z):  # type: ignore[no-untyped-def]
    """Lowest collision-free height at every translation: max over the footprint of H_c - H_b.

    Paper Sec. IV-B. ``z`` (translations,) float32 is overwritten.
    """
    for t0 in range(0, z.size, _BLOCK):
        m = min(_BLOCK, z.size - t0)
        out = z[t0 : t0 + m]
        out[:] = float32(0.0)
        k = 0
        while k + 4 <= n:
            a = offsets[k] + t0
            b = offsets[k + 1] + t0
            c = offsets[k + 2] + t0
            d = offsets[k + 3] + t0
            ha, hb, hc, hd = flat[a : a + m], flat[b : b + m], flat[c : c + m], flat[d : d + m]
            ba, bb, bc, bd = bottoms[k], bottoms[k + 1], bottoms[k + 2], bottoms[k + 3]
            for t in range(m):
                va = ha[t] - ba
                vb = hb[t] - bb
                vc = hc[t] - bc
                vd = hd[t] - bd
                va = va if va > vb else vb
                vc = vc if vc > vd else vd
                va = va if va > vc else vc
                v = out[t]
                out[t] = va if va > v else v
            k += 4
        while k < n:
            a = offsets[k] + t0
            ha = flat[a : a + m]
            ba = bottoms[k]
            for t in range(m):
                va = ha[t] - ba
                v = out[t]
                out[t] = va if va > v else v
            k += 1


@compiled
def row_prefix_sums(heights, step, flat, rows, stride):  # type: ignore[no-untyped-def]
    """Running sums of each heightmap row along y, stored polyphase like the map itself.

    Entry (i, j) is the sum of the cells (i, 0) to (i, j - 1), so a run of cells [j0, j1) of row i sums to
    entry (i, j1) less entry (i, j0).

    Args:
        heights: (nx, ny) float32, m.
        step: cells between translations.
        flat: (step * step * rows * stride,) float64, filled in place.
        rows: sub-grid cells along x, margin included.
        stride: sub-grid cells along y, margin included.
    """
    nx, ny = heights.shape
    size = rows * stride
    flat[:] = 0.0
    for i in range(nx):
        base = ((i % step) * step * rows + i // step + 1) * stride
        total = 0.0
        for j in range(ny + 1):
            flat[base + (j % step) * size + j // step + 1] = total
            if j < ny:
                total += float64(heights[i, j])


@compiled
def footprint_runs(bottom, step, rows, stride, starts, ends):  # type: ignore[no-untyped-def]
    """List the runs of footprint cells along y, as offsets in the polyphase map of prefix sums.

    Returns:
        The number of runs n; ``starts[:n]`` and ``ends[:n]`` are filled.
    """
    w, h = bottom.shape
    n = 0
    for i in range(w):
        inside = False
        for j in range(h):
            touched = bottom[i, j] < float32(1e30)
            if touched and not inside:
                starts[n] = cell_offset(i, j, step, rows, stride)
            if inside and not touched:
                ends[n] = cell_offset(i, j, step, rows, stride)
                n += 1
            inside = touched
        if inside:
            ends[n] = cell_offset(i, h, step, rows, stride)
            n += 1
    return n


@compiled_like_numpy
def footprint_sums(prefix, starts, ends, n, total):  # type: ignore[no-untyped-def]
    """Sum of the container heightmap over the footprint at every translation.

    Args:
        prefix: polyphase map of the row prefix sums, float64.
        starts: (n,) offsets where runs of footprint cells begin.
        ends: (n,) offsets behind their last cells.
        n: number of runs.
        total: (translations,) float64, overwritten, m.
    """
    for t0 in range(0, total.size, _BLOCK):
        m = min(_BLOCK, total.size - t0)
        out = total[t0 : t0 + m]
        out[:] = 0.0
        for k in range(n):
            a = starts[k] + t0
            b = ends[k] + t0
            first = prefix[a : a + m]
            last = prefix[b : b + m]
            for t in range(m):
                out[t] += last[t] - first[t]


@compiled_like_numpy
def touched_cells(flat, offsets, bottoms, n, z, gap, total):  # type: ignore[no-untyped-def]
    """Number of footprint cells whose bottom is within ``gap`` of the container heightmap.

    Args:
        flat: polyphase map.
        offsets: (n,) of the footprint cells.
        bottoms: (n,) bottom heightmap of the same cells, m.
        n: number of cells.
        z: (translations,) float32.
        gap: largest gap that counts as contact, m.
        total: (translations,) float64, overwritten, cells.
    """
    one = float32(1.0)
    zero = float32(0.0)
    part = np.empty(_BLOCK, dtype=np.float32)
    for t0 in range(0, z.size, _BLOCK):
        m = min(_BLOCK, z.size - t0)
        low = z[t0 : t0 + m]
        acc = part[:m]
        acc[:] = zero
        for k in range(n):
            a = offsets[k] + t0
            ha = flat[a : a + m]
            limit = float32(gap) - bottoms[k]
            for t in range(m):
                acc[t] += one if low[t] - ha[t] <= limit else zero
        for t in range(m):
            total[t0 + t] = float64(acc[t])


@compiled_like_numpy
def touched_sides(flat, tops, bottoms, own, beside, n, z, flush, total):  # type: ignore[no-untyped-def]
    """Summed height of the item's sides that face filled columns or walls in the next cell.

    Args:
        flat: polyphase map.
        tops: (w * h,) top heightmap, m.
        bottoms: (w * h,) bottom heightmap, m.
        own: (n,) index of the footprint cell of each side.
        beside: (n,) offset of the cell beside it.
        n: number of sides.
        z: (translations,) float32.
        flush: terms that can be summed in float32 without passing 16 m.
        total: (translations,) float64, overwritten, m.
    """
    zero = float32(0.0)
    part = np.empty(_BLOCK, dtype=np.float32)
    for t0 in range(0, z.size, _BLOCK):
        m = min(_BLOCK, z.size - t0)
        low = z[t0 : t0 + m]
        out = total[t0 : t0 + m]
        acc = part[:m]
        acc[:] = zero
        out[:] = 0.0
        held = 0
        for k in range(n):
            a = beside[k] + t0
            ha = flat[a : a + m]
            span_top = tops[own[k]]
            span_bottom = bottoms[own[k]]
            if held + 1 > flush:
                for t in range(m):
                    out[t] += float64(acc[t])
                acc[:] = zero
                held = 0
            for t in range(m):
                upper = low[t] + span_top
                upper = upper if upper < ha[t] else ha[t]
                length = upper - (low[t] + span_bottom)
                acc[t] += length if length > zero else zero
            held += 1
        for t in range(m):
            out[t] += float64(acc[t])
