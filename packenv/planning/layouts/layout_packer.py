"""From an order to a layout, and from that to a plan (``--method gls`` and ``--method separate``)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from packenv.config import CLEARANCE
from packenv.geometry.prepare import PreparedItem
from packenv.planning.anytime import STOPPED, Budget
from packenv.planning.inquiry import Inquiry
from packenv.planning.layouts.effort import Effort
from packenv.planning.layouts.layout import Arrangement, Layout, Movable, WillDo, pitch_for, without_overlap
from packenv.planning.layouts.layout_pass import LayoutPass, Target
from packenv.planning.layouts.loading import loadable, to_untangle
from packenv.planning.packing import Packing, Pile
from packenv.planning.packing_pass import PackingPass
from packenv.planning.planner import Planner
from packenv.planning.portfolio import Packer, goal
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.planning.sequence import pieces_of
from packenv.types import BoolArray, Container, Item

UNTANGLED = 5
"""How often a layout free of overlap, but with a cycle of blocked ways, is changed before it is begun anew."""
SLACK = 0.05
"""Share of a piece's voxels that may be another one's, too, or above it and in its way: voxels are larger than items,
and what is lowered to contact comes to rest a little higher than in the layout, or aside.
"""
PROMISING = 0.005
"""Overlap, as a share of all voxels, up to which layouts are tried out."""


class Trying(Protocol):
    """Looks at layouts on the way.

    Attributes:
        done: whether one is a whole plan.
    """

    done: bool

    def __call__(self, arrangement: Arrangement) -> bool:
        """Whether the search can end."""
        ...


@dataclass(eq=False)
class _Promising:
    """Tries out layouts without overlap, and some with little, each with half of the last one's or less.

    Attributes:
        try_out: whether an arrangement becomes a whole plan.
        least: overlap of the last one that was tried.
        done: whether one did.
    """

    try_out: Callable[[Arrangement], bool]
    least: float = math.inf
    done: bool = False

    def __call__(self, arrangement: Arrangement) -> bool:
        """Whether the search can end: the layout has no overlap, or it becomes a whole plan all the same."""
        overlap = arrangement.overlap
        everything = sum(arrangement.voxels(k).count for k in range(len(arrangement.pieces)))
        if not overlap or (2 * overlap <= self.least and overlap <= PROMISING * everything):
            self.least = overlap
            self.done = self.try_out(arrangement)
        return self.done or not overlap


class LayoutSearch(Protocol):
    """What moves pieces until none overlap."""

    def run(
        self,
        arrangement: Arrangement,
        rng: np.random.Generator,
        effort: Effort,
        will_do: WillDo = without_overlap,
    ) -> Layout:
        """Move the pieces of an arrangement; it then has the layout with least overlap, which is returned."""
        ...


@dataclass(frozen=True, eq=False)
class LayoutPacker:
    """Packs an order by layouts of all its items; what a layout does not place, the planner does.

    Layouts are made until one of them becomes a plan that has every item, or the effort is spent. Then the best plan
    is kept, or the planner's own where that is better.

    Attributes:
        planner: lowers, asks the constraints, and places the rest.
        otherwise: packs the order where no layout becomes a whole plan.
        shapes: every item of the order by name.
        search: makes layouts.
        name: of it, for the record.
        better: figures of a packing, the larger the better.
        budget: how long to go on; a round of moves of all pieces counts as a plan.
        clock: tells seconds.
        report: is told of every better packing, a line each.
        found: is given the packing of every layout that is tried out.
        known: a plan that is kept where no layout becomes a better one, in place of what ``otherwise`` packs.
    """

    planner: Planner
    otherwise: Packer
    shapes: Mapping[str, Item]
    search: LayoutSearch
    name: str
    better: Callable[[Packing], tuple[float, ...]] = field(default_factory=lambda: goal)
    budget: Budget = field(default_factory=Budget)
    clock: Callable[[], float] = time.perf_counter
    report: Callable[[str], None] = lambda line: None
    found: Callable[[Packing], None] = lambda packing: None
    known: Packing | None = None

    def __enter__(self) -> LayoutPacker:
        """The packer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the planner."""
        self.planner.close()

    def pile(self, surface: ContainerMap, resting: Sequence[Resting]) -> Pile:
        """A container to start with, see :meth:`Planner.pile`."""
        return self.planner.pile(surface, resting)

    def pack(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> Packing:
        """Pack items, see :meth:`Planner.pack`; ``made_by`` says whether a layout or the planner did."""
        return self.search_layouts(sequence, items, container, start)[0]

    def search_layouts(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> tuple[Packing, bool]:
        """As :meth:`pack`, and whether somebody stopped it."""
        fits = sum(items[name].volume for name in sequence) <= container.volume
        seconds, rounds = self.budget.seconds, self.budget.plans
        effort = Effort(
            math.inf if seconds is None else seconds,
            math.inf if rounds is None else rounds * len(sequence),
            self.clock,
        )
        rng = np.random.default_rng(self.planner.seed)
        pieces = self.movables(sequence, items, container, start)
        found: list[Packing] = []
        stopped = False

        def try_out(arrangement: Arrangement) -> bool:
            packing = self.lowered(arrangement, pieces, sequence, items, container, start)
            if not found or self.better(packing) > max(map(self.better, found)):
                self.tell(packing, effort)
            found.append(replace(packing, made_by=self.name))
            self.found(packing)
            return packing.complete and not packing.risk

        try:
            while fits and pieces and effort.left():
                promising = _Promising(try_out)
                arrangement = self.arrange(pieces, container, start, rng, effort, promising)
                if promising.done or (arrangement.overlap and try_out(arrangement)):
                    return found[-1], False
        except KeyboardInterrupt:
            stopped = True
            self.report(STOPPED)
        if not any(packing.complete for packing in found):
            found.append(self.known or self.otherwise.pack(sequence, items, container, start))
        return max(found, key=self.better), stopped

    def tell(self, packing: Packing, effort: Effort) -> None:
        """Say what a layout became."""
        self.report(f"after {effort.elapsed:.1f} s of layouts: {packing.words} ({self.name})")

    def movables(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None,
    ) -> dict[int, Movable]:
        """Those pieces that fit the empty box at an orientation that no constraint rules out, by their place in it."""
        run, largest = PackingPass(self.planner, items, container, start), np.add(container.size, CLEARANCE)
        inquiry = Inquiry(self.planner.constraints, run.pile)
        usable = {
            name: [o for o in inquiry.possible(run.orientations(name)) if (o.extents <= largest).all()]
            for name in dict.fromkeys(sequence)
        }
        return {
            k: Movable(self.shapes[name], usable[name]) for k, name in enumerate(sequence) if usable[name]
        }

    def arrange(
        self,
        pieces: Mapping[int, Movable],
        container: Container,
        start: Pile | None,
        rng: np.random.Generator,
        effort: Effort,
        promising: Trying,
    ) -> Arrangement:
        """A layout of the pieces: one that became a whole plan, or else as far as the effort goes."""
        pitch = pitch_for(container)
        arrangement = Arrangement(list(pieces.values()), container.size, pitch)
        if start is not None:
            arrangement.fixed = taken(start.surface, pitch, arrangement.shape)
        self.search.run(arrangement, rng, effort, promising)
        for _ in range(UNTANGLED):
            if promising.done or arrangement.overlap or not effort.left():
                break
            # Free of overlap, and yet no plan: with a cycle it is worth a part of what is left, else a new start.
            pairs, share = to_untangle(arrangement), effort.share(UNTANGLED)
            if not pairs.any():
                break
            arrangement.keep_below(pairs > 0)
            self.search.run(arrangement, rng, share, promising)
            effort.spent += share.spent
        return arrangement

    def lowered(
        self,
        arrangement: Arrangement,
        pieces: Mapping[int, Movable],
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None,
    ) -> Packing:
        """The packing that a layout becomes: what can be loaded in its loading sequence, then all others.

        Args:
            arrangement: the layout.
            pieces: its pieces, by their place in the sequence.
            sequence: item names.
            items: by name.
            container: the box.
            start: what the container holds already.
        """
        loaded = loadable(arrangement, SLACK)
        movables = list(pieces.items())
        first = [movables[k][0] for k in loaded]
        order = [*first, *(k for k in range(len(sequence)) if k not in set(first))]
        names = [sequence[k] for k in order]
        corners = arrangement.at * arrangement.pitch
        targets = {
            piece: Target(movables[k][1].orientations[arrangement.kinds[k]], corners[k])
            for piece, k in zip(pieces_of(names), loaded, strict=False)
        }
        run = LayoutPass(self.planner, items, container, start, targets=targets)
        return run.pack(names)


def taken(surface: ContainerMap, pitch: float, shape: tuple[int, int, int]) -> BoolArray:
    """(nx, ny, nz) voxels that are below a container's surface: nothing can be lowered there.

    Args:
        surface: the container's map.
        pitch: side of a voxel, m.
        shape: voxels of the box.
    """
    heights = surface.heights
    for axis in (0, 1):
        edges = np.arange(shape[axis] + 1) * pitch / surface.cell_size
        first, last = np.floor(edges[:-1] + 1e-6).astype(int), np.ceil(edges[1:] - 1e-6).astype(int)
        parts = [
            heights.take(range(a, min(b, heights.shape[axis])), axis)
            for a, b in zip(first, last, strict=True)
        ]
        heights = np.stack([part.max(axis=axis, initial=0.0) for part in parts], axis=axis)
    levels: BoolArray = np.arange(shape[2]) * pitch < heights[:, :, None] - 1e-6
    return np.ascontiguousarray(levels)
