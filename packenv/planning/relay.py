"""A search in the sequence and layouts by turns: one often packs what the other does not (``--method auto``)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from packenv.geometry.prepare import PreparedItem
from packenv.planning.anytime import Anytime, Budget
from packenv.planning.layouts.layout_packer import LayoutPacker
from packenv.planning.packing import PERHAPS, Packing, Pile
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.types import Container

GLANCE = 0.05
"""Share of a budget after which layouts begin where they do not wait for the search."""
MOSTLY = 0.75
"""The same where they do."""


@dataclass(frozen=True, eq=False)
class Relay:
    """Divides a budget between a search and layouts, while an item is left over that may have a place.

    Under the non-overlap constraints alone layouts begin soon, and the search comes back after half of the budget.
    Else layouts have the last quarter: they know nothing of other constraints.

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
        left, soon = _Left(self.search.budget, self.search.clock), not self.layouts.planner.constraints
        search = replace(self.search, budget=left.until(GLANCE if soon else MOSTLY))
        best, stopped = search.search(sequence, items, container, start)
        if stopped or not best.lost:
            return best
        if all(lost.reason in PERHAPS for lost in best.leftovers):
            budget = left.until(0.5 if soon else 1.0)
            layouts = replace(self.layouts, budget=budget, known=best)
            best, stopped = layouts.search_layouts(sequence, items, container, start)
        if stopped or not best.lost or not soon:
            return best
        search = replace(self.search, budget=left.until(1.0), known=best)
        return search.pack(sequence, items, container, start)


@dataclass(eq=False)
class _Left:
    """What is left of a budget.

    Attributes:
        whole: the budget.
        clock: tells seconds.
        spent: plans that were given away.
    """

    whole: Budget
    clock: Callable[[], float]
    spent: int = 0

    def __post_init__(self) -> None:
        self._began = self.clock()

    def until(self, share: float) -> Budget:
        """What there is until a share of the whole is spent."""
        seconds, plans = self.whole.seconds, self.whole.plans
        if plans is not None:
            before, self.spent = self.spent, int(share * plans)
            plans = self.spent - before
        if seconds is not None:
            seconds = max(0.0, share * seconds - (self.clock() - self._began))
        return Budget(seconds, plans)
