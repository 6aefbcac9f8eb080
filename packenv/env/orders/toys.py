"""Toy orders: a box cut into boxes, so that a perfect packing is known."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from packenv.config import HEIGHT_QUANTUM
from packenv.env.orders.cuts import CUTS, Piece, Size
from packenv.env.orders.records import GeneratedOrder
from packenv.errors import InputError
from packenv.geometry.mass import estimated_mass, solid_properties
from packenv.geometry.meshes import LoadedMesh, make_item
from packenv.types import Container, FloatArray, Item, Placement

MOST_PIECES = 12
"""More pieces take the search for slices seconds and leave splinters."""

DEFAULT_CONTAINER = Container(0.32, 0.32, 0.30)

_TRIES = 100
_NOISE = 1e-6


@dataclass(frozen=True)
class ToyOrders:
    """The container, filled with a box that is cut into pieces along whole steps.

    A piece's sides are whole steps, each shaved by less than one height quantum (0.95 µm) to a multiple of
    it: heightmaps round heights up to whole quanta, and without the shaving a stack as high as the container
    would seem a few micrometres higher. The pieces fill more than 99.99 % of the box. Their names tell their
    sides in mm, so a name is one and the same item in all orders.

    ``slices`` (:func:`packenv.env.orders.cuts.slices`) is the level that can be solved one item after
    another; ``guillotine`` is a harder one, for searches and for learning. Orders of 100 that the planner
    packs whole, by volume, without restarts and under non-overlap alone, in the default container:

    ============  ======  ====  ====  ====  ====  ========  ======
    cut           pieces  HM    DBLF  MTA   MinZ  FirstFit  Random
    ============  ======  ====  ====  ====  ====  ========  ======
    slices        4       100   100   100   100   100       9
    slices        8       100   100   100   100   100       0
    slices        12      100   100   100   100   100       0
    guillotine    4       40    19    26    22    19        7
    guillotine    8       6     3     10    4     3         1
    guillotine    12      1     0     1     0     0         0
    ============  ======  ====  ====  ====  ====  ========  ======

    Attributes:
        pieces: least and most pieces; how many is drawn evenly.
        container: the box, whole steps long, wide and high.
        cut: ``slices`` or ``guillotine``.
        step: m; where it is a multiple of the planner's grid step the solution lies on its grid.
        shortest: the shortest side that a piece may have, m; a suction cup needs a face of 0.03 m.
        shuffle: hand the pieces out in a drawn sequence instead of that of the solution.
    """

    pieces: tuple[int, int] = (4, 8)
    container: Container = DEFAULT_CONTAINER
    cut: str = "slices"
    step: float = 0.01
    shortest: float = 0.03
    shuffle: bool = False

    def __post_init__(self) -> None:
        """Check that the box can be cut so.

        Raises:
            InputError: an unknown cut, a size that is not in whole steps, or pieces that do not come out.
        """
        if self.cut not in CUTS:
            raise InputError(f"toy orders: cut is {self.cut!r}, give one of {', '.join(CUTS)}")
        for axis, side in zip(("length", "width", "height"), self.container.size, strict=True):
            if abs(side / self.step - round(side / self.step)) > _NOISE:
                raise InputError(
                    f"toy orders: the container's {axis} is {side:g} m, give a multiple of the step "
                    f"({self.step:g} m)"
                )
        for count in range(self.pieces[0], self.pieces[1] + 1):
            # With a tenth of the tries, so that one that comes out here does not fail in the midst of a run.
            if self._cut(count, np.random.default_rng(0), _TRIES // 10) is None:
                raise InputError(
                    f"toy orders: {self.container.label} cannot be cut into {count} pieces by {self.cut!r} "
                    f"with sides of at least {self.shortest:g} m; give fewer pieces or a smaller 'shortest'"
                )

    def generate(self, rng: np.random.Generator) -> GeneratedOrder:
        """Cut the box; the pieces stand in the sequence of the solution, unless they are shuffled."""
        count = int(rng.integers(self.pieces[0], self.pieces[1] + 1))
        pieces = self._cut(count, rng)
        if pieces is None:
            raise InputError(
                f"toy orders: found no way to cut {self.container.label} into {count} pieces; "
                "give fewer pieces"
            )
        solution = _solution(pieces, self.step)
        items = tuple(placement.item for placement in solution)
        if self.shuffle:
            items = tuple(items[k] for k in rng.permutation(count).tolist())
        boxes = (_item(_sides(piece, self.step)) for piece in pieces)
        meshes = {item.name: item for item in boxes}
        return GeneratedOrder(items, meshes, self.container, solution)

    def _cut(self, count: int, rng: np.random.Generator, most: int = _TRIES) -> tuple[Piece, ...] | None:
        length, width, height = (round(side / self.step) for side in self.container.size)
        box: Size = (length, width, height)
        shortest = max(1, math.ceil(self.shortest / self.step - _NOISE))
        tries = (CUTS[self.cut](box, count, shortest, rng) for _ in range(most))
        return next((pieces for pieces in tries if pieces is not None), None)


def _sides(piece: Piece, step: float) -> tuple[float, float, float]:
    """Sides of a piece along x, y and z as its item has them, m: whole height quanta."""
    x, y, z = (math.floor(s * step / HEIGHT_QUANTUM + _NOISE) * HEIGHT_QUANTUM for s in piece.size)
    return (x, y, z)


def _item(sides: Sequence[float]) -> Item:
    """The item of a piece: boxes with the same sides are one item, however they are turned."""
    return _box(*sorted(sides, reverse=True))


@lru_cache(maxsize=4096)
def _box(long: float, middle: float, short: float) -> Item:
    """The item with these sides along its own x, y and z, m."""
    bits = np.array([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)])
    vertices = bits * np.array([long, middle, short])
    # The low and the high face across each axis, their corners in turn as seen from outside.
    quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    faces = np.array([(a, *two) for a, b, c, d in quads for two in ((b, c), (c, d))], dtype=np.int64)
    name = "toy-" + "x".join(f"{round(side * 1000, 2):g}" for side in (long, middle, short))
    volume = long * middle * short
    mass = estimated_mass(volume, volume)
    mesh = LoadedMesh(vertices, faces, solid_properties(vertices, faces))
    return make_item(name, mesh, file=f"{name}.ply", mass=mass)


def _solution(pieces: Sequence[Piece], step: float) -> tuple[Placement, ...]:
    """Every piece at its place in the box, on what is really below it."""
    seen: Counter[str] = Counter()
    placements: list[Placement] = []
    tops: list[float] = []
    for number, piece in enumerate(pieces):
        below = [tops[k] for k in range(number) if _beneath(pieces[k], piece)]
        sides = _sides(piece, step)
        item = _item(sides)
        rotation = _rotation(sides)
        corner = np.array([piece.corner[0] * step, piece.corner[1] * step, max(below, default=0.0)])
        turned = item.vertices @ rotation.T
        seen[item.name] += 1
        tops.append(float(corner[2]) + sides[2])
        placements.append(
            Placement(
                item=item.name,
                instance=seen[item.name],
                rotation=rotation,
                position=corner - turned.min(axis=0),
                corner=corner,
                extents=np.ptp(turned, axis=0),
                pose_index=_pose_index(sides),
                yaw=0.0 if sides[0] >= sides[1] else math.pi / 2,
                score=0.0,
                candidates=0,
            )
        )
    return tuple(placements)


def _beneath(lower: Piece, upper: Piece) -> bool:
    return lower.corner[2] < upper.corner[2] and all(
        lower.corner[k] < upper.corner[k] + upper.size[k]
        and upper.corner[k] < lower.corner[k] + lower.size[k]
        for k in (0, 1)
    )


def _rotation(sides: Sequence[float]) -> FloatArray:
    """(3, 3) that turns the item's sides, longest first, to these along x, y and z."""
    rotation = np.zeros((3, 3))
    rotation[np.argsort([-side for side in sides], kind="stable"), range(3)] = 1.0
    # An odd permutation mirrors; a box is the same seen from its other end.
    rotation[2] *= np.linalg.det(rotation)
    return rotation


def _pose_index(sides: Sequence[float]) -> int:
    """Place of the resting pose with this height among the box's own, the most probable first.

    Every face of a box is stable, so its probability is its solid angle from the centre, over 4 π.
    """
    chances: dict[float, float] = {}
    for k in range(3):
        a, b, height = sides[(k + 1) % 3], sides[(k + 2) % 3], sides[k]
        angle = 4.0 * math.atan(a * b / (height * math.sqrt(a * a + b * b + height * height)))
        chances[height] = chances.get(height, 0.0) + angle
    return sorted(chances, key=lambda height: -chances[height]).index(sides[2])
