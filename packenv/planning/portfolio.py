"""Several rules, one plan: each plans the order, and the best of their plans is kept (``--heuristic auto``)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from packenv.geometry.prepare import PreparedItem
from packenv.planning.deadline import NEVER, Deadline
from packenv.planning.packing import Packing, Pile
from packenv.planning.planner import Planner
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.heuristics import name_of
from packenv.planning.search.measured import Resting
from packenv.types import Container, Placement


class Packer(Protocol):
    """What packs an order: a planner with one rule, or several of them."""

    def __enter__(self) -> Packer:
        """The packer."""
        ...

    def __exit__(self, *_: object) -> None:
        """Free what its constraints hold."""
        ...

    def pile(self, surface: ContainerMap, resting: Sequence[Resting]) -> Pile:
        """A container to start with, see :meth:`Planner.pile`."""
        ...

    def pack(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> Packing:
        """Pack items one after another, see :meth:`Planner.pack`."""
        ...


@dataclass(frozen=True, eq=False)
class Portfolio:
    """Planners that differ in their heuristic alone, and share constraints and prepared items.

    The plan that is kept places as many items as the best of what the members pack alone, restarts included:
    a member is left out only where a plan has every item and no makeshift placement already, and its restarts
    only where it would make none itself.

    Attributes:
        members: at least one, the one whose plans are mostly kept first.
        better: figures of a packing, the larger the better.
        until: after it only the first plan is made, if there is none yet.
        found: is told of every plan.
    """

    members: Sequence[Planner]
    better: Callable[[Packing], tuple[float, ...]] = field(default_factory=lambda: goal)
    until: Deadline = NEVER
    found: Callable[[Packing], object] = lambda packing: None

    def __enter__(self) -> Portfolio:
        """The portfolio."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the members."""
        for member in self.members:
            member.close()

    def pile(self, surface: ContainerMap, resting: Sequence[Resting]) -> Pile:
        """A container to start with, for any member."""
        return self.members[0].pile(surface, resting)

    def pack(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> Packing:
        """Pack items: every member once; then, if none has placed all, every member with its restarts.

        Args:
            sequence: as for :meth:`Planner.pack`.
            items: likewise.
            container: likewise.
            start: likewise.

        Returns:
            The best packing, the first of equal ones; ``made_by`` is its heuristic.
        """
        members = [replace(member, until=self.until) for member in self.members]
        roomy = members[0].with_room(sequence, items, container, start)
        if roomy is not None:
            roomy = replace(roomy, made_by=name_of(members[0].heuristic))
            self.found(roomy)
            return roomy
        members[0] = members[0].without_room
        found: list[Packing] = []

        def best_possible(member: Planner) -> bool:
            packing = member.pack(sequence, items, container, start)
            found.append(replace(packing, made_by=name_of(member.heuristic)))
            self.found(found[-1])
            return (packing.complete and not packing.risk) or self.until.passed

        # The others look for room with their restarts: it seldom is where the first one found none.
        briefly = (member.without_room if member.strategy.restarts else member for member in members)
        once = [replace(member, strategy=replace(member.strategy, restarts=0)) for member in briefly]
        if not any(best_possible(member) for member in once):
            tried = zip(members, found.copy(), strict=True)
            nearest = sorted(tried, key=lambda pair: self.better(pair[1]), reverse=True)
            restarting = (member for member, packing in nearest if packing.lost or packing.makeshift)
            any(best_possible(member) for member in restarting if member.strategy.restarts)
        return max(found, key=self.better)


def goal(packing: Packing) -> tuple[float, ...]:
    """What makes a plan the better one, the larger the better.

    Most items placed; then the least risk; then the lowest pile, m; then the margin of the item that has
    least, degrees, where margins are told.
    """
    count, safety = len(packing.placements), -packing.risk
    return count, safety, -packing.height, least_margin(packing.placements)


def robustness(packing: Packing) -> tuple[float, ...]:
    """As :func:`goal`, but a larger margin goes before a lower pile."""
    count, safety = len(packing.placements), -packing.risk
    return count, safety, least_margin(packing.placements), -packing.height


def least_margin(placements: Iterable[Placement]) -> float:
    """The margin of the item that has least, degrees; 0 where margins are not told."""
    figures = (p.details.get("stability") for p in placements)
    margins = (float(f["margin_deg"]) for f in figures if isinstance(f, Mapping) and "margin_deg" in f)
    return min(margins, default=0.0)


def fullness(packing: Packing) -> tuple[float, ...]:
    """As :func:`goal` where something goes on into a further box: most volume placed comes first."""
    return packing.utilization, *goal(packing)
