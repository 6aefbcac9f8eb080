"""The planner: packs an order in passes, again with what failed first, until nothing better is in sight."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from packenv.geometry.prepare import PreparedItem
from packenv.planning.packing import Packing, Pile
from packenv.planning.packing_pass import PackingPass, PassRules
from packenv.planning.variants import is_hollow, side_by_side
from packenv.types import Container

_SOME = 3
"""Makeshift placements of a trial for which a further pass is worth its time."""
_LARGE = 0.1
"""Share of the container that a hollow item takes, with what is in it, before its pose is worth a pass of its own."""


@dataclass(frozen=True, eq=False)
class Planner(PassRules):
    """Plans orders; close it, or use it in a ``with`` statement, for its constraints may hold a world."""

    def __enter__(self) -> Planner:
        """The planner."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Free what the constraints hold; the planner can be used again."""
        for constraint in self.constraints:
            constraint.close()

    def pack(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> Packing:
        """Pack items one after another (paper Alg. 4); with restarts, again with what failed first.

        The paper never takes a placement back. A restart does, all at once: what found no place, or a
        makeshift one, goes to the front of the sequence, and the order is planned anew. The fullest packing
        is kept, and of such the one with the least risk.

        Under the non-overlap constraints alone there is no fallback in the sequence: heights only grow, so an
        item that fits nowhere fits nowhere later.

        Args:
            sequence: item names, a name as often as the order has it.
            items: every named item, prepared for ``grid``.
            container: the box.
            start: what the container holds already; empty where None.
        """
        strategy, given = self.strategy, sequence
        roomy = self.with_room(sequence, items, container, start)
        if roomy is not None:
            return roomy
        best = PackingPass(self, items, container, start).pack(sequence)
        last, tried = best, {tuple(sequence)}
        for k in range(strategy.restarts):
            if self.until.passed:
                return best
            if strategy.trial and len(last.makeshift) > _SOME:
                break
            late = list(last.lost)
            # Once: it costs a whole plan.
            late += last.makeshift if k == 0 else ()
            rest = list((Counter(sequence) - Counter(late)).elements())
            sequence = [*late, *sorted(rest, key=list(sequence).index)]
            if not late or tuple(sequence) in tried:
                break
            tried.add(tuple(sequence))
            first = (
                strategy.first if strategy.restart_tiers is None or best.complete else strategy.restart_tiers
            )
            again = replace(self, strategy=replace(strategy, first=first))
            last = PackingPass(again, items, container, start).pack(sequence)
            best = max(best, last, key=_goodness)
        if strategy.restarts and best.improvable and not self.only and not strategy.trial:
            for only in self.narrowed(best, given, items, container):
                if best.complete or self.until.passed:
                    break
                found = PackingPass(replace(self, only=only), items, container, start).pack(given)
                best = max(best, found, key=_goodness)
        for tiers in strategy.last_resorts if strategy.restarts else ():
            if not best.improvable or self.until.passed:
                break
            resort = replace(
                strategy, first=tiers, fallback=(tiers,), restart_tiers=None, last_resorts=(), roomy=None
            )
            found = replace(self, strategy=resort).pack(given, items, container, start)
            if len(found.placements) > len(best.placements):
                best = found
        return best

    def with_room(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> Packing | None:
        """The packing with room to spare of all items that fit at all; None without one, and where none is asked for.

        Its risk has done its part, and is told as none: no packing without room is better for having no such risk.

        Args:
            sequence: as for :meth:`pack`.
            items: likewise.
            container: likewise.
            start: likewise.
        """
        roomy = self.strategy.roomy
        if roomy is None:
            return None
        # Whoever wants no restart wants the sequence as it is.
        roomy = replace(roomy, restarts=min(roomy.restarts, self.strategy.restarts))
        found = replace(self, strategy=roomy).pack(sequence, items, container, start)
        if found.lost or not found.placements:
            return None
        return replace(found, makeshift=(), risk=0.0)

    @property
    def without_room(self) -> Planner:
        """The same planner, which does not ask whether there is room to spare."""
        return replace(self, strategy=replace(self.strategy, roomy=None))

    def narrowed(
        self,
        packing: Packing,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
    ) -> Iterator[Mapping[str, frozenset[bytes]]]:
        """Orientations of one item of an incomplete packing to which a further pass is held.

        Of equal items that were left over those at which side by side more may fit; of the largest hollow item,
        if it is large enough for others to go into it, each of its poses but the one that it has.
        """
        placed = Counter(placement.item for placement in packing.placements)
        run = PackingPass(self, items, container)
        for name in dict.fromkeys(packing.lost):
            if sequence.count(name) > 1:
                found = side_by_side(items[name].volume, run.orientations(name), container.size, placed[name])
                yield from ({name: frozenset([oriented.rotation.tobytes()])} for oriented in found)
        hollow = [
            name
            for name in placed
            if items[name].box_volume > _LARGE * container.volume
            and is_hollow(items[name].volume, run.orientations(name))
        ]
        largest = max(hollow, key=lambda name: (items[name].box_volume, name), default=None)
        if largest is None:
            return
        poses: dict[int, set[bytes]] = {}
        for oriented in run.orientations(largest):
            poses.setdefault(oriented.pose_index, set()).add(oriented.rotation.tobytes())
        has = {p.pose_index for p in packing.placements if p.item == largest}
        yield from ({largest: frozenset(rotations)} for pose, rotations in poses.items() if {pose} != has)


def _goodness(packing: Packing) -> tuple[int, float]:
    return len(packing.placements), -packing.risk


def by_box_volume(names: Sequence[str], items: Mapping[str, PreparedItem]) -> list[str]:
    """The paper's sequence: non-increasing bounding-box volume, then name; what bears nothing comes last."""
    return sorted(names, key=lambda name: (not items[name].limits.bears, -items[name].box_volume, name))
