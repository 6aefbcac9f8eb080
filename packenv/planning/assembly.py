"""Put a planner together from words: which constraints, which stability rule, which search."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from packenv.config import GridConfig
from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.prepare import PreparedItem
from packenv.planning.constraints import Constraint
from packenv.planning.grasps import Rule as GraspRule
from packenv.planning.manipulation import ManipulationChecker
from packenv.planning.manipulation_constraint import ManipulationConstraint
from packenv.planning.margins import MarginRule
from packenv.planning.orientations import perturbations
from packenv.planning.packer import MAX_CHECKED, Planner
from packenv.planning.scores import HEURISTICS
from packenv.planning.stability import StabilityChecker
from packenv.planning.stability_constraint import ContactRule, StabilityConstraint
from packenv.planning.turns import Tier
from packenv.robot.cell import Cell
from packenv.types import Container, Item, OrientedItem

Constraints: TypeAlias = Literal["overlap", "stability", "robot"]
StabilityRule: TypeAlias = Literal["paper", "cautious", "margin", "physics"]
Search: TypeAlias = Literal["3d", "5d"]

MARGIN = MarginRule()
"""What a pile survives under ``--stability margin``."""
MAX_WORLDS = 100
"""Most worlds in which a plan is carried out before it is given out."""
EACH_WARY = 12
"""Most candidates at one orientation that are checked for a margin where doing without is the alternative."""


@dataclass(frozen=True)
class PlannerChoice:
    """What a user chooses of a planner.

    Attributes:
        heuristic: name of the positioning heuristic.
        constraints: ``overlap``; ``stability``: also force balance; ``robot``: also manipulation.
        stability: ``paper``: equilibrium; ``cautious``: of that rather what also survives the margin rule
            while all others are held, and what has no such place goes last; ``margin``: the whole pile also
            survives it; ``physics``: equilibrium, and a drop in physics (:mod:`packenv.physics_planning`).
        search: ``3d`` with the fallback, or ``5d`` at once.
        seed: for heuristics that draw.
        max_checked: the paper's N.
        contacts: ``surface``: what is at most 1.5 mm apart; ``paper``: what overlaps when scaled by 1.03.
        grasp: ``seal``: where the cup lies on the surface, rough spots where there is no flat one; ``flat``:
            flat spots alone; ``paper``: the centre of the top surface, whatever is there.
        restarts: how often an incomplete order is planned again with its leftovers first; the paper: 0.
        give_up: end at the first item that finds no place, as the paper does, instead of packing the rest.
        clearance: how far an item may be off sideways at the release and still meet nothing, m, rounded up to
            whole cells; less, and none in the end, where it leaves an item without a place. The paper: 0.
        rehearse: in how many worlds the plan is carried out before it is given out
            (:mod:`packenv.rehearsal`); read by whoever asks the planner.
        with_margin: report the margin of every placed item, a few milliseconds each.
    """

    heuristic: str = "hm"
    constraints: Constraints = "robot"
    stability: StabilityRule = "cautious"
    search: Search = "3d"
    seed: int = 0
    max_checked: int = MAX_CHECKED
    contacts: ContactRule = "surface"
    grasp: GraspRule = "seal"
    restarts: int = 3
    give_up: bool = False
    with_margin: bool = False
    clearance: float = 0.0
    rehearse: int = 0


@dataclass(frozen=True, eq=False)
class Shelf:
    """All that planning needs of some items, by name.

    Attributes:
        meshes: the items.
        prepared: their stable poses and heightmaps.
        fields: their surfaces; may be empty under the overlap constraints.
    """

    meshes: Mapping[str, Item]
    prepared: Mapping[str, PreparedItem]
    fields: Mapping[str, SurfaceField]


def margin_rule(stability: StabilityRule) -> MarginRule | None:
    """What a stability rule asks for beyond equilibrium."""
    return MARGIN if stability == "margin" else None


def clearances(choice: PlannerChoice, grid: GridConfig) -> tuple[int, ...]:
    """Cells of clearance to try, the most first: all that was asked for, a third, none."""
    widest = math.ceil(choice.clearance / grid.cell_size - 1e-9)
    return tuple(dict.fromkeys((widest, math.ceil(widest / 3), 0)))


def wary(constraints: Sequence[Constraint]) -> tuple[Constraint, ...]:
    """The same constraints, on the same states, that also ask a new item for a margin of its own."""
    return tuple(replace(c, alone=MARGIN) if isinstance(c, StabilityConstraint) else c for c in constraints)


def assemble(
    choice: PlannerChoice,
    shelf: Shelf,
    container: Container,
    grid: GridConfig,
) -> Planner:
    """The planner that a choice names.

    Args:
        choice: what the user chose.
        shelf: every item of the order.
        container: the box; the robot's cell depends on it.
        grid: the discretization that ``shelf.prepared`` was made with.

    Raises:
        ValueError: the choice asks for physics, which :mod:`packenv.physics_planning` adds.
    """
    if choice.stability == "physics":
        raise ValueError("stability is 'physics': let packenv.physics_planning make the planner")
    constraints: list[Constraint] = []
    if choice.constraints != "overlap":
        masses = {name: item.mass for name, item in shelf.meshes.items()}
        constraints.append(
            StabilityConstraint(
                shelf.fields,
                masses,
                StabilityChecker(),
                margin_rule(choice.stability),
                choice.contacts,
                with_margin=choice.with_margin,
            )
        )
    if choice.constraints == "robot":
        constraints.append(ManipulationConstraint(ManipulationChecker(Cell.beside(container)), choice.grasp))
    wider = choice.constraints != "overlap" or choice.search == "5d"

    def perturbed(name: str) -> Iterator[tuple[OrientedItem, ...]]:
        return perturbations(shelf.meshes[name], shelf.prepared[name].poses, grid, container.size)

    levels = clearances(choice, grid)
    planner = Planner(
        HEURISTICS[choice.heuristic],
        grid.step_cells,
        grid.cell_size,
        tuple(constraints),
        perturbed if wider else None,
        choice.search,
        choice.max_checked,
        choice.restarts,
        choice.give_up,
        choice.seed,
        tuple(Tier(cells) for cells in levels),
        clearance=levels[0],
    )
    return _cautious(planner, levels) if constraints and choice.stability == "cautious" else planner


def as_paper(levels: Sequence[int], constraints: Sequence[Constraint]) -> tuple[tuple[Tier, ...], ...]:
    """Last resorts of a planner that asks for more than the paper: without it, then without clearance too.

    Args:
        levels: of clearance, the widest first, in cells.
        constraints: of the paper.
    """
    tiers = tuple(Tier(cells, constraints) for cells in levels)
    # What has room to spare takes it from what comes later.
    return (tiers, tiers[-1:]) if len(tiers) > 1 else (tiers,)


def _cautious(planner: Planner, levels: Sequence[int]) -> Planner:
    """A planner that does without a margin only for what has no place with one once all others lie.

    An order that leaves something over is planned again with those items first, with or without a margin, and
    in the end as without this preference.
    """
    careful = wary(planner.constraints)

    def margin(cells: int) -> Tier:
        return Tier(cells, careful, each=EACH_WARY)

    def both(cells: int) -> tuple[Tier, Tier]:
        return margin(cells), Tier(cells, planner.constraints)

    roomy, tight = tuple(tier for cells in levels[:-1] for tier in both(cells)), both(0)
    if planner.search == "5d":  # which knows no fallback
        return replace(planner, tiers=(*roomy, *tight))
    return replace(
        planner,
        tiers=tuple(margin(cells) for cells in levels[:-1] or (0,)),
        bold=(*roomy, *tight),
        resort=as_paper(levels, planner.constraints),
        passes=(roomy, tight) if roomy else (tight,),
    )
