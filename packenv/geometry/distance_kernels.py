"""Compiled kernels on a triangle surface in a grid: building it, signing it, looking distances up.

A *node* is a corner of the grid. Nodes within the band hold their exact distance to the surface, all others
the band's width. Distance changes by at most the way that one goes, so the nodes bound the distance of every
point from both sides: that rules most points out, and gives the others a short search in a tree of boxes.
"""

from __future__ import annotations

import math

import numpy as np

from packenv.kernels import compiled

LEAF = 4
"""Faces in one leaf of the tree."""

TIES = 48
"""Faces that one search can return: those around one edge or vertex."""

_TIE = 1e-6
"""Distances this close (m) are equal."""


@compiled
def closest_on_triangle(p, a, b, c):  # type: ignore[no-untyped-def]
    """Closest point of a triangle, by Voronoi regions (Ericson, Real-Time Collision Detection, 5.1.5).

    Args:
        p: the point, three floats, m.
        a: corner 0, likewise.
        b: corner 1.
        c: corner 2.

    Returns:
        x, y, z of the closest point and where it is: 0 in the face, 1 to 3 on the edge from corner 0, 1 or 2
        to the next one, 4 to 6 at corner 0, 1 or 2.
    """
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    apx, apy, apz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    if d1 <= 0.0 and d2 <= 0.0:
        return a[0], a[1], a[2], 4
    bpx, bpy, bpz = p[0] - b[0], p[1] - b[1], p[2] - b[2]
    d3 = abx * bpx + aby * bpy + abz * bpz
    d4 = acx * bpx + acy * bpy + acz * bpz
    if d3 >= 0.0 and d4 <= d3:
        return b[0], b[1], b[2], 5
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        return a[0] + v * abx, a[1] + v * aby, a[2] + v * abz, 1
    cpx, cpy, cpz = p[0] - c[0], p[1] - c[1], p[2] - c[2]
    d5 = abx * cpx + aby * cpy + abz * cpz
    d6 = acx * cpx + acy * cpy + acz * cpz
    if d6 >= 0.0 and d5 <= d6:
        return c[0], c[1], c[2], 6
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
        return a[0] + w * acx, a[1] + w * acy, a[2] + w * acz, 3
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and (d4 - d3) >= 0.0 and (d5 - d6) >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return b[0] + w * (c[0] - b[0]), b[1] + w * (c[1] - b[1]), b[2] + w * (c[2] - b[2]), 2
    scale = 1.0 / (va + vb + vc)
    v, w = vb * scale, vc * scale
    return a[0] + abx * v + acx * w, a[1] + aby * v + acy * w, a[2] + abz * v + acz * w, 0


@compiled
def corners(vertices, faces, f):  # type: ignore[no-untyped-def]
    """The three corners of face ``f``, each three floats."""
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    return (
        (vertices[i, 0], vertices[i, 1], vertices[i, 2]),
        (vertices[j, 0], vertices[j, 1], vertices[j, 2]),
        (vertices[k, 0], vertices[k, 1], vertices[k, 2]),
    )


@compiled
def fill_band(vertices, faces, normals, origin, h, band, distance):  # type: ignore[no-untyped-def]
    """Exact unsigned distance of every node within the band.

    Args:
        vertices: (n, 3) m.
        faces: (m, 3).
        normals: (m, 3) unit.
        origin: (3,) of node (0, 0, 0), m.
        h: spacing of the nodes, m.
        band: m.
        distance: (a, b, c) float32, filled with the band's width; lowered in place.
    """
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for f in range(len(faces)):
        a, b, c = corners(vertices, faces, f)
        for axis in range(3):
            least = min(a[axis], b[axis], c[axis]) - band - origin[axis]
            most = max(a[axis], b[axis], c[axis]) + band - origin[axis]
            low[axis] = max(0, math.ceil(least / h))
            high[axis] = min(distance.shape[axis] - 1, math.floor(most / h))
        nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
        # The plane bounds the distance from below, so a slanted face skips most of its bounding box.
        plane = nx * a[0] + ny * a[1] + nz * a[2]
        for i in range(low[0], high[0] + 1):
            x = origin[0] + i * h
            for j in range(low[1], high[1] + 1):
                y = origin[1] + j * h
                for k in range(low[2], high[2] + 1):
                    z = origin[2] + k * h
                    known = distance[i, j, k]
                    if abs(nx * x + ny * y + nz * z - plane) >= known:
                        continue
                    qx, qy, qz, _ = closest_on_triangle((x, y, z), a, b, c)
                    d = math.sqrt((x - qx) ** 2 + (y - qy) ** 2 + (z - qz) ** 2)
                    if d < known:
                        distance[i, j, k] = d


@compiled
def _side(points, i, j, x, y):  # type: ignore[no-untyped-def]
    """Whether (x, y) is left of the edge from vertex i to j; exactly opposite for the edge j to i."""
    flip = i > j
    if flip:
        i, j = j, i
    ux, uy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
    left = ux * (y - points[i, 1]) - uy * (x - points[i, 0]) >= 0.0
    return left != flip


@compiled
def count_crossings(points, faces, origin, h, counts):  # type: ignore[no-untyped-def]
    """Winding number of every node by the crossings above it in its column.

    Args:
        points: (n, 3) with the axes permuted so that columns run along the last one, m.
        faces: (m, 3).
        origin: (3,) of node (0, 0, 0), permuted likewise; shifted a little off the nodes in the first two, m.
        h: m.
        counts: (a, b, c) int16 zeros, filled in place; axes permuted likewise.
    """
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
        bx, by, bz = points[j, 0], points[j, 1], points[j, 2]
        cx, cy, cz = points[k, 0], points[k, 1], points[k, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        first = max(0, math.ceil((min(ax, bx, cx) - origin[0]) / h))
        last = min(counts.shape[0] - 1, math.floor((max(ax, bx, cx) - origin[0]) / h))
        near = max(0, math.ceil((min(ay, by, cy) - origin[1]) / h))
        far = min(counts.shape[1] - 1, math.floor((max(ay, by, cy) - origin[1]) / h))
        for p in range(first, last + 1):
            x = origin[0] + p * h
            for q in range(near, far + 1):
                y = origin[1] + q * h
                left = _side(points, i, j, x, y)
                if _side(points, j, k, x, y) != left or _side(points, k, i, x, y) != left:
                    continue
                v = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
                w = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
                top = math.ceil((az + v * (bz - az) + w * (cz - az) - origin[2]) / h) - 1
                if top >= 0:
                    counts[p, q, min(top, counts.shape[2] - 1)] += 1 if left else -1
    for p in range(counts.shape[0]):
        for q in range(counts.shape[1]):
            total = 0
            for r in range(counts.shape[2] - 1, -1, -1):
                total += counts[p, q, r]
                counts[p, q, r] = total


@compiled
def trilinear(points, origin, h, distance, band, values):  # type: ignore[no-untyped-def]
    """Interpolate the signed distance.

    Args:
        points: (k, 3) mesh frame, m.
        origin: (3,) m.
        h: m.
        distance: (a, b, c) float32, signed, m.
        band: value outside the grid, m.
        values: (k,) filled in place, m.
    """
    na, nb, nc = distance.shape
    inverse = 1.0 / h
    flat = distance.reshape(-1)
    # Unsigned, so that the compiled code need not ask whether an index counts from the end.
    one, row, layer = np.uint64(1), np.uint64(nc), np.uint64(nb * nc)
    for s in range(len(points)):
        x = (points[s, 0] - origin[0]) * inverse
        y = (points[s, 1] - origin[1]) * inverse
        z = (points[s, 2] - origin[2]) * inverse
        if not (0.0 <= x < na - 1 and 0.0 <= y < nb - 1 and 0.0 <= z < nc - 1):
            values[s] = band
            continue
        i, j, k = int(x), int(y), int(z)
        u, v, w = x - i, y - j, z - k
        at = np.uint64((i * nb + j) * nc + k)
        d000, d001, d010, d011 = flat[at], flat[at + one], flat[at + row], flat[at + row + one]
        at += layer
        d100, d101, d110, d111 = flat[at], flat[at + one], flat[at + row], flat[at + row + one]
        c00, c01 = d000 + u * (d100 - d000), d001 + u * (d101 - d001)
        c10, c11 = d010 + u * (d110 - d010), d011 + u * (d111 - d011)
        c0, c1 = c00 + v * (c10 - c00), c01 + v * (c11 - c01)
        values[s] = c0 + w * (c1 - c0)


@compiled
def distance_bounds(x, y, z, origin, h, distance, reach):  # type: ignore[no-untyped-def]
    """Whether the point may be within ``reach`` of the surface, and a bound, m.

    The bound is an upper one of its distance where it may be near, else the way that it can go and still not be
    within ``reach``. Both are sound: a node's distance differs from the point's by at most the way between them.
    """
    gx, gy, gz = (x - origin[0]) / h, (y - origin[1]) / h, (z - origin[2]) / h
    na, nb, nc = distance.shape
    if not (0.0 <= gx < na - 1 and 0.0 <= gy < nb - 1 and 0.0 <= gz < nc - 1):
        return False, 0.0
    i, j, k = int(gx), int(gy), int(gz)
    u, v, w = gx - i, gy - j, gz - k
    # The nearest node first: it alone excludes most points.
    di, dj, dk = int(u + 0.5), int(v + 0.5), int(w + 0.5)
    way = math.sqrt((u - di) ** 2 + (v - dj) ** 2 + (w - dk) ** 2) * h
    known = abs(distance[i + di, j + dj, k + dk])
    if known - way > reach:
        return False, known - way - reach
    upper = min(reach, known + way)
    for di in range(2):
        for dj in range(2):
            for dk in range(2):
                way = math.sqrt((u - di) ** 2 + (v - dj) ** 2 + (w - dk) ** 2) * h
                far = abs(distance[i + di, j + dj, k + dk]) - way - reach
                if far > 0.0:
                    return False, far
    return True, upper


@compiled
def fill_boxes(vertices, faces, boxes):  # type: ignore[no-untyped-def]
    """Bounding boxes of a complete binary tree whose leaves hold ``LEAF`` faces each, in their order.

    Args:
        vertices: (n, 3) m.
        faces: (m, 3), neighbours in space close to each other.
        boxes: (2 L - 1, 6) filled in place with low and high corners; L a power of two; root first, the
            children of b at 2 b + 1 and 2 b + 2. A box without faces is inside out.
    """
    leaves = (len(boxes) + 1) // 2
    for b in range(len(boxes) - 1, -1, -1):
        boxes[b, :3] = np.inf
        boxes[b, 3:] = -np.inf
        if b >= leaves - 1:
            first = (b - leaves + 1) * LEAF
            for f in range(first, min(first + LEAF, len(faces))):
                for c in range(3):
                    for axis in range(3):
                        boxes[b, axis] = min(boxes[b, axis], vertices[faces[f, c], axis])
                        boxes[b, 3 + axis] = max(boxes[b, 3 + axis], vertices[faces[f, c], axis])
        else:
            for axis in range(3):
                boxes[b, axis] = min(boxes[2 * b + 1, axis], boxes[2 * b + 2, axis])
                boxes[b, 3 + axis] = max(boxes[2 * b + 1, 3 + axis], boxes[2 * b + 2, 3 + axis])


@compiled
def _box_distance(x, y, z, boxes, b):  # type: ignore[no-untyped-def]
    """Squared distance of a point to a box; infinite for one without faces."""
    dx = max(boxes[b, 0] - x, 0.0, x - boxes[b, 3])
    dy = max(boxes[b, 1] - y, 0.0, y - boxes[b, 4])
    dz = max(boxes[b, 2] - z, 0.0, z - boxes[b, 5])
    return dx * dx + dy * dy + dz * dz


@compiled
def any_within(x, y, z, reach, boxes, stack):  # type: ignore[no-untyped-def]
    """Whether some leaf's box is within ``reach`` of a point: where none is, no face is.

    Args:
        x: of the point, m.
        y: likewise.
        z: likewise.
        reach: m.
        boxes: from :func:`fill_boxes`.
        stack: (64,) int64, scratch.
    """
    leaves = (len(boxes) + 1) // 2
    limit = reach * reach
    depth = 1
    stack[0] = 0
    while depth > 0:
        depth -= 1
        b = stack[depth]
        if _box_distance(x, y, z, boxes, b) > limit:
            continue
        if b >= leaves - 1:
            return True
        stack[depth] = 2 * b + 2
        stack[depth + 1] = 2 * b + 1
        depth += 2
    return False


@compiled
def nearest_faces(x, y, z, upper, vertices, faces, boxes, stack, ties, where, feet):  # type: ignore[no-untyped-def]
    """All faces that are nearest to a point, up to a micrometre: one, or those around an edge or vertex.

    Args:
        x: of the point, m.
        y: likewise.
        z: likewise.
        upper: m; only faces within it are found.
        vertices: (n, 3) m.
        faces: (m, 3).
        boxes: from :func:`fill_boxes`.
        stack: (64,) int64, scratch.
        ties: (TIES,) int64, filled with faces.
        where: (TIES,) int64, filled with the region codes of :func:`closest_on_triangle`.
        feet: (TIES, 4) filled with closest points and distances, m.

    Returns:
        number of faces found, and index of the nearest among them; (0, -1) where there is none.
    """
    leaves = (len(boxes) + 1) // 2
    count, best, least = 0, -1, upper
    limit = (least + _TIE) ** 2
    depth = 1
    stack[0] = 0
    while depth > 0:
        depth -= 1
        b = stack[depth]
        if _box_distance(x, y, z, boxes, b) > limit:
            continue
        if b < leaves - 1:
            left = _box_distance(x, y, z, boxes, 2 * b + 1)
            right = _box_distance(x, y, z, boxes, 2 * b + 2)
            near, far = (2 * b + 1, 2 * b + 2) if left <= right else (2 * b + 2, 2 * b + 1)
            if max(left, right) <= limit:
                stack[depth] = far
                depth += 1
            if min(left, right) <= limit:
                stack[depth] = near
                depth += 1
            continue
        first = (b - leaves + 1) * LEAF
        for f in range(first, min(first + LEAF, len(faces))):
            p, q, r = corners(vertices, faces, f)
            fx, fy, fz, code = closest_on_triangle((x, y, z), p, q, r)
            d = math.sqrt((x - fx) ** 2 + (y - fy) ** 2 + (z - fz) ** 2)
            if d > least + _TIE:
                continue
            if d < least:
                least = d
                limit = (least + _TIE) ** 2
                kept = 0
                for t in range(count):
                    if feet[t, 3] <= least + _TIE:
                        ties[kept] = ties[t]
                        where[kept] = where[t]
                        for axis in range(4):
                            feet[kept, axis] = feet[t, axis]
                        kept += 1
                count = kept
                best = count if count < TIES else TIES - 1
            elif count >= TIES:
                continue
            t = min(count, TIES - 1)
            ties[t] = f
            where[t] = code
            feet[t, 0] = fx
            feet[t, 1] = fy
            feet[t, 2] = fz
            feet[t, 3] = d
            count = min(count + 1, TIES)
    if best < 0 and count > 0:
        best = 0
    return count, best


@compiled
def feature_normal(f, code, faces, normals, neighbours, vertex_normals):  # type: ignore[no-untyped-def]
    """Normal (not of unit length) whose sign tells inside from outside (Baerentzen and Aanaes 2005)."""
    x, y, z = normals[f, 0], normals[f, 1], normals[f, 2]
    if 1 <= code <= 3:
        g = neighbours[f, code - 1]
        if g >= 0:
            x, y, z = x + normals[g, 0], y + normals[g, 1], z + normals[g, 2]
    elif code >= 4:
        v = faces[f, code - 4]
        x, y, z = vertex_normals[v, 0], vertex_normals[v, 1], vertex_normals[v, 2]
    return x, y, z


@compiled
def closest_points(  # type: ignore[no-untyped-def]
    points,
    vertices,
    faces,
    normals,
    neighbours,
    vertex_normals,
    origin,
    h,
    distance,
    boxes,
    reach,
    found,
    feet,
    signed,
):
    """Exact nearest face, closest point and signed distance of points within ``reach`` of the surface.

    Args:
        points: (k, 3) m.
        vertices: (n, 3) m.
        faces: (m, 3).
        normals: (m, 3) unit.
        neighbours: (m, 3) face across the edge from corner e to e + 1; -1 where there is not one.
        vertex_normals: (n, 3) unit.
        origin: (3,) of node (0, 0, 0), m.
        h: spacing of the nodes, m.
        distance: (a, b, c) float32 of the nodes, m.
        boxes: from :func:`fill_boxes`.
        reach: m; points beyond keep what ``found``, ``feet`` and ``signed`` hold.
        found: (k,) int64 nearest face, set in place.
        feet: (k, 3) closest point, set in place, m.
        signed: (k,) signed distance, set in place, m.
    """
    stack = np.empty(64, np.int64)
    ties = np.empty(TIES, np.int64)
    where = np.empty(TIES, np.int64)
    trail = np.empty((TIES, 4))
    for s in range(len(points)):
        x, y, z = points[s, 0], points[s, 1], points[s, 2]
        near, upper = distance_bounds(x, y, z, origin, h, distance, reach)
        if not near:
            continue
        _, best = nearest_faces(x, y, z, upper, vertices, faces, boxes, stack, ties, where, trail)
        if best < 0 or trail[best, 3] > reach:
            continue
        f = ties[best]
        nx, ny, nz = feature_normal(f, where[best], faces, normals, neighbours, vertex_normals)
        side = (x - trail[best, 0]) * nx + (y - trail[best, 1]) * ny + (z - trail[best, 2]) * nz
        found[s] = f
        signed[s] = trail[best, 3] if side >= 0.0 else -trail[best, 3]
        for axis in range(3):
            feet[s, axis] = trail[best, axis]
