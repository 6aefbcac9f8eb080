"""One order, several boxes: fewest boxes, then least volume of them together.

What does not fit into a box goes on into the next one. This is a search by rules, not a proof: the number of boxes is
known to be the least only where a bound says so.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations_with_replacement

from packenv.execution.planning_job import PlanningJob
from packenv.execution.smallest_box import pack_smallest
from packenv.planning.admission import KEPT_APART, OVERWEIGHT
from packenv.planning.packing import PERHAPS, Packing
from packenv.types import Container, Leftover, OrderLine, limits_in
from packenv.watcher import SILENT

ROUNDS = 2
"""Most further distributions, each with the last box's items first, that are tried for one box fewer."""
SMALLER = 4
"""Most sets of kinds with less volume that are tried."""
SPARE = 0.05
"""By how much a box that is worth a try may have to be fuller than the fullest so far, as a share of its volume."""
_GOES_ON = (*PERHAPS, OVERWEIGHT, KEPT_APART)
"""Reasons of leftovers that speak of what else is in the box: an empty one is likely to take the item."""


def pack_boxes(
    job: PlanningJob, kinds: Sequence[Container], sequence: Sequence[str], most: int
) -> list[Packing]:
    """Pack an order into as few boxes as are found to do, and of such into little volume.

    Args:
        job: packs; its items are loaded.
        kinds: the boxes that there are, each as often as needed, the smallest first.
        sequence: item names, a name as often as the order has it.
        most: boxes that may be used, at least 1.

    Returns:
        A packing for each box, at least one; what no box takes is left over in the last. Where one box is allowed, or
        does, it is that of :func:`packenv.execution.smallest_box.pack_smallest`.
    """
    found = _Search(replace(job, watcher=SILENT), kinds, most).several(sequence) if most > 1 else []
    return found if len(found) > 1 or (found and found[0].complete) else [pack_smallest(job, kinds, sequence)]


def shared_out(lines: Sequence[OrderLine], packings: Sequence[Packing]) -> list[tuple[OrderLine, ...]]:
    """The lines of an order that ask for what is in each box or left over with it, in the order's sequence."""
    wanted = [
        Counter([*(p.item for p in packing.placements), *(left.item for left in packing.leftovers)])
        for packing in packings
    ]
    shares: list[list[OrderLine]] = [[] for _ in packings]
    limits = limits_in(lines)  # those of a line hold for all pieces of its item
    for line in lines:
        rest = line.qty
        for want, share in zip(wanted, shares, strict=True):
            if taken := min(rest, want[line.item]):
                share.append(OrderLine(line.item, taken, limits.get(line.item, line.limits)))
                want[line.item] -= taken
                rest -= taken
    return [tuple(share) for share in shares]


@dataclass(eq=False)
class _Search:
    """Distributions of one order.

    Attributes:
        job: packs.
        kinds: the smallest first.
        most: boxes that may be used.
        takes: of names that were asked for, which kinds take one piece alone.
        told: why a name was left over last.
    """

    job: PlanningJob
    kinds: Sequence[Container]
    most: int
    takes: dict[str, list[Container]] = field(default_factory=dict)
    told: dict[str, Leftover] = field(default_factory=dict)

    def several(self, sequence: Sequence[str]) -> list[Packing]:
        """The best distribution that was found; empty where no box takes anything."""
        best = self.distributed(sequence)
        for _ in range(ROUNDS):
            if not self.fewer_may_do(sequence, best):
                break
            last = [p.item for p in best[-1].placements] + self.left_of(sequence, best)
            sequence = [*last, *_without(sequence, last)]
            again = self.distributed(sequence)
            if _goodness(again) <= _goodness(best):
                break
            best = again
        best = self.in_smaller_boxes(best, sequence)
        lost = [self.told[name] for name in self.left_of(sequence, best)]
        kept = [replace(packing, leftovers=()) for packing in best]
        return [*kept[:-1], replace(kept[-1], leftovers=tuple(lost))] if kept else []

    def distributed(self, sequence: Sequence[str]) -> list[Packing]:
        """One box after another, each as full as it gets, the last as small as may be."""
        rest, found = self.possible(sequence), list[Packing]()
        while rest and len(found) < self.most:
            packing = self.next_box(rest)
            if packing.placements:
                found.append(packing)
            left = self.possible(_without(rest, (p.item for p in packing.placements)))
            if len(left) == len(rest):
                break
            rest = left
        return found

    def next_box(self, rest: Sequence[str]) -> Packing:
        """The smallest kind that takes the rest, else the largest one that takes its most demanding item, full."""
        kind = min((self.kinds_for(name) for name in rest), key=len)[-1]
        for_all = [k for k in self.kinds if all(k in self.kinds_for(name) for name in rest)]
        whole = self.job.smallest_for_all([k for k in for_all if k is not kind], rest)
        if whole is not None:
            return whole
        packing = self.job.fill(kind, [name for name in rest if kind in self.kinds_for(name)])
        if kind in for_all and self.volume(rest) <= (packing.utilization + SPARE) * kind.volume:
            again = self.job.pack(kind, rest)  # with restarts
            packing = again if again.complete else packing
        for left in packing.leftovers:
            self.told[left.item] = left
            if left.item not in self.takes and not (packing.placements and left.reason in _GOES_ON):
                self.takes[left.item] = [k for k in self.kinds if self.job.fill(k, [left.item]).complete]
        return packing

    def kinds_for(self, name: str) -> Sequence[Container]:
        """The kinds that take an item, the smallest first; all of them where nobody asked."""
        return self.takes.get(name, self.kinds)

    def possible(self, names: Iterable[str]) -> list[str]:
        """Those of them that some kind takes, as far as is known."""
        return [name for name in names if self.kinds_for(name)]

    def fewer_may_do(self, sequence: Sequence[str], found: Sequence[Packing]) -> bool:
        """Whether more than one box is used, or too few, and less do that are a little fuller than the fullest."""
        lost = self.left_of(self.possible(sequence), found)
        boxes = len(found) if lost else len(found) - 1
        names = self.possible(sequence)
        largest = max(kind.volume for kind in self.kinds)
        limits = [kind.max_kg for kind in self.kinds if kind.max_kg is not None]
        mass = sum(self.job.shelf.masses[name] for name in names)
        if len(limits) == len(self.kinds) and mass > boxes * max(limits):
            return False
        groups = {self.job.shelf.items[name].limits.keep_apart for name in names} - {None}
        return (
            boxes > 1 and len(groups) <= boxes and self.volume(names) <= boxes * largest * self.likely(found)
        )

    def likely(self, found: Iterable[Packing]) -> float:
        """How full a box may become: as the fullest, or a little more."""
        return max(packing.utilization for packing in found) + SPARE

    def volume(self, names: Iterable[str]) -> float:
        """Of items, m³."""
        return sum(self.job.shelf.prepared[name].volume for name in names)

    def left_of(self, sequence: Sequence[str], found: Iterable[Packing]) -> list[str]:
        """What of an order is in none of these boxes."""
        return _without(sequence, (p.item for packing in found for p in packing.placements))

    def in_smaller_boxes(self, found: list[Packing], sequence: Sequence[str]) -> list[Packing]:
        """As many boxes with less volume: another set of kinds, else each box's items in a smaller kind."""
        if not found:
            return []
        names = _without(sequence, self.left_of(sequence, found))
        volume, inside, limit = _volume(found), self.volume(names), self.likely(found)
        sets = sorted(combinations_with_replacement(self.kinds[::-1], len(found)), key=_total)
        smaller = [kinds for kinds in sets if _total(kinds) < volume and _total(kinds) * limit >= inside]
        for kinds in smaller[-SMALLER:]:  # the largest of them are the likeliest to do
            again = self.in_these(kinds, names, limit)
            if again:
                return again
        return [self.in_smaller_box(packing, sequence) for packing in found]

    def in_smaller_box(self, packing: Packing, sequence: Sequence[str]) -> Packing:
        """The items of a box in the smallest kind that takes them."""
        own = _without(sequence, _without(sequence, (p.item for p in packing.placements)))
        kinds = [kind for kind in self.kinds if kind.volume < packing.container.volume]
        return self.job.smallest_for_all(kinds, own) or packing

    def in_these(self, kinds: Sequence[Container], names: Sequence[str], limit: float) -> list[Packing]:
        """All items in these boxes, one after another; empty where they do not do."""
        rest, found = list(names), list[Packing]()
        for k, kind in enumerate(kinds):
            if self.volume(rest) > limit * _total(kinds[k:]):
                return []
            own = [name for name in rest if kind in self.kinds_for(name)]
            packing = self.job.fill(kind, own)
            if not packing.placements:
                return []
            found.append(packing)
            rest = _without(rest, (p.item for p in packing.placements))
            if not rest:
                return found
        return []


def _goodness(found: Sequence[Packing]) -> tuple[int, int, float]:
    """The larger the better: items in boxes, few boxes, little volume."""
    return sum(len(packing.placements) for packing in found), -len(found), -_volume(found)


def _volume(found: Iterable[Packing]) -> float:
    return _total(packing.container for packing in found)


def _total(kinds: Iterable[Container]) -> float:
    return sum(kind.volume for kind in kinds)


def _without(names: Iterable[str], others: Iterable[str]) -> list[str]:
    """A sequence without some of its pieces: of each name the first ones go."""
    gone, kept = Counter(others), []
    for name in names:
        if gone[name]:
            gone[name] -= 1
        else:
            kept.append(name)
    return kept
