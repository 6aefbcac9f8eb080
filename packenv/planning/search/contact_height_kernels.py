"""Compiled loops that find how low an item comes, straight down, before its surface meets that of a pile.

Seen from above, a lower face of the item and an upper face of the pile share a convex polygon, and the height of
one over the other is linear on it: it is largest at a corner of the polygon. Those corners are the vertices of one
face over the other and the crossings of their edges, so all kinds of contact are met. Faces are kept by the cells
that they touch, and a cell whose heightmaps say that nothing in it can be higher than what was found is left out.
"""

from __future__ import annotations

from math import floor, hypot

import numpy as np

from packenv.kernels import compiled

THINNEST = 1e-9
"""A face that is thinner than this seen from above, m, stands upright; its edges belong to its neighbours, too."""


@compiled
def cells_of_faces(  # type: ignore[no-untyped-def]
    corners, boxes, origin_x, origin_y, cell, shape_x, shape_y, starts
):  # fmt: skip
    """Which faces touch which cell.

    Args:
        corners: (m, 3, 3) of the faces, m.
        boxes: (m, 6) smallest x, y, z and largest x, y, z of each, m.
        origin_x: of the first cell, m.
        origin_y: likewise.
        cell: cell size, m.
        shape_x: number of cells along x.
        shape_y: likewise along y.
        starts: (cells + 1,) int64, filled: where each cell's faces begin in the result.

    Returns:
        (entries,) int32 indices of faces, cell by cell.
    """
    starts[:] = 0
    count = 0
    pairs = np.empty((8 * len(corners) + 64, 2), dtype=np.int32)
    inward = np.empty((3, 2))
    for f in range(corners.shape[0]):
        i0 = max(0, floor((boxes[f, 0] - origin_x) / cell))
        i1 = min(shape_x - 1, floor((boxes[f, 3] - origin_x) / cell))
        j0 = max(0, floor((boxes[f, 1] - origin_y) / cell))
        j1 = min(shape_y - 1, floor((boxes[f, 4] - origin_y) / cell))
        small = i0 == i1 or j0 == j1
        needed = count + max(0, i1 - i0 + 1) * max(0, j1 - j0 + 1)
        if needed > len(pairs):
            more = np.empty((2 * needed, 2), dtype=np.int32)
            for old in range(count):
                more[old, 0], more[old, 1] = pairs[old, 0], pairs[old, 1]
            pairs = more
        if not small:
            _inward(corners, f, inward)
        for i in range(i0, i1 + 1):
            x = origin_x + i * cell
            for j in range(j0, j1 + 1):
                y = origin_y + j * cell
                if small or _reaches(corners, f, inward, x, y, x + cell, y + cell):
                    k = i * shape_y + j
                    pairs[count, 0], pairs[count, 1] = k, f
                    starts[k + 1] += 1
                    count += 1
    for k in range(shape_x * shape_y):
        starts[k + 1] += starts[k]
    at = starts[:-1].copy()
    entries = np.empty(count, dtype=np.int32)
    for p in range(count):
        k = pairs[p, 0]
        entries[at[k]] = pairs[p, 1]
        at[k] += 1
    return entries


@compiled
def _inward(corners, f, inward):  # type: ignore[no-untyped-def]
    """Fill in the (3, 2) inward normals of a triangle's edges, seen from above."""
    for k in range(3):
        m, o = (k + 1) % 3, (k + 2) % 3
        ax, ay = corners[f, k, 0], corners[f, k, 1]
        nx, ny = corners[f, m, 1] - ay, ax - corners[f, m, 0]
        flip = nx * (corners[f, o, 0] - ax) + ny * (corners[f, o, 1] - ay) < 0.0
        inward[k, 0], inward[k, 1] = (-nx, -ny) if flip else (nx, ny)


@compiled
def _reaches(corners, f, inward, low_x, low_y, high_x, high_y):  # type: ignore[no-untyped-def]
    """Whether a triangle, seen from above, reaches into a rectangle that its own box meets."""
    for k in range(3):
        nx, ny = inward[k, 0], inward[k, 1]
        # The rectangle's corner that is farthest along the inward normal.
        far_x = high_x if nx > 0.0 else low_x
        far_y = high_y if ny > 0.0 else low_y
        if nx * (far_x - corners[f, k, 0]) + ny * (far_y - corners[f, k, 1]) < 0.0:
            return False
    return True


@compiled
def _clip(polygon, count, ax, ay, nx, ny, out):  # type: ignore[no-untyped-def]
    """The part of a polygon with n · (p - a) ≥ 0; (count, 3) points carry their height along."""
    made = 0
    for k in range(count):
        m = k + 1 if k + 1 < count else 0
        here = nx * (polygon[k, 0] - ax) + ny * (polygon[k, 1] - ay)
        there = nx * (polygon[m, 0] - ax) + ny * (polygon[m, 1] - ay)
        if here >= 0.0:
            out[made, 0], out[made, 1], out[made, 2] = polygon[k, 0], polygon[k, 1], polygon[k, 2]
            made += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            share = here / (here - there)
            for axis in range(3):
                out[made, axis] = polygon[k, axis] + share * (polygon[m, axis] - polygon[k, axis])
            made += 1
    return made


@compiled
def face_over_face(lower, x, y, upper, window, best, one, two):  # type: ignore[no-untyped-def]
    """Largest height of ``upper`` over ``lower`` within a window, where it is above ``best``.

    Args:
        lower: (3, 3) corners of the item's face in its own frame, m.
        x: of that frame's origin in the container frame, m.
        y: likewise.
        upper: (3, 3) corners of the pile's face, container frame, m.
        window: (4,) smallest x, y and largest x, y that count, m.
        best: what is known already, m.
        one: (12, 3) work space.
        two: likewise.

    Returns:
        The larger of ``best`` and the height.
    """
    ax, ay = upper[0, 0], upper[0, 1]
    bx, by = upper[1, 0] - ax, upper[1, 1] - ay
    cx, cy = upper[2, 0] - ax, upper[2, 1] - ay
    area = bx * cy - by * cx
    for k in range(3):
        one[k, 0], one[k, 1], one[k, 2] = lower[k, 0] + x, lower[k, 1] + y, lower[k, 2]
    count = 3
    for k in range(3):
        m = (k + 1) % 3
        # Faces of the pile look up, so seen from above their corners go round to the left.
        ex, ey = upper[m, 0] - upper[k, 0], upper[m, 1] - upper[k, 1]
        count = _clip(one, count, upper[k, 0], upper[k, 1], -ey, ex, two)
        if count < 3:
            return best
        one, two = two, one
    for side in range(4):
        sign = 1.0 if side < 2 else -1.0
        nx, ny = (sign, 0.0) if side % 2 == 0 else (0.0, sign)
        wx, wy = (window[0], window[1]) if side < 2 else (window[2], window[3])
        outside = False
        for k in range(count):
            outside = outside or nx * (one[k, 0] - wx) + ny * (one[k, 1] - wy) < 0.0
        if outside:
            count = _clip(one, count, wx, wy, nx, ny, two)
            if count < 3:
                return best
            one, two = two, one
    for k in range(count):
        px, py = one[k, 0] - ax, one[k, 1] - ay
        u = (px * cy - py * cx) / area
        v = (bx * py - by * px) / area
        z = upper[0, 2] + u * (upper[1, 2] - upper[0, 2]) + v * (upper[2, 2] - upper[0, 2])
        best = max(best, z - one[k, 2])
    return best


@compiled
def facing(points, faces, down, chosen):  # type: ignore[no-untyped-def]
    """The faces that look down, or up; upright ones are neither.

    Args:
        points: (v, 3) m.
        faces: (m, 3) indices of points, counter-clockwise seen from outside.
        down: whether those that look down are meant.
        chosen: (m,) indices of faces, the first of them filled.

    Returns:
        How many faces there are.
    """
    found = 0
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        bx, by = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        cx, cy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
        area = bx * cy - by * cx
        if (area < 0.0) != down:
            continue
        # No edge is longer than these together, which take less time than the edges' lengths.
        if abs(area) > THINNEST * (abs(bx) + abs(by) + abs(cx) + abs(cy)) or abs(area) > THINNEST * max(
            hypot(bx, by), hypot(cx, cy), hypot(cx - bx, cy - by)
        ):
            chosen[found] = f
            found += 1
    return found


@compiled
def bounds_of_faces(points, faces, chosen, down, corners, planes, boxes):  # type: ignore[no-untyped-def]
    """What bounds each of some faces without looking at its corners.

    Args:
        points: (v, 3) m.
        faces: (m, 3) indices of points.
        chosen: (n,) indices of faces, none of them upright.
        down: whether they count as looking down; a face that looks the other way is turned.
        corners: (n, 3, 3) filled, m.
        planes: (n, 3) filled: z = p0 + p1 x + p2 y on the face.
        boxes: (n, 6) filled: smallest x, y, z and largest x, y, z, m.
    """
    for k in range(len(chosen)):
        f = chosen[k]
        for corner in range(3):
            for axis in range(3):
                corners[k, corner, axis] = points[faces[f, corner], axis]
        for axis in range(3):
            a, b, c = corners[k, 0, axis], corners[k, 1, axis], corners[k, 2, axis]
            boxes[k, axis], boxes[k, 3 + axis] = min(a, b, c), max(a, b, c)
        ax, ay, az = corners[k, 0, 0], corners[k, 0, 1], corners[k, 0, 2]
        bx, by, bz = corners[k, 1, 0] - ax, corners[k, 1, 1] - ay, corners[k, 1, 2] - az
        cx, cy, cz = corners[k, 2, 0] - ax, corners[k, 2, 1] - ay, corners[k, 2, 2] - az
        area = bx * cy - by * cx
        if (area < 0.0) != down:
            for axis in range(3):
                corners[k, 1, axis], corners[k, 2, axis] = corners[k, 2, axis], corners[k, 1, axis]
        planes[k, 1] = (bz * cy - cz * by) / area
        planes[k, 2] = (cz * bx - bz * cx) / area
        planes[k, 0] = az - planes[k, 1] * ax - planes[k, 2] * ay


@compiled
def has_inside_out(corners, planes, boxes, up, starts, entries, cell, origin_x, origin_y, shape_y):  # type: ignore[no-untyped-def]
    """Whether a closed surface encloses something inside out: a winding number below 0 in front of a face.

    Args:
        corners: (n, 3, 3) of all faces that are not upright, m.
        planes: (n, 3) see :func:`bounds_of_faces`.
        boxes: (n, 6) likewise.
        up: (n,) whether each looks up.
        starts: (cells + 1,) see :func:`cells_of_faces`.
        entries: likewise.
        cell: cell size, m.
        origin_x: of the first cell, m.
        origin_y: likewise.
        shape_y: number of cells along y.
    """
    # Uneven shares, so that no sample lies on an edge of a symmetrical mesh.
    shares = np.array([[0.41, 0.33, 0.26], [0.83, 0.11, 0.06], [0.07, 0.81, 0.12], [0.09, 0.08, 0.83]])
    for f in range(len(corners)):
        for s in range(4):
            x = y = z = 0.0
            for k in range(3):
                x += shares[s, k] * corners[f, k, 0]
                y += shares[s, k] * corners[f, k, 1]
                z += shares[s, k] * corners[f, k, 2]
            at = floor((x - origin_x) / cell) * shape_y + floor((y - origin_y) / cell)
            winding = 0 if up[f] else -1
            for e in range(starts[at], starts[at + 1]):
                g = entries[e]
                if g == f or x < boxes[g, 0] or x > boxes[g, 3] or y < boxes[g, 1] or y > boxes[g, 4]:
                    continue
                if planes[g, 0] + planes[g, 1] * x + planes[g, 2] * y <= z + THINNEST:
                    continue
                sides = 0
                for k in range(3):
                    m = (k + 1) % 3
                    ex, ey = corners[g, m, 0] - corners[g, k, 0], corners[g, m, 1] - corners[g, k, 1]
                    sides += 1 if ex * (y - corners[g, k, 1]) - ey * (x - corners[g, k, 0]) >= 0.0 else -1
                if abs(sides) == 3:
                    winding += 1 if up[g] else -1
            if winding < 0:
                return True
    return False


@compiled
def sort_cells(starts, entries, keys, first):  # type: ignore[no-untyped-def]
    """Sort the faces of each cell by a key, the smallest first.

    Args:
        starts: (cells + 1,) where each cell's faces begin in ``entries``.
        entries: indices of faces, sorted in place.
        keys: (m,) of the faces.
        first: (cells,) smallest key of each cell, filled; infinite where it has no face.
    """
    most = 0
    for k in range(starts.size - 1):
        most = max(most, starts[k + 1] - starts[k])
    own = np.empty(most)
    for k in range(starts.size - 1):
        s, n = starts[k], starts[k + 1] - starts[k]
        for a in range(n):
            face = entries[s + a]
            key = keys[face]
            b = a
            while b > 0 and own[b - 1] > key:
                own[b] = own[b - 1]
                entries[s + b] = entries[s + b - 1]
                b -= 1
            own[b] = key
            entries[s + b] = face
        first[k] = own[0] if n else np.inf


@compiled
def contact_height(  # type: ignore[no-untyped-def]
    heights, bottom, ix, iy, cell, dx, dy, lw, lh, window,
    lower, lower_planes, lower_boxes, lower_starts, lower_entries,
    upper, upper_planes, upper_boxes, upper_starts, upper_entries, upper_first, ux, uy, uw, uh, best,
):  # fmt: skip
    """Lowest z at which an item meets one item of the pile, where it is above ``best``.

    Args:
        heights: (nx, ny) container heightmap, m.
        bottom: (w, h) bottom heightmap of the item at its phase, m; infinite outside the footprint.
        ix: cell of the item's smallest x.
        iy: cell of its smallest y.
        cell: cell size, m.
        dx: how far behind the edge of its first cell the item begins along x, m.
        dy: likewise along y.
        lw: number of cells along x for which ``lower_starts`` has a list.
        lh: likewise along y.
        window: (4,) smallest x, y and largest x, y that count, m.
        lower: (m, 3, 3) lower faces of the item in its own frame, m.
        lower_planes: (m, 3) of these, see :func:`bounds_of_faces`.
        lower_boxes: (m, 6) likewise.
        lower_starts: (lw · lh + 1,) where the faces of each cell begin, of the item at the edge of its first one.
        lower_entries: indices of faces, in each cell the lowest first.
        upper: (n, 3, 3) upper faces of the placed item in the container frame, m.
        upper_planes: (n, 3) of these.
        upper_boxes: (n, 6) likewise.
        upper_starts: (uw · uh + 1,) where the faces of each of these cells of the container begin.
        upper_entries: indices of faces, in each cell the highest first.
        upper_first: (uw · uh,) minus the largest height in each cell, m.
        ux: first cell of the container that has a list.
        uy: likewise.
        uw: number of cells along x that have a list.
        uh: likewise along y.
        best: what is known already, m.

    Returns:
        The larger of ``best`` and the height.
    """
    w, h = bottom.shape
    i0, i1 = max(0, ux - ix), min(w, ux + uw - ix)
    j0, j1 = max(0, uy - iy), min(h, uy + uh - iy)
    if i0 >= i1 or j0 >= j1:
        return best
    bounds = np.empty((i1 - i0) * (j1 - j0), dtype=np.float32)
    places = np.empty((i1 - i0) * (j1 - j0), dtype=np.int64)
    count = 0
    for i in range(i0, i1):
        for j in range(j0, j1):
            # Whole cells bound what lies in them, so most are out before a face is looked at.
            k = (ix + i - ux) * uh + iy + j - uy
            bound = min(heights[ix + i, iy + j], -upper_first[k]) - bottom[i, j]
            if bound > best:
                bounds[count] = -bound
                places[count] = i * h + j
                count += 1
    one, two = np.empty((12, 3)), np.empty((12, 3))
    x, y = ix * cell + dx, iy * cell + dy
    # Behind the edge, a cell of the container meets the item's cell of the same number and the one before.
    back_x, back_y = (1 if dx > 0.0 else 0), (1 if dy > 0.0 else 0)
    for at in range(count // 2 - 1, -1, -1):
        _sink(bounds, places, at, count)
    while count > 0 and -bounds[0] > best:
        i, j = places[0] // h, places[0] % h
        count -= 1
        bounds[0], places[0] = bounds[count], places[count]
        _sink(bounds, places, 0, count)
        k = (ix + i - ux) * uh + iy + j - uy
        for i_own in range(max(0, i - back_x), min(i + 1, lw)):
            for j_own in range(max(0, j - back_y), min(j + 1, lh)):
                own = i_own * lh + j_own
                for a in range(lower_starts[own], lower_starts[own + 1]):
                    f = lower_entries[a]
                    low = lower_boxes[f]
                    if -upper_first[k] - low[2] <= best:
                        break
                    for b in range(upper_starts[k], upper_starts[k + 1]):
                        g = upper_entries[b]
                        high = upper_boxes[g]
                        if high[5] - low[2] <= best:
                            break
                        x0, x1 = max(low[0] + x, high[0], window[0]), min(low[3] + x, high[3], window[2])
                        y0, y1 = max(low[1] + y, high[1], window[1]), min(low[4] + y, high[4], window[3])
                        if x0 > x1 or y0 > y1:
                            continue
                        # Linear where both are: the largest value over both boxes bounds it.
                        px = upper_planes[g, 1] - lower_planes[f, 1]
                        py = upper_planes[g, 2] - lower_planes[f, 2]
                        bound = upper_planes[g, 0] - lower_planes[f, 0]
                        bound += lower_planes[f, 1] * x + lower_planes[f, 2] * y
                        bound += px * (x1 if px > 0.0 else x0) + py * (y1 if py > 0.0 else y0)
                        if bound > best:
                            best = face_over_face(lower[f], x, y, upper[g], window, best, one, two)
    return best


@compiled
def _sink(keys, values, at, count):  # type: ignore[no-untyped-def]
    """Let one entry of a binary heap, the least key first, sink to its place.

    The search ends after few of its cells: a heap gives these without sorting the others.
    """
    key, value = keys[at], values[at]
    while 2 * at + 1 < count:
        child = 2 * at + 1
        if child + 1 < count and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[at], values[at] = keys[child], values[child]
        at = child
    keys[at], values[at] = key, value
