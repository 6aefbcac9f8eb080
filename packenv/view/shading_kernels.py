"""Compiled kernels of the software renderer that colour a z-buffer: edges, light, lines.

Screen coordinates and depth are those of :mod:`packenv.view.zbuffer_kernels`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from packenv.types import Float32Array, FloatArray
from packenv.view.zbuffer_kernels import NORMAL_SCALE


@njit(cache=True)
def mark_edges(
    nearness: Float32Array,
    owners: NDArray[np.int16],
    facing: NDArray[np.int16],
    gap: float,
    crease: float,
    radius: int,
) -> NDArray[np.uint8]:
    """Find where a drawing would have a line.

    Args:
        nearness: (rows, columns).
        owners: (rows, columns).
        facing: (rows, columns, 3).
        gap: smallest step in distance along the view axis that is an edge of its own, m.
        crease: cosine of the angle between neighbouring normals from which on there is a crease.
        radius: lines are 2 radius + 1 pixels wide at most.

    Returns:
        (rows, columns): 2 on a silhouette, 1 on a crease, else 0.
    """
    rows, columns = nearness.shape
    marks = np.zeros((rows, columns), dtype=np.uint8)
    limit = crease * NORMAL_SCALE * NORMAL_SCALE
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            own = owners[row, column]
            if own < 0:
                continue
            near = nearness[row, column]
            mark = 0
            for down, right in ((0, 1), (1, 0)):
                ahead, behind = nearness[row + down, column + right], nearness[row - down, column - right]
                for sign in (-1, 1):
                    r, c = row + sign * down, column + sign * right
                    if owners[r, c] != own:
                        # The nearer of the two owns the line between them.
                        if nearness[r, c] < near:
                            mark = 2
                    elif mark == 0:
                        dot = 0.0
                        for k in range(3):
                            dot += float(facing[row, column, k]) * float(facing[r, c, k])
                        if dot < limit:
                            mark = 1
                # Nearness is linear over a plane, however slanted: only a step or a bend has a second
                # difference.
                bend = ahead + behind - 2.0 * near
                if bend < -gap * near * near and (
                    owners[row + down, column + right] == own == owners[row - down, column - right]
                ):
                    mark = 2
            if mark:
                for r in range(max(0, row - radius), min(rows, row + radius + 1)):
                    for c in range(max(0, column - radius), min(columns, column + radius + 1)):
                        # A line stays on the surfaces in front: it never bleeds onto the background.
                        if owners[r, c] >= 0 and marks[r, c] < mark:
                            marks[r, c] = mark
    return marks


@njit(cache=True)
def _reached(reach: Float32Array, x: float, y: float, height: float) -> float:
    """Share of the light that arrives at one place, 0 to 1: bilinear between four places of the map."""
    x -= 0.5
    y -= 0.5
    row, column = math.floor(y), math.floor(x)
    if row < 0 or column < 0 or row + 1 >= reach.shape[0] or column + 1 >= reach.shape[1]:
        return 1.0
    right, down = x - column, y - row
    share = 0.0
    if reach[row, column] <= height:
        share += (1.0 - right) * (1.0 - down)
    if reach[row, column + 1] <= height:
        share += right * (1.0 - down)
    if reach[row + 1, column] <= height:
        share += (1.0 - right) * down
    if reach[row + 1, column + 1] <= height:
        share += right * down
    return share


@njit(cache=True)
def _light(
    x: float,
    y: float,
    z: float,
    nx: float,
    ny: float,
    nz: float,
    skies: Float32Array,
    sky_axes: FloatArray,
    sky_bias: float,
    sun: Float32Array,
    sun_axes: FloatArray,
    sun_bias: float,
) -> tuple[float, float]:
    """Skylight and sunlight that arrive at one place of a surface, 0 to 1 each."""
    arrived = possible = 0.0
    px, py, pz = x + sky_bias * nx, y + sky_bias * ny, z + sky_bias * nz
    for d in range(skies.shape[0]):
        axes = sky_axes[d]
        # The third axis is the direction to the light times the map's scale.
        slope = nx * axes[2, 0] + ny * axes[2, 1] + nz * axes[2, 2]
        if slope <= 0.0:
            continue
        possible += slope
        arrived += slope * _reached(
            skies[d],
            px * axes[0, 0] + py * axes[0, 1] + pz * axes[0, 2] + axes[0, 3],
            px * axes[1, 0] + py * axes[1, 1] + pz * axes[1, 2] + axes[1, 3],
            px * axes[2, 0] + py * axes[2, 1] + pz * axes[2, 2] + axes[2, 3],
        )
    open_sky = arrived / possible if possible > 0.0 else 0.5
    # What faces down gets its light back from the floor.
    sky = (0.6 + 0.4 * nz) * (0.12 + 0.88 * open_sky)
    facing_x, facing_y, facing_z = sun_axes[2, 0], sun_axes[2, 1], sun_axes[2, 2]
    slope = nx * facing_x + ny * facing_y + nz * facing_z
    scale = math.sqrt(facing_x * facing_x + facing_y * facing_y + facing_z * facing_z)
    if slope <= 0.0:
        return sky, 0.0
    px, py, pz = x + sun_bias * nx, y + sun_bias * ny, z + sun_bias * nz
    column = px * sun_axes[0, 0] + py * sun_axes[0, 1] + pz * sun_axes[0, 2] + sun_axes[0, 3]
    row = px * sun_axes[1, 0] + py * sun_axes[1, 1] + pz * sun_axes[1, 2] + sun_axes[1, 3]
    height = px * facing_x + py * facing_y + pz * facing_z + sun_axes[2, 3]
    share = 0.0
    for i in range(-1, 2):
        for j in range(-1, 2):
            share += _reached(sun, column + 1.6 * i, row + 1.6 * j, height)
    return sky, slope / scale * share / 9.0


@njit(cache=True)
def shade(
    nearness: Float32Array,
    owners: NDArray[np.int16],
    facing: NDArray[np.int16],
    marks: NDArray[np.uint8],
    samples: int,
    colours: FloatArray,
    background: FloatArray,
    eye: FloatArray,
    ray_axes: FloatArray,
    skies: Float32Array,
    sky_axes: FloatArray,
    sky_bias: float,
    sun: Float32Array,
    sun_axes: FloatArray,
    sun_bias: float,
    strengths: FloatArray,
) -> Float32Array:
    """Light the z-buffer and average it to the picture's pixels.

    Args:
        nearness: (rows · samples, columns · samples).
        owners: as ``nearness``; an index into ``colours`` or :data:`packenv.view.zbuffer_kernels.NOTHING`.
        facing: as ``nearness``, with 3 values.
        marks: as ``nearness``, from :func:`mark_edges`.
        samples: sub-pixels along each side of a pixel.
        colours: (k, 3) linear light that each owner sends back, 0 to 1.
        background: (3,) linear light.
        eye: (3,) m.
        ray_axes: (3, 3) rows: change of the view ray (of unit depth) for a column, for a row, and the ray
            through the corner (0, 0).
        skies: (d, s, s) light maps of skylight from d directions.
        sky_axes: (d, 3, 4) to each map's column, row and height.
        sky_bias: m along the normal, to keep a surface from shading itself.
        sun: (s', s') light map of the sun.
        sun_axes: (3, 4).
        sun_bias: as ``sky_bias``.
        strengths: (6,) of skylight, of sunlight, what a crease and a silhouette leave of the light, and the
            shares of its shade that the last owner, the box, shows on its walls and on its floor.

    Returns:
        (rows, columns, 3) linear light.
    """
    rows, columns = nearness.shape[0] // samples, nearness.shape[1] // samples
    picture = np.empty((rows, columns, 3), dtype=np.float32)
    total = samples * samples
    for row in range(rows):
        for column in range(columns):
            top, left = row * samples, column * samples
            own = owners[top, left]
            # Light changes slowly inside a surface: one value serves the pixel unless an edge crosses it.
            same = True
            for r in range(top, top + samples):
                for c in range(left, left + samples):
                    if owners[r, c] != own or marks[r, c] != marks[top, left]:
                        same = False
            red = green = blue = 0.0
            for s in range(1 if same else total):
                r, c = (
                    (top + samples // 2, left + samples // 2)
                    if same
                    else (top + s // samples, left + s % samples)
                )
                owner = owners[r, c]
                weight = total if same else 1
                if owner < 0:
                    red += weight * background[0]
                    green += weight * background[1]
                    blue += weight * background[2]
                    continue
                depth = 1.0 / nearness[r, c]
                x = eye[0] + depth * (
                    ray_axes[2, 0] + (c + 0.5) * ray_axes[0, 0] + (r + 0.5) * ray_axes[1, 0]
                )
                y = eye[1] + depth * (
                    ray_axes[2, 1] + (c + 0.5) * ray_axes[0, 1] + (r + 0.5) * ray_axes[1, 1]
                )
                z = eye[2] + depth * (
                    ray_axes[2, 2] + (c + 0.5) * ray_axes[0, 2] + (r + 0.5) * ray_axes[1, 2]
                )
                sky, direct = _light(
                    x,
                    y,
                    z,
                    facing[r, c, 0] / NORMAL_SCALE,
                    facing[r, c, 1] / NORMAL_SCALE,
                    facing[r, c, 2] / NORMAL_SCALE,
                    skies,
                    sky_axes,
                    sky_bias,
                    sun,
                    sun_axes,
                    sun_bias,
                )
                light = strengths[0] * sky + strengths[1] * direct
                if marks[r, c] > 0:
                    light *= strengths[1 + marks[r, c]]
                if owner == colours.shape[0] - 1:
                    shown = strengths[4] if facing[r, c, 2] < NORMAL_SCALE / 2 else strengths[5]
                    light = 1.0 - shown * (1.0 - light)
                light *= weight
                red += light * colours[owner, 0]
                green += light * colours[owner, 1]
                blue += light * colours[owner, 2]
            picture[row, column, 0] = red / total
            picture[row, column, 1] = green / total
            picture[row, column, 2] = blue / total
    return picture


@njit(cache=True)
def draw_line(
    picture: Float32Array,
    nearness: Float32Array,
    samples: int,
    start: FloatArray,
    end: FloatArray,
    width: float,
    colour: FloatArray,
    opacity: float,
    slack: float,
) -> None:
    """Draw one straight line over the picture, hidden where something is nearer.

    Args:
        picture: (rows, columns, 3) linear light, changed in place.
        nearness: (rows · samples, columns · samples).
        samples: sub-pixels along each side of a pixel.
        start: (3,) column, row (in pixels of the picture) and nearness.
        end: (3,) as ``start``.
        width: px.
        colour: (3,) linear light.
        opacity: 0 to 1.
        slack: share by which the surface may be nearer and the line still counts as lying on it.
    """
    rows, columns = picture.shape[0], picture.shape[1]
    dx, dy = end[0] - start[0], end[1] - start[1]
    squared = max(dx * dx + dy * dy, 1e-12)
    margin = width / 2.0 + 1.0
    first_row = max(0, math.floor(min(start[1], end[1]) - margin))
    last_row = min(rows - 1, math.ceil(max(start[1], end[1]) + margin))
    first_column = max(0, math.floor(min(start[0], end[0]) - margin))
    last_column = min(columns - 1, math.ceil(max(start[0], end[0]) + margin))
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            x, y = column + 0.5 - start[0], row + 0.5 - start[1]
            along = min(1.0, max(0.0, (x * dx + y * dy) / squared))
            apart = math.sqrt((x - along * dx) ** 2 + (y - along * dy) ** 2)
            cover = min(1.0, max(0.0, width / 2.0 + 0.5 - apart))
            if cover <= 0.0:
                continue
            near = (start[2] + along * (end[2] - start[2])) * (1.0 + slack)
            free = 0
            for r in range(row * samples, (row + 1) * samples):
                for c in range(column * samples, (column + 1) * samples):
                    if nearness[r, c] <= near:
                        free += 1
            cover *= opacity * free / (samples * samples)
            for k in range(3):
                picture[row, column, k] += cover * (colour[k] - picture[row, column, k])
