"""Plans that share their beginnings: what a search for better sequences packs.

A plan is made of a sequence of items and a heuristic for each of them. Two plans that begin alike share that
beginning: each step of a *trail* keeps the pile that it left, so only what comes after the first difference is packed
again. And a plan that becomes worse than another one can be given up on the way, for no later step makes up for it.

A trail tries stable poses alone: what the fallback knows is in the plan that the search begins with.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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

SEVERAL = "search"
"""What made a plan whose items were placed by several heuristics."""
Cost = tuple[int, float, float]
"""What is to be small, see :meth:`Trails.cost`."""


@dataclass(frozen=True)
class Turn:
    """One piece in the sequence of a plan.

    Attributes:
        item: its name.
        rule: index of the heuristic that places it.
    """

    item: str
    rule: int


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
        turns: what is packed, and how.
        steps: one for each turn; fewer in a plan that was given up.
    """

    turns: tuple[Turn, ...]
    steps: tuple[Step, ...]

    @property
    def finished(self) -> bool:
        """Whether no turn is left."""
        return len(self.steps) == len(self.turns)

    @property
    def lost(self) -> list[int]:
        """Turns of the pieces without a place."""
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

    def under(self, ceiling: float) -> Trails:
        """The same, with no item's top above a height, m."""
        return replace(self, rules=[replace(rules, ceiling=ceiling) for rules in self.rules])

    def kept(self, trail: Trail, ceiling: float) -> Trail:
        """The beginning of a plan that is the same under a lower ceiling: until a piece is above it, or lost."""
        tops = (math.inf if step.leftover else _top(step.run.placements) for step in trail.steps)
        count = next((k for k, top in enumerate(tops) if top > ceiling), len(trail.steps))
        return Trail(trail.turns, trail.steps[:count])

    def trail(
        self,
        turns: tuple[Turn, ...],
        parent: Trail | None = None,
        before_step: Callable[[], None] = lambda: None,
        give_up: Callable[[Cost], bool] = lambda cost: False,
    ) -> Trail:
        """Pack a sequence; what it shares with its parent's beginning is taken from there.

        Args:
            turns: what to pack, and how.
            parent: another trail of the same pieces, or the beginning of one.
            before_step: is called before each piece that is packed, and may raise.
            give_up: whether a plan is given up whose cost is at least this; asked after each piece.
        """
        shared = 0
        if parent is not None:
            pairs = enumerate(zip(turns, parent.turns, strict=True))
            shared = next((k for k, (a, b) in pairs if a != b), len(turns))
        steps = list(parent.steps[:shared]) if parent is not None else []
        pieces = pieces_of(turn.item for turn in turns)
        for piece, turn in list(zip(pieces, turns, strict=True))[len(steps) :]:
            before_step()
            steps.append(self.step(piece, turn.rule, steps[-1].pile if steps else self.start))
            if give_up(self.cost(Trail(turns, tuple(steps)))):
                break
        return Trail(turns, tuple(steps))

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
        """The latest turn before which a lost piece has a place; None where it has none in the empty container."""
        piece, rule = Piece(trail.turns[lost].item, 1), trail.turns[lost].rule

        def fits(before: int) -> bool:
            pile = trail.steps[before - 1].pile if before else self.start
            return self.step(piece, rule, pile).leftover is None

        if not fits(0):
            return None
        low, high = 0, lost
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if fits(middle) else (low, middle)
        return low

    def cost(self, trail: Trail) -> Cost:
        """What is to be small: the pieces without a place, the volume of their boxes, m³, then what the aim is.

        That is the height of the pile, m, or the least margin, degrees, with its sign turned. None of the three gets
        smaller with a further step.
        """
        lost, placed = trail.lost, trail.placements
        volume = sum(self.items[trail.turns[k].item].box_volume for k in lost)
        if self.aim == "robust":
            return len(lost), volume, -least_margin(placed)
        return len(lost), volume, _top(placed)

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
            self.made_by(trail),
        )

    def made_by(self, trail: Trail) -> str:
        """The heuristic of all pieces, or that they have several."""
        names = {name_of(self.rules[turn.rule].heuristic) for turn in trail.turns}
        return names.pop() if len(names) == 1 else SEVERAL


def _top(placements: Iterable[Placement]) -> float:
    """Height of a pile, m."""
    return max((float(p.corner[2] + p.extents[2]) for p in placements), default=0.0)


def single_passes(members: Sequence[Planner], *, margins: bool) -> Iterator[PassRules]:
    """The rules of trails: stable poses alone.

    Where exact places are tried, another trail tries the grid alone: in the time of one there are five of those.

    Args:
        members: planners that differ in their heuristic alone.
        margins: whether a margin goes before a better place, where the members want one.
    """
    for member in members:
        strategy, rules = member.strategy, on_stable_poses(member)
        if not margins and strategy.last_resorts:
            bare = Strategy(first=tuple(strategy.last_resorts[-1]), clearance=strategy.clearance)
            rules = replace(rules, strategy=bare)
        yield rules
        if member.places == "exact":
            yield replace(rules, places="grid")


def on_stable_poses(planner: Planner) -> PassRules:
    """How a planner places one item in a restart, at its stable poses alone."""
    tiers = planner.strategy.restart_tiers or planner.strategy.first
    strategy = Strategy(first=tuple(tiers), clearance=planner.strategy.clearance)
    return replace(planner, strategy=strategy, perturbations=None, give_up=False)
