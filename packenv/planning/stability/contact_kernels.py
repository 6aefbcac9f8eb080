"""Compiled kernels that find contacts: samples of one surface against another's exact faces, or walls."""

from __future__ import annotations

import math

import numpy as np

from packenv.geometry.distance_grids import BAND
from packenv.geometry.distance_kernels import (
    TIES,
    any_within,
    closest_on_triangle,
    corners,
    distance_bounds,
    nearest_faces,
)
from packenv.geometry.surface_samples import EDGE, END, FACE, SHARP
from packenv.kernels import compiled

_FACING = 0.7
"""A face touches a face only where the cosine between their normals is below minus this."""

_FACING_FEATURE = 0.5
"""The same for the mean normal of a sharp edge or corner; a cube's corner has 0.58."""

_ALONG = 0.3
"""Largest cosine between a face's normal and a sharp edge that lies on the face."""

_SLANT = math.tan(math.radians(30.0))
"""A foot on an edge counts as lying under the sample up to this tangent: smooth edges, not sharp ones."""

_EXACT = 1e-5
"""The same for feet at no distance, m."""

_CROSSING = math.sin(math.radians(10.0))
"""Sharp edges that are nearer to parallel than this do not cross: their faces touch, or nothing does."""

CROSSING_WAY = 0.9e-3
"""How far (m) a crossing can be from the edge sample that finds it: the longest way in the records."""


@compiled
def _facing(record, kind, nx, ny, nz):  # type: ignore[no-untyped-def]
    """How squarely a sample faces a normal: a cosine, or -1 where they do not touch."""
    first = -(record[3] * nx + record[4] * ny + record[5] * nz)
    second = -(record[6] * nx + record[7] * ny + record[8] * nz)
    best = max(first, second)
    if best > _FACING:
        return best
    if kind != FACE:
        # An edge lies on a face only where it runs along it; otherwise its end, a corner, touches first.
        ex, ey, ez = record[9], record[10], record[11]
        if abs(ex * nx + ey * ny + ez * nz) > _ALONG * math.sqrt(ex * ex + ey * ey + ez * ez):
            return -1.0
        mx, my, mz = record[3] + record[6], record[4] + record[7], record[5] + record[8]
        length = math.sqrt(mx * mx + my * my + mz * mz)
        if length > 1e-9:
            mean = -(mx * nx + my * ny + mz * nz) / length
            if mean > _FACING_FEATURE:
                return mean
    return -1.0


@compiled
def touches(  # type: ignore[no-untyped-def]
    records, kinds, starts, spheres, rotation, shift,
    low, high, turn, vertices, faces, normals, neighbours, boxes, origin, h, distance, threshold, rows,
):  # fmt: skip
    """Contacts of one body's samples with another body's faces and edges.

    Args:
        records: samples of the one body, in its own frame.
        kinds: as in :class:`packenv.geometry.surface_samples.Samples`.
        starts: likewise.
        spheres: likewise.
        rotation: (3, 3) its frame to the other's.
        shift: (3,) likewise, m.
        low: (3,) smallest x, y, z of the other body in the container's frame, less its position, m.
        high: (3,) largest ones, likewise.
        turn: (3, 3) the other's frame to the container's.
        vertices: of the other body, as in :class:`packenv.geometry.distance_grids.SurfaceField`.
        faces: likewise.
        normals: likewise.
        neighbours: likewise.
        boxes: likewise.
        origin: likewise.
        distance: likewise.
        h: spacing of the nodes, m.
        threshold: largest gap, m.
        rows: (k, 7) filled with point, outward normal of the other body, and gap, in the other's frame, m.

    Returns:
        number of rows filled.
    """
    stack = np.empty(64, np.int64)
    ties = np.empty(TIES, np.int64)
    where = np.empty(TIES, np.int64)
    feet = np.empty((TIES, 4))
    record = np.empty(12)
    count, last = 0, -1
    edge_reach = math.sqrt(threshold**2 + CROSSING_WAY**2)
    top = np.empty(3)
    for axis in range(3):
        top[axis] = origin[axis] + (distance.shape[axis] - 1) * h
    # The grid's rim is wider than a contact reaches; on the far side by up to a cell more.
    closer = edge_reach - BAND + 1e-5
    centre = np.empty(3)
    for block in range(len(spheres)):
        radius = spheres[block, 3]
        outside = -np.inf
        for axis in range(3):
            c = shift[axis]
            for other in range(3):
                c += rotation[axis, other] * spheres[block, other]
            centre[axis] = c
            outside = max(outside, origin[axis] - c, c - top[axis])
        if outside > radius + closer:
            continue
        # In the container's frame items lie flush, and two that only touch share no more than a thin slab.
        outside = 0.0
        for axis in range(3):
            c = turn[axis, 0] * centre[0] + turn[axis, 1] * centre[1] + turn[axis, 2] * centre[2]
            outside = max(outside, low[axis] - c, c - high[axis])
        if outside > radius + edge_reach:
            continue
        if not any_within(centre[0], centre[1], centre[2], radius + edge_reach, boxes, stack):
            continue
        anchor, clear = -1, 0.0
        for s in range(starts[block], starts[block + 1]):
            if anchor >= 0:
                # Distance changes by no more than the way: one far sample rules out those around it.
                way = (
                    (records[s, 0] - records[anchor, 0]) ** 2
                    + (records[s, 1] - records[anchor, 1]) ** 2
                    + (records[s, 2] - records[anchor, 2]) ** 2
                )
                if way < clear * clear:
                    continue
            x = (
                rotation[0, 0] * records[s, 0]
                + rotation[0, 1] * records[s, 1]
                + rotation[0, 2] * records[s, 2]
                + shift[0]
            )
            y = (
                rotation[1, 0] * records[s, 0]
                + rotation[1, 1] * records[s, 1]
                + rotation[1, 2] * records[s, 2]
                + shift[1]
            )
            z = (
                rotation[2, 0] * records[s, 0]
                + rotation[2, 1] * records[s, 1]
                + rotation[2, 2] * records[s, 2]
                + shift[2]
            )
            reach = edge_reach if kinds[s] == EDGE or kinds[s] == END else threshold
            near, upper = distance_bounds(x, y, z, origin, h, distance, reach)
            if not near:
                anchor, clear = s, max(0.0, upper + reach - edge_reach - _EXACT)
                continue
            if last >= 0:
                # Neighbouring samples have neighbouring nearest faces: a better bound than the nodes give.
                a, b, c = corners(vertices, faces, last)
                fx, fy, fz, _ = closest_on_triangle((x, y, z), a, b, c)
                upper = min(upper, math.sqrt((x - fx) ** 2 + (y - fy) ** 2 + (z - fz) ** 2) + _EXACT)
            found, best = nearest_faces(x, y, z, upper, vertices, faces, boxes, stack, ties, where, feet)
            if best < 0 or feet[best, 3] > reach:
                continue
            last = ties[best]
            for part in range(1, 4):
                for axis in range(3):
                    record[3 * part + axis] = (
                        rotation[axis, 0] * records[s, 3 * part]
                        + rotation[axis, 1] * records[s, 3 * part + 1]
                        + rotation[axis, 2] * records[s, 3 * part + 2]
                    )
            # Of all the faces that tie, the one that faces the sample most squarely is touched.
            chosen, squarest, gap = -1, 0.0, 0.0
            for t in range(found):
                f = ties[t]
                nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
                wx, wy, wz = x - feet[t, 0], y - feet[t, 1], z - feet[t, 2]
                along = wx * nx + wy * ny + wz * nz
                across = math.sqrt(max(0.0, wx * wx + wy * wy + wz * wz - along * along))
                if across > _EXACT + _SLANT * abs(along) or feet[t, 3] > threshold:
                    continue
                square = _facing(record, kinds[s], nx, ny, nz)
                if square > squarest:
                    chosen, squarest, gap = t, square, along
            if chosen >= 0:
                for axis in range(3):
                    rows[count, axis] = feet[chosen, axis]
                    rows[count, 3 + axis] = normals[ties[chosen], axis]
                rows[count, 6] = gap
                count += 1
            elif kinds[s] == EDGE or kinds[s] == END:
                # The sample may lie beside the edge that its own edge crosses, over one of that edge's faces.
                for e in range(3):
                    count = _cross_edges(
                        x, y, z, record, kinds[s], ties[best], e,
                        vertices, faces, normals, neighbours, threshold, rows, count,
                    )  # fmt: skip
    return count


@compiled
def _cross_edges(  # type: ignore[no-untyped-def]
    x, y, z, record, kind, f, e, vertices, faces, normals, neighbours, threshold, rows, count
):  # fmt: skip
    """Add the contact of a sharp edge through (x, y, z) with edge ``e`` of face ``f``, if they cross."""
    g = neighbours[f, e]
    if g < 0:
        return count
    mx, my, mz = normals[f, 0] + normals[g, 0], normals[f, 1] + normals[g, 1], normals[f, 2] + normals[g, 2]
    cosine = normals[f, 0] * normals[g, 0] + normals[f, 1] * normals[g, 1] + normals[f, 2] * normals[g, 2]
    if cosine > SHARP:
        return count
    points = corners(vertices, faces, f)
    a, b = points[e], points[(e + 1) % 3]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    vx, vy, vz = record[9], record[10], record[11]
    way = math.sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx / way, vy / way, vz / way
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    sine = math.sqrt(nx * nx + ny * ny + nz * nz)
    if sine < _CROSSING:
        return count
    nx, ny, nz = nx / sine, ny / sine, nz / sine
    if nx * mx + ny * my + nz * mz < 0.0:
        nx, ny, nz = -nx, -ny, -nz
    # The normal must lie between the normals of both faces, on both edges, or the faces would touch first.
    size = math.sqrt(mx * mx + my * my + mz * mz)
    half = (normals[f, 0] * mx + normals[f, 1] * my + normals[f, 2] * mz) / max(size, 1e-12)
    if nx * mx + ny * my + nz * mz < (half - 0.02) * size:
        return count
    ox, oy, oz = record[3] + record[6], record[4] + record[7], record[5] + record[8]
    size = math.sqrt(ox * ox + oy * oy + oz * oz)
    half = (record[3] * ox + record[4] * oy + record[5] * oz) / max(size, 1e-12)
    if -(nx * ox + ny * oy + nz * oz) < (half - 0.02) * size:
        return count
    # Closest points of the two lines; a crossing beyond the sample's part of its edge is another sample's.
    wx, wy, wz = x - a[0], y - a[1], z - a[2]
    uv = ux * vx + uy * vy + uz * vz
    uw, vw = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    det = 1.0 - uv * uv
    on_sample, on_edge = (uv * uw - vw) / det, (uw - uv * vw) / det
    back = 1e-6 if kind == END else way
    if on_sample > way or on_sample < -back or on_edge < 0.0 or on_edge > length:
        return count
    gap = wx * nx + wy * ny + wz * nz
    if abs(gap) > threshold:
        return count
    rows[count, 0] = a[0] + on_edge * ux
    rows[count, 1] = a[1] + on_edge * uy
    rows[count, 2] = a[2] + on_edge * uz
    rows[count, 3] = nx
    rows[count, 4] = ny
    rows[count, 5] = nz
    rows[count, 6] = gap
    return count + 1


@compiled
def touches_container(  # type: ignore[no-untyped-def]
    records, kinds, starts, spheres, rotation, shift, size, threshold, rows
):  # fmt: skip
    """Contacts of one body's samples with the floor and the four walls, up to the rim.

    Args:
        records: samples of the body, in its own frame.
        kinds: as in :class:`packenv.geometry.surface_samples.Samples`.
        starts: likewise.
        spheres: likewise.
        rotation: (3, 3) the body's frame to the container's.
        shift: (3,) likewise, m.
        size: (3,) inner size of the container, m.
        threshold: largest gap, m.
        rows: (k, 7) filled with the point on the container, its inward normal, and the gap, container frame.

    Returns:
        number of rows filled.
    """
    count = 0
    centre = np.empty(3)
    point = np.empty(3)
    record = np.empty(12)
    for block in range(len(spheres)):
        for axis in range(3):
            centre[axis] = shift[axis]
            for other in range(3):
                centre[axis] += rotation[axis, other] * spheres[block, other]
        reach = spheres[block, 3] + threshold
        for plane in range(5):
            axis = plane % 3
            upper = plane >= 3
            depth = size[axis] - centre[axis] if upper else centre[axis]
            if abs(depth) > reach:
                continue
            sign = -1.0 if upper else 1.0
            for s in range(starts[block], starts[block + 1]):
                for a in range(3):
                    point[a] = (
                        rotation[a, 0] * records[s, 0]
                        + rotation[a, 1] * records[s, 1]
                        + rotation[a, 2] * records[s, 2]
                        + shift[a]
                    )
                gap = size[axis] - point[axis] if upper else point[axis]
                if abs(gap) > threshold or point[2] > size[2]:
                    continue
                for part in range(1, 4):
                    for a in range(3):
                        record[3 * part + a] = (
                            rotation[a, 0] * records[s, 3 * part]
                            + rotation[a, 1] * records[s, 3 * part + 1]
                            + rotation[a, 2] * records[s, 3 * part + 2]
                        )
                nx, ny, nz = 0.0, 0.0, 0.0
                if axis == 0:
                    nx = sign
                elif axis == 1:
                    ny = sign
                else:
                    nz = sign
                if _facing(record, kinds[s], nx, ny, nz) < 0.0:
                    continue
                for a in range(3):
                    rows[count, a] = point[a]
                rows[count, axis] = size[axis] if upper else 0.0
                rows[count, 3] = nx
                rows[count, 4] = ny
                rows[count, 5] = nz
                rows[count, 6] = gap
                count += 1
    return count
