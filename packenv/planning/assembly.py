"""Put a planner together from options: which constraints, how careful, which search."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from packenv.config import GridConfig
from packenv.errors import InputError
from packenv.extensions import code_digest, is_extension, load_extension, made_extension
from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.prepare import PreparedItem
from packenv.planning.admission import Admission
from packenv.planning.anytime import Anytime, Budget
from packenv.planning.constraints import Constraint
from packenv.planning.layouts.guided_local_search import GuidedLocalSearch
from packenv.planning.layouts.layout_packer import LayoutPacker, LayoutSearch
from packenv.planning.layouts.separation import Separation
from packenv.planning.manipulation.checker import ManipulationChecker
from packenv.planning.manipulation.constraint import ManipulationConstraint
from packenv.planning.options import AUTO, OWN, STANDS_FOR_AUTO, PlanOptions, StabilityRule
from packenv.planning.own_rules import OwnConstraint, OwnHeuristic
from packenv.planning.packing import Packing
from packenv.planning.planner import Planner
from packenv.planning.portfolio import Packer, Portfolio, goal
from packenv.planning.relay import Relay
from packenv.planning.search.heuristics import HEURISTICS, Heuristic, heuristic_named, name_of
from packenv.planning.search.orientations import perturbations
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.constraint import StabilityConstraint
from packenv.planning.stability.contact_finder import contact_finder
from packenv.planning.stability.loads import LoadConstraint, LoadLimits
from packenv.planning.stability.margins import MarginRule
from packenv.planning.tiers import Strategy, Tier
from packenv.planning.upright import UprightConstraint
from packenv.robot.reachability import share_of_cell
from packenv.types import Container, Item, OrientedItem

MEMBERS = ("minz", "hm", "dblf", "mta")
"""The rules of ``auto``."""
LAYOUT_SECONDS = 20.0
"""How long layouts are looked for where nothing else is asked."""
_SEARCHES: Mapping[str, Callable[[], LayoutSearch]] = {"separate": Separation, "gls": GuidedLocalSearch}
MARGIN = MarginRule()
"""What a pile survives under ``--stability margin``."""
FAR = 0.75
"""The robot is asked before force balance where it reaches less of the container."""
EACH_WITH_MARGIN = 12
"""Most candidates at one orientation that are checked for a margin where doing without is the alternative."""
EACH_WITH_ROOM = 4
"""The same where there is also clearance."""
MOST_WITH_ROOM = 40
"""Most candidates that are checked there."""
ASIDE = 0.004
"""How far beside its place an item also has to stand under the margin rule where there is clearance, m: twice the
standard deviation of a robot's errors."""
LITTLE = MarginRule(3.0, 0.4, 0.002)
"""What is asked there of an item that has no such place."""
AWAY = 0.02
"""How far aside from what may not stay where it was put others like it are placed, if there is such a place, m."""


class PlanningItems(Protocol):
    """All that planning needs of items, by name; :class:`packenv.items.shelf.ItemShelf` has it."""

    @property
    def grid(self) -> GridConfig:
        """The discretization that they are prepared for."""
        ...

    @property
    def shapes(self) -> Mapping[str, Item]:
        """The items, as the geometry that is planned with."""
        ...

    @property
    def prepared(self) -> Mapping[str, PreparedItem]:
        """Their stable poses and heightmaps."""
        ...

    @property
    def fields(self) -> Mapping[str, SurfaceField]:
        """Their surfaces; not read under the overlap constraints where no item is limited."""
        ...

    @property
    def masses(self) -> Mapping[str, float]:
        """Kg."""
        ...

    @property
    def limited(self) -> bool:
        """Whether an item of theirs may have limits."""
        ...


def margin_rule(stability: StabilityRule) -> MarginRule | None:
    """What a stability rule asks for beyond equilibrium."""
    return MARGIN if stability == "margin" else None


def counts_prestress(stability: StabilityRule) -> bool:
    """Whether a stability rule lets contacts press against each other without a cause."""
    return stability == "paper"


def clearances(clearance: float, grid: GridConfig) -> tuple[int, ...]:
    """Cells of clearance to try, the most first: all that was asked for (m), a third, none."""
    widest = math.ceil(clearance / grid.cell_size - 1e-9)
    return tuple(dict.fromkeys((widest, math.ceil(widest / 3), 0)))


def with_margin(constraints: Sequence[Constraint], rule: MarginRule) -> dict[str, Constraint]:
    """The stability constraint among them, on the same states, that also asks a new item for a margin."""
    return {c.name: replace(c, alone=rule) for c in constraints if isinstance(c, StabilityConstraint)}


def heuristic_of(options: PlanOptions) -> Heuristic:
    """The heuristic that the options name; of ``auto`` the one that stands for it where one has to do.

    Raises:
        InputError: there is no such own heuristic.
    """
    given = options.heuristic
    if not isinstance(given, str):
        label = getattr(given, "__qualname__", type(given).__name__)
        return given if name_of(given) != "own" else OwnHeuristic(given, label)
    given = STANDS_FOR_AUTO if given == AUTO else given
    if given in HEURISTICS:
        return heuristic_named(given, options.tie_break)
    _refuse_nameless(given, "heuristic")
    found: Heuristic = load_extension(given, "heuristic")
    if not callable(found):
        raise InputError(f"heuristic {given}: is no function of candidates and a random generator")
    return OwnHeuristic(found, given)


def own_constraint(given: str | Constraint) -> Constraint:
    """A constraint of the user's own.

    Args:
        given: an object, or ``module:name`` of one, or of a class or function without arguments that makes one.

    Raises:
        InputError: there is none of that name, or it is no constraint.
    """
    if isinstance(given, Constraint):
        return given
    _refuse_nameless(given, "constraint")
    made: Constraint = made_extension(
        given,
        "constraint",
        lambda found: isinstance(found, Constraint),
        "an object of a class that is derived from packenv.Constraint",
    )
    return made


def _refuse_nameless(name: str, what: str) -> None:
    if name == OWN:
        raise InputError(f"this plan was made with an own {what} that has no name: give the {what} again")


def constraints_of(
    options: PlanOptions,
    items: PlanningItems,
    container: Container,
    *,
    margins: bool = False,
    manipulation: ManipulationConstraint | None = None,
) -> tuple[Constraint, ...]:
    """The constraints that the options ask, physics left out, in the order in which they are asked.

    Args:
        options: how to plan.
        items: every item of the order.
        container: the box; the robot's cell depends on it.
        margins: have the margin of every placed item in its figures, a few milliseconds each.
        manipulation: to use again, with the grasps that it knows.
    """
    found: list[Constraint] = [UprightConstraint(items.prepared)] if items.limited else []
    rule = margin_rule(options.stability)
    contacts = contact_finder(options.contacts, options.setup.friction, tight=rule is not None)
    loads = LoadLimits(items.shapes, items.fields, contacts) if items.limited else None
    if options.constraints != "overlap":
        checker = StabilityChecker(options.setup.friction)
        found.append(
            StabilityConstraint(
                items.fields,
                items.shapes,
                checker,
                rule,
                options.contacts,
                with_margin=margins,
                prestress=counts_prestress(options.stability),
                loads=loads,
            )
        )
    elif loads is not None:
        found.append(LoadConstraint(loads))
    if options.constraints == "robot":
        cell = options.setup.with_container(container)
        robot = manipulation or ManipulationConstraint(ManipulationChecker(cell), options.grasp, items.masses)
        # What is often refused, and soon, is asked first.
        found.insert(0 if share_of_cell(cell) < FAR else len(found), robot)
    for given in options.own_constraints:
        label = given if isinstance(given, str) else type(given).__name__
        found.append(OwnConstraint(own_constraint(given), label).for_order(items.shapes, container))
    return tuple(found)


def own_code(options: PlanOptions) -> tuple[str, ...]:
    """Digests of the files of own code that the options name: what results depend on besides its names."""
    names = (options.heuristic, *options.own_constraints)
    return tuple(code_digest(name) for name in names if isinstance(name, str) and is_extension(name))


def assemble(
    options: PlanOptions,
    items: PlanningItems,
    container: Container,
    *,
    margins: bool = False,
    give_up: bool = False,
) -> Planner:
    """The planner that the options ask for; of ``auto`` the one that :func:`packer` makes several of.

    Args:
        options: how to plan.
        items: every item of the order.
        container: the box.
        margins: as for :func:`constraints_of`.
        give_up: end at the first item that finds no place, as the paper does, instead of packing the rest.

    Raises:
        InputError: an own heuristic or constraint cannot be used.
        ValueError: the options ask for physics, which :mod:`packenv.execution.physics_planner` adds.
    """
    if options.stability == "physics":
        raise ValueError("stability is 'physics': let packenv.execution.physics_planner make the planner")
    constraints = constraints_of(options, items, container, margins=margins)
    levels = clearances(options.clearance, options.grid)
    wider = bool(constraints) or options.search == "5d"

    def perturbed(name: str) -> Iterator[tuple[OrientedItem, ...]]:
        return perturbations(items.shapes[name], items.prepared[name].poses, options.grid, container.size)

    strategy = Strategy(
        tuple(Tier(cells) for cells in levels), restarts=options.restarts, clearance=levels[0]
    )
    if options.constraints != "overlap" and options.stability == "cautious":
        strategy = _cautious(strategy, constraints, levels, options)
    heuristic = heuristic_of(options)
    return Planner(
        heuristic,
        options.grid,
        constraints,
        perturbed if wider else None,
        strategy,
        options.search,
        options.max_checked,
        give_up,
        options.seed,
        options.setup.release_height,
        items.shapes if options.heights == "mesh" else None,
        # FirstFit and Random are yardsticks: they know no better place than the next one.
        "grid" if name_of(heuristic) in ("first-fit", "random") else options.places,
        Admission(items.shapes),
    )


def packer(
    options: PlanOptions,
    planner: Planner,
    shapes: Mapping[str, Item],
    better: Callable[[Packing], tuple[float, ...]] = goal,
    report: Callable[[str], None] = lambda line: None,
    workers: int = 1,
) -> Packer:
    """What packs orders as the options ask: the planner made of them, one for each rule of ``auto``, or layouts.

    Where a drop in physics is asked of every placement a plan takes many seconds: there the planner does alone.
    With a budget it is the search that begins with their plan.

    Args:
        options: how to plan.
        planner: made of them.
        shapes: every item of the order by name, of the geometry that is planned with.
        better: which of several plans is kept.
        report: is told of what a search finds, a line each.
        workers: processes that search; the plan does not depend on it.
    """
    members = [planner]
    if options.heuristic == AUTO and options.stability != "physics":
        members = [replace(planner, heuristic=heuristic_named(name, options.tie_break)) for name in MEMBERS]
    alone = planner if members == [planner] else Portfolio(members, better)
    budget = Budget(options.budget, options.plans)
    method = "separate" if options.method == "auto" else options.method
    layouts = None
    if method != "search":
        given = budget if budget.given else Budget(LAYOUT_SECONDS)
        search = _SEARCHES[method]()
        layouts = LayoutPacker(planner, alone, shapes, search, method, better, given, report=report)
        if options.method != "auto":
            return layouts
    if not budget.given:
        return alone
    walk = Anytime(Portfolio(members, better), budget, options.goal, options.seed, report, better, workers)
    return walk if layouts is None or options.goal in ("height", "robust") else Relay(walk, layouts)


def as_paper(
    levels: Sequence[int], instead: Mapping[str, Constraint] | None = None
) -> tuple[tuple[Tier, ...], ...]:
    """Last resorts of a planner that asks for more than the paper: without it, then without clearance too.

    Args:
        levels: of clearance, the widest first, in cells.
        instead: constraints in place of the planner's.
    """
    tiers = tuple(Tier(cells, instead or {}) for cells in levels)
    # What has room to spare takes it from what comes later.
    return (tiers, tiers[-1:]) if len(tiers) > 1 else (tiers,)


def _cautious(
    strategy: Strategy, constraints: Sequence[Constraint], levels: Sequence[int], options: PlanOptions
) -> Strategy:
    """Does without a margin only for what has no place with one once all others lie.

    An order that leaves something over is planned again with those items first, with or without a margin, and
    in the end as without this preference.
    """
    careful = with_margin(constraints, MARGIN)

    def margin(cells: int) -> Tier:
        return Tier(cells, careful, each=EACH_WITH_MARGIN)

    tight = (margin(0), Tier(0))
    if options.search == "5d":  # which knows no fallback
        return replace(
            strategy, first=tuple(tier for cells in levels for tier in (margin(cells), Tier(cells)))
        )
    return replace(
        strategy,
        first=(margin(0),),
        fallback=(tight,),
        restart_tiers=tight,
        last_resorts=as_paper((0,)),
        clearance=0,
        roomy=_roomy(constraints, levels) if levels[0] else None,
    )


def _roomy(constraints: Sequence[Constraint], levels: Sequence[int]) -> Strategy:
    """One pass with clearance: what may not stay where it is put comes last, and aside from others of its kind."""
    careful = with_margin(constraints, replace(MARGIN, aside=ASIDE))
    little = with_margin(constraints, LITTLE)
    room = [cells for cells in levels if cells]
    aside = ((AWAY, 0.2), (0.0, 1.0))

    def tiers(rules: dict[str, Constraint], *, each: int | None = EACH_WITH_ROOM) -> Iterator[Tier]:
        """Of one degree of care: aside from what may not stay if possible."""
        for apart, risk in aside:
            for cells in room:
                yield Tier(cells, rules, MOST_WITH_ROOM, each, risk, shaky=True, apart=apart, leaning=False)

    def steady(cells: int) -> Tier:
        return Tier(cells, careful, MOST_WITH_ROOM, EACH_WITH_ROOM, leaning=False)

    return Strategy(
        [steady(cells) for cells in room],
        (
            [replace(steady(cells), risk=0.1) for cells in room],
            list(tiers(little)),
            list(tiers({}, each=None)),
            [
                replace(steady(0), risk=1.0),
                Tier(0, risk=1.2, shaky=True, apart=AWAY, leaning=False),
                Tier(0, risk=2.0, shaky=True, leaning=False),
            ],
            [Tier(room[-1], risk=1.2, shaky=True, apart=AWAY)],
            [Tier(0, risk=2.0, shaky=True)],
        ),
        restarts=1,
        clearance=levels[0],
        trial=True,
    )
