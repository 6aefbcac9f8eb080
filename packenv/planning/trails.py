"""Plans that share their beginnings: what a search for better sequences packs.

A plan is made of a sequence of items and one heuristic. Two plans whose sequences begin alike share that beginning:
each step of a *trail* keeps the pile that it left, so only what comes after the first difference is packed again.

A trail tries stable poses alone: what the fallback knows is in the plan that the search begins with.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from packenv.geometry.prepare import PreparedItem
from packenv.planning.options import Goal
from packenv.planning.packing import Packing, Pile
from packenv.planning.packing_pass import PackingPass, PassRules
from packenv.planning.planner import Planner
from packenv.planning.portfolio import least_margin
from packenv.planning.search.heuristics import name_of
from packenv.planning.sequence import Piece, pieces_of
from packenv.planning.tiers import Strategy
from packenv.types import Container, Leftover, Placement


@dataclass(frozen=True, eq=False)
class Step:
    """What became of one piece.

    Attributes:
        run: the pass of this piece alone, which has its placement, if any.
        pile: what the container then holds.
        leftover: why the piece has no place; None where it has one.
    """

    run: PackingPass
    pile: Pile
    leftover: Leftover | None


@dataclass(frozen=True, eq=False)
class Trail:
    """A plan with the pile of every step.

    Attributes:
        sequence: item names.
        rule: index of the heuristic.
        steps: one for each name.
    """

    sequence: tuple[str, ...]
    rule: int
    steps: tuple[Step, ...]

    @property
    def lost(self) -> list[int]:
        """Places in the sequence of the pieces without a place."""
        return [k for k, step in enumerate(self.steps) if step.leftover is not None]

    @property
    def placements(self) -> tuple[Placement, ...]:
        """What has a place, in packing sequence."""
        return tuple(p for step in self.steps for p in step.run.placements)


@dataclass(frozen=True, eq=False)
class Trails:
    """Makes trails of one order in one container.

    Attributes:
        rules: how a pass places an item, one for each heuristic.
        items: prepared, by name.
        container: the box.
        start: what lies in it.
        aim: what is better: see :data:`packenv.planning.options.Goal`.
    """

    rules: Sequence[PassRules]
    items: Mapping[str, PreparedItem]
    container: Container
    start: Pile | None
    aim: Goal = "items"

    def trail(
        self,
        sequence: tuple[str, ...],
        rule: int,
        parent: Trail | None = None,
        before_step: Callable[[], None] = lambda: None,
    ) -> Trail:
        """Pack a sequence; what it shares with its parent's beginning is taken from there.

        Args:
            sequence: item names.
            rule: index of the heuristic.
            parent: another trail of the same pieces.
            before_step: is called before each piece that is packed, and may raise.
        """
        shared = 0
        if parent is not None and parent.rule == rule:
            pairs = zip(sequence, parent.sequence, strict=True)
            shared = next((k for k, (a, b) in enumerate(pairs) if a != b), len(sequence))
        steps = list(parent.steps[:shared]) if parent is not None else []
        for piece in pieces_of(sequence)[shared:]:
            before_step()
            steps.append(self.step(piece, rule, steps[-1].pile if steps else self.start))
        return Trail(sequence, rule, tuple(steps))

    def step(self, piece: Piece, rule: int, pile: Pile | None) -> Step:
        """One piece more."""
        rules = self.rules[rule]
        run = PackingPass(rules, self.items, self.container, pile)
        refusal = rules.admission.refusal(piece.item, run.pile.held, self.container)
        if refusal is not None:
            return Step(run, run.pile, Leftover(piece.item, piece.instance, *refusal))
        held = rules.admission.with_item(run.pile.held, piece.item)
        rejected = run.first_pass(piece)
        if rejected is not None:
            return Step(run, run.pile, run.leftover(self.items[piece.item], piece, rejected))
        return Step(run, replace(run.pile, held=held), None)

    def latest(self, trail: Trail, lost: int) -> int | None:
        """The latest step before which a lost piece has a place; None where it has none in the empty container."""
        name, rule = trail.sequence[lost], trail.rule

        def fits(before: int) -> bool:
            pile = trail.steps[before - 1].pile if before else self.start
            return self.step(Piece(name, 1), rule, pile).leftover is None

        if not fits(0):
            return None
        low, high = 0, lost
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if fits(middle) else (low, middle)
        return low

    def cost(self, trail: Trail) -> tuple[int, float, float]:
        """What is to be small: the pieces without a place, the volume of their boxes, m³, then what the aim is.

        That is the height of the pile, m, or the least margin, degrees, with its sign turned.
        """
        lost, placed = trail.lost, trail.placements
        volume = sum(self.items[trail.sequence[k]].box_volume for k in lost)
        if self.aim == "robust":
            return len(lost), volume, -least_margin(placed)
        return len(lost), volume, max((float(p.corner[2] + p.extents[2]) for p in placed), default=0.0)

    def packing(self, trail: Trail) -> Packing:
        """A trail as the planner's result."""
        runs = [step.run for step in trail.steps]
        placements = trail.placements
        lost = tuple(step.leftover for step in trail.steps if step.leftover is not None)
        volume = sum(self.items[p.item].volume for p in placements)
        return Packing(
            self.container,
            placements,
            lost,
            tuple(surface for run in runs for surface in run.surfaces),
            volume / self.container.volume,
            tuple(name for run in runs for name in run.makeshift),
            sum(run.risk for run in runs),
            name_of(self.rules[trail.rule].heuristic),
        )


def single_passes(members: Sequence[Planner]) -> Iterator[PassRules]:
    """The rules of trails: the tiers of a restart and stable poses alone.

    Where exact places are tried, another trail tries the grid alone: in the time of one there are five of those.

    Args:
        members: planners that differ in their heuristic alone.
    """
    for member in members:
        rules = on_stable_poses(member)
        yield rules
        if member.places == "exact":
            yield replace(rules, places="grid")


def on_stable_poses(planner: Planner) -> PassRules:
    """How a planner places one item in a restart, at its stable poses alone."""
    tiers = planner.strategy.restart_tiers or planner.strategy.first
    strategy = Strategy(first=tuple(tiers), clearance=planner.strategy.clearance)
    return replace(planner, strategy=strategy, perturbations=None, give_up=False)
