"""Ways to cut a box into smaller boxes, in whole steps of a grid."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

Size: TypeAlias = tuple[int, int, int]
"""Length, width and height of a box, in steps."""


@dataclass(frozen=True)
class Piece:
    """A box inside the box that was cut.

    Attributes:
        corner: its smallest x, y and z, steps.
        size: along x, y and z, steps.
    """

    corner: Size
    size: Size

    @property
    def volume(self) -> int:
        """In cubic steps."""
        return self.size[0] * self.size[1] * self.size[2]


Cut: TypeAlias = Callable[[Size, int, int, np.random.Generator], "tuple[Piece, ...] | None"]
"""From box, number of pieces, shortest side that a piece may have, and chance to the pieces.

They come in a sequence in which each can be lowered onto those before it. None where no such cuts were
found; the next draw may find some.
"""


_ASKEW = tuple((math.cos(yaw), math.sin(yaw)) for yaw in (math.pi / 8, math.pi / 4))
"""Of 8 yaws; 3 π / 8 is π / 8 with the sides exchanged."""

_TOUCH = 1e-3
"""Pieces are shaved, so this share of a step more than there is room for may still go in."""

_MOST_BOXES = 300
"""Boxes that one search for slices looks at: a new one finds its way sooner than one that got lost."""


def slices(box: Size, count: int, shortest: int, rng: np.random.Generator) -> tuple[Piece, ...] | None:
    """Cut one slice after another off what is left, so that packing by volume gives them back one by one.

    A slice spans what is left of the box in two directions. Its direction and its thickness are drawn
    among those that keep four promises: (1) it has less volume than the slice before it, so the sequence by
    volume is that of the cuts; (2) every upright orientation in which it fits into what is left makes it a
    slice that leaves the same box, up to a turn; (3) it fits in at no yaw between right angles, of 4 or 8
    yaws; (4) what is left can be cut further. Slices across z lie at the bottom.

    So whoever places the pieces by volume, each on the floor of the free space and against one of its ends,
    always faces a free space that is one box, open to the top, into which all remaining pieces fit: no
    placement can be wrong. HM, DBLF, MTA, MinZ and FirstFit all place like this.
    """
    found = _Slicing(shortest, rng).cut((0, 0, 0), box, box[0] * box[1] * box[2] + 1, count)
    return tuple(found) if found is not None else None


class _Slicing:
    """A search for slices that goes back where it gets stuck, and gives up after a while."""

    def __init__(self, shortest: int, rng: np.random.Generator) -> None:
        self.shortest = shortest
        self.rng = rng
        self.left = _MOST_BOXES
        self.hopeless: set[tuple[Size, int, int]] = set()

    def cut(self, corner: Size, box: Size, below: int, count: int) -> list[Piece] | None:
        """Cut a box into ``count`` slices of falling volume, the first of less than ``below``."""
        whole = Piece(corner, box)
        if count == 1:
            return [whole] if whole.volume < below else None
        self.left -= 1
        # Volumes that fall from below `below` add up to less than this; most dead ends are found here.
        if self.left < 0 or whole.volume >= count * below or (box, below, count) in self.hopeless:
            return None
        choices = [
            (axis, thickness)
            for axis in range(3)
            for thickness in range(self.shortest, box[axis] - self.shortest + 1)
            if _slice_volume(box, axis, thickness) < below
            and _leaves_one_box(box, axis, thickness)
            # Last, for it takes longest.
            and not _fits_askew(_with(box, axis, thickness), box)
        ]
        for choice in self.rng.permutation(len(choices)).tolist():
            axis, thickness = choices[choice]
            rest = self.cut(
                _with(corner, axis, corner[axis] + thickness),
                _with(box, axis, box[axis] - thickness),
                _slice_volume(box, axis, thickness),
                count - 1,
            )
            if rest is not None:
                return [Piece(corner, _with(box, axis, thickness)), *rest]
        self.hopeless.add((box, below, count))
        return None


def _slice_volume(box: Size, axis: int, thickness: int) -> int:
    return box[0] * box[1] * box[2] // box[axis] * thickness


def _leaves_one_box(box: Size, axis: int, thickness: int) -> bool:
    """Whether every way to put a slice back into the box leaves the same smaller box, up to a turn."""
    left = sorted(_with(box, axis, box[axis] - thickness))
    for size in itertools.permutations(_with(box, axis, thickness)):
        if any(s > b for s, b in zip(size, box, strict=True)):
            continue
        across = [k for k in range(3) if size[k] != box[k]]
        if len(across) != 1 or sorted(_with(box, across[0], box[across[0]] - size[across[0]])) != left:
            return False
    return True


def _fits_askew(size: Size, box: Size) -> bool:
    """Whether a piece, some side upright, fits into a box at a yaw between two right angles."""
    for x, y, z in itertools.permutations(size):
        if z > box[2]:
            continue
        for cosine, sine in _ASKEW:
            if x * cosine + y * sine < box[0] + _TOUCH and x * sine + y * cosine < box[1] + _TOUCH:
                return True
    return False


def guillotine(box: Size, count: int, shortest: int, rng: np.random.Generator) -> tuple[Piece, ...] | None:
    """Cut through a piece drawn by its volume, anywhere, until there are enough pieces.

    There is a perfect packing, but many wrong turns: a harder level, which no heuristic always solves.
    """
    pieces = [Piece((0, 0, 0), box)]
    while len(pieces) < count:
        # A side must have room for two pieces.
        able = [k for k, piece in enumerate(pieces) if max(piece.size) >= 2 * shortest]
        if not able:
            return None
        volumes = np.array([pieces[k].volume for k in able], dtype=np.float64)
        chosen = pieces.pop(able[int(rng.choice(len(able), p=volumes / volumes.sum()))])
        axis = int(rng.choice([k for k in range(3) if chosen.size[k] >= 2 * shortest]))
        at = int(rng.integers(shortest, chosen.size[axis] - shortest + 1))
        beyond = _with(chosen.corner, axis, chosen.corner[axis] + at)
        pieces += [
            Piece(chosen.corner, _with(chosen.size, axis, at)),
            Piece(beyond, _with(chosen.size, axis, chosen.size[axis] - at)),
        ]
    # From the bottom up: of two pieces above one another the lower one comes first.
    return tuple(sorted(pieces, key=lambda piece: (piece.corner[2], piece.corner)))


def _with(size: Size, axis: int, value: int) -> Size:
    changed = list(size)
    changed[axis] = value
    return (changed[0], changed[1], changed[2])


CUTS: Mapping[str, Cut] = MappingProxyType({"slices": slices, "guillotine": guillotine})
"""Every way to cut by its name in a spec."""
