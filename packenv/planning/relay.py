"""A search in the sequence first, then layouts: one often packs what the other does not (``--method auto``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from packenv.geometry.prepare import PreparedItem
from packenv.planning.anytime import Anytime, Budget
from packenv.planning.layouts.layout_packer import LayoutPacker
from packenv.planning.packing import PERHAPS, Packing, Pile
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.types import Container


@dataclass(frozen=True, eq=False)
class Relay:
    """Searches for half of the budget; the rest is for layouts, where an item is left over that may have a place.

    Attributes:
        search: the search, with the whole budget.
        layouts: make layouts; its own budget does not count.
    """

    search: Anytime
    layouts: LayoutPacker

    def __enter__(self) -> Relay:
        """The two."""
        return self

    def __exit__(self, *_: object) -> None:
        """Free what their constraints hold."""
        self.search.__exit__()

    def pile(self, surface: ContainerMap, resting: Sequence[Resting]) -> Pile:
        """A container to start with, for both."""
        return self.search.pile(surface, resting)

    def pack(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> Packing:
        """The better one of the two plans; after Ctrl-C, the best that was found until then.

        Args:
            sequence: as for :meth:`packenv.planning.planner.Planner.pack`.
            items: likewise.
            container: likewise.
            start: likewise.
        """
        clock, whole = self.search.clock, self.search.budget
        began = clock()
        half = None if whole.plans is None else whole.plans // 2
        first = Budget(None if whole.seconds is None else whole.seconds / 2, half)
        packing, stopped = replace(self.search, budget=first).search(sequence, items, container, start)
        hopeless = any(left.reason not in PERHAPS for left in packing.leftovers)
        if stopped or hopeless or not packing.lost:
            return packing
        rest = Budget(
            None if whole.seconds is None else max(0.0, whole.seconds - (clock() - began)),
            None if whole.plans is None or half is None else whole.plans - half,
        )
        layouts = replace(self.layouts, budget=rest, otherwise=_Given(packing))
        return layouts.pack(sequence, items, container, start)


@dataclass(frozen=True, eq=False)
class _Given:
    """What a packer falls back to: a packing that is known."""

    packing: Packing

    def __enter__(self) -> _Given:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def pile(self, surface: ContainerMap, resting: Sequence[Resting]) -> Pile:
        return Pile(surface)

    def pack(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> Packing:
        return self.packing
