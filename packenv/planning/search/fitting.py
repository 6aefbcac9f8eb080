"""Orientations of an item that fits a container at none of those that are tried of every item."""

from __future__ import annotations

import math
from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np

from packenv.config import CLEARANCE, GridConfig
from packenv.geometry.heightmaps import orient_item
from packenv.geometry.prepare import PreparedItem
from packenv.geometry.transforms import yaw_rotation
from packenv.planning.search.orientations import euler_zyx
from packenv.planning.search.rotation_search import regions_of_fit
from packenv.types import FloatArray, Item, OrientedItem, StablePose

_Asked = tuple[tuple[float, float, float], GridConfig]

_KNOWN: WeakKeyDictionary[PreparedItem, dict[_Asked, tuple[OrientedItem, ...]]] = WeakKeyDictionary()
"""Of each item that did not fit: containers and grids that were asked for last, and the orientations that fit."""

_MOST_KNOWN = 8
"""Containers and grids of one item; each may keep two dozen heightmaps."""

_YAW_STEP = math.radians(0.25)


def fitting_orientations(
    prepared: PreparedItem, shape: Item, grid: GridConfig, size: tuple[float, float, float]
) -> tuple[OrientedItem, ...]:
    """An item at its stable poses and yaws; where it fits the container at none of these, where it does fit.

    Those are its stable poses at other yaws, and only where there are none, leaning orientations. What no rotation
    at all brings into the container is given at its stable poses and yaws.

    Args:
        prepared: the item with its orientations.
        shape: its mesh.
        grid: the discretization.
        size: of the container, m.
    """
    largest = np.add(size, CLEARANCE)
    if any((oriented.extents <= largest).all() for oriented in prepared.orientations):
        return prepared.orientations
    asked, known = (size, grid), _KNOWN.setdefault(prepared, {})
    if asked not in known:
        if len(known) == _MOST_KNOWN:
            del known[next(iter(known))]
        known[asked] = turned_to_fit(shape, prepared.poses, grid, size) or leaning_to_fit(
            shape, prepared.poses, grid, size
        )
    return known[asked] or prepared.orientations


def turned_to_fit(
    item: Item, poses: Sequence[StablePose], grid: GridConfig, size: tuple[float, float, float]
) -> tuple[OrientedItem, ...]:
    """The stable poses at those yaws at which the item fits a container, where there are such yaws.

    Of every range of yaws that fit, the one with most room is taken. Yaws are tried every quarter of a degree, and
    four times as close where the item may fit in between.

    Args:
        item: the item.
        poses: its stable poses that are tried.
        grid: the cell size counts.
        size: of the container, m.
    """
    outline = _outline(item)
    coarse = np.arange(0.0, math.pi, _YAW_STEP)
    between = (np.arange(4) - 1.5) / 4 * _YAW_STEP
    found = []
    for index, pose in enumerate(poses):
        points = outline @ pose.rotation.T
        if np.ptp(points[:, 2]) > size[2] + CLEARANCE:
            continue
        # A step of half the distance moves each end of an extent by as much of the item's radius at most.
        reach = float(np.linalg.norm(np.ptp(points[:, :2], axis=0))) * _YAW_STEP / 2
        near = coarse[_room(points, coarse, size) >= -CLEARANCE - reach]
        yaws = np.sort(np.concatenate([near, (near[:, None] + between).ravel()])) % math.pi
        room = _room(points, yaws, size)
        fits = np.flatnonzero(room >= -CLEARANCE)
        gaps = np.flatnonzero(np.diff(yaws[fits]) > 1.01 * _YAW_STEP)
        for ranges in np.split(fits, gaps + 1):
            if len(ranges):
                yaw = float(yaws[ranges[int(np.argmax(room[ranges]))]])
                rotation = yaw_rotation(yaw) @ pose.rotation
                found.append(orient_item(item, rotation, cell_size=grid.cell_size, pose_index=index, yaw=yaw))
    return tuple(found)


def leaning_to_fit(
    item: Item, poses: Sequence[StablePose], grid: GridConfig, size: tuple[float, float, float]
) -> tuple[OrientedItem, ...]:
    """The item at rotations at which it fits a container, stable poses or not; none where it never fits.

    Each counts as its nearest stable pose, at the yaw that is left, as of a line: from 0 up to π.

    Args:
        item: the item.
        poses: its stable poses that are tried; at least one.
        grid: the cell size counts.
        size: of the container, m.
    """
    up = np.array([pose.rotation[2] for pose in poses])
    found = []
    for rotation in regions_of_fit(_outline(item), item.com, size):
        index = int(np.argmax(up @ rotation[2]))
        yaw = euler_zyx(rotation @ poses[index].rotation.T)[0] % math.pi
        found.append(orient_item(item, rotation, cell_size=grid.cell_size, pose_index=index, yaw=yaw))
    return tuple(found)


def _outline(item: Item) -> FloatArray:
    """(n, 3) vertices of the convex hull, mesh frame, m."""
    from scipy.spatial import ConvexHull  # a third of a second, and most orders need none

    outline: FloatArray = item.vertices[ConvexHull(item.vertices).vertices]
    return outline


def _room(points: FloatArray, yaws: FloatArray, size: tuple[float, float, float]) -> FloatArray:
    """(n,) what (v, 3) points leave free in x and y at (n,) yaws, the lesser of both, m."""
    c, s = np.cos(yaws), np.sin(yaws)
    x = np.outer(c, points[:, 0]) - np.outer(s, points[:, 1])
    y = np.outer(s, points[:, 0]) + np.outer(c, points[:, 1])
    room: FloatArray = np.minimum(size[0] - np.ptp(x, axis=1), size[1] - np.ptp(y, axis=1))
    return room
