"""Arrangements of small items, for tests."""

from __future__ import annotations

from functools import cache

import numpy as np
import trimesh

from packenv.config import GridConfig
from packenv.items.shelf import ItemShelf
from packenv.planning.layouts.layout import Arrangement, Movable
from packenv.types import Container
from tests.shapes import as_item, ball, box, cup, cylinder
from tests.shelf_samples import shelf_of

GRID = GridConfig(cell_size=0.002, grid_step=0.01, n_poses=3, n_yaws=2)
PITCH = 0.004
BOX = Container(0.14, 0.12, 0.10)
SHAPES = {
    item.name: item
    for item in (
        box(0.05, 0.04, 0.03, "brick"),
        box(0.11, 0.02, 0.018, "stick"),
        ball(0.02),
        cup(0.03, 0.05),
        cylinder(0.016, 0.06),
        as_item(trimesh.creation.annulus(r_min=0.02, r_max=0.03, height=0.012), "ring"),
    )
}


@cache
def shelf() -> ItemShelf:
    """All of them, prepared."""
    return shelf_of(SHAPES, GRID)


def drawn(seed: int, least: int = 3, most: int = 9) -> list[str]:
    """Names of some of them, with repetition."""
    rng = np.random.default_rng(seed)
    return [str(name) for name in rng.choice(sorted(SHAPES), rng.integers(least, most + 1))]


def arrangement_of(names: list[str], container: Container = BOX) -> Arrangement:
    """Items that are nowhere yet."""
    pieces = []
    for name in names:
        oriented = [o for o in shelf().prepared[name].orientations if (o.extents <= container.size).all()]
        pieces.append(Movable(shelf().shapes[name], oriented or shelf().prepared[name].orientations))
    return Arrangement(pieces, container.size, PITCH)


def scattered(seed: int, names: list[str] | None = None) -> Arrangement:
    """Items at random places in the box."""
    rng = np.random.default_rng(seed)
    found = arrangement_of(drawn(seed) if names is None else names)
    for piece in range(len(found.pieces)):
        kind = int(rng.integers(len(found.pieces[piece].orientations)))
        found.move(piece, kind, rng.integers(0, found.places(piece, kind)))
    return found
