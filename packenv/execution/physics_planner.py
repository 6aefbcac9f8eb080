"""Physics as a constraint of the planner: what passes the static checks is dropped in a scratch world."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from packenv.geometry.transforms import angle_between
from packenv.planning.assembly import (
    EACH_WITH_MARGIN,
    MARGIN,
    PlanningItems,
    as_paper,
    assemble,
    clearances,
    with_margin,
)
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.options import PlanOptions
from packenv.planning.planner import Planner
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting, measured_map
from packenv.planning.tiers import Tier
from packenv.sim.drop_test import DropRule, DropTest, Lying, Release
from packenv.sim.engines import engine_config
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.world import WorldConfig
from packenv.types import Container, Item, Pose

SLIPPERY = 0.5
"""Most friction in a careful drop: what needs more to stay is not to be relied on."""

CAREFUL = (
    Release(offset=(0.003, 0.003), yaw=math.radians(1.5), mu=SLIPPERY),
    Release(offset=(-0.003, -0.003), yaw=math.radians(-1.5), pace=1.2, mu=SLIPPERY),
    Release(mu=SLIPPERY),
    Release(),
)
"""Drops with errors of the size that a robot makes, and exact ones; the last one is what to expect. One has a
time step of its own: an item that stands at one step of the engine alone does not stand."""
EXACT = (Release(),)
"""One drop, released exactly over its place."""

STRICT = DropRule()
"""The item comes to rest where it was planned."""
LENIENT = DropRule("lenient", shift=0.04, sink=0.04, turn=math.pi, nudge=0.01)
"""The item comes to rest near its place and leaves the others where they are: for those that come last."""
INSIDE = DropRule("inside", math.inf, math.inf, math.inf, math.inf, restless=True)
"""The item comes to rest anywhere inside the container."""

_STILL = 1e-4
"""Items that a drop moves by less than this keep their place in the heightmap, m."""

_DROPPED = 30
"""Most candidates of a tier that are dropped without a margin's word for them: drops are expensive."""
_EACH_DROPPED = 3
"""Most of them at one orientation."""

_RISKS = {STRICT.name: 0.0, LENIENT.name: 1.0, INSIDE.name: 2.0}
"""How bad a placement under a rule is."""
ROOM = 0.006
"""Clearance that is asked for where a plan without any fails, m: three standard deviations of a robot's errors."""
_TIGHT = 5.0
"""How much worse it is without the clearance that was asked for: a robot that is off by 2 mm collides."""


class Scratch:
    """The scratch world that several constraints share, built when the first candidate comes."""

    def __init__(self, container: Container, config: WorldConfig) -> None:
        """Keep what is needed."""
        self._container, self._config = container, config
        self._test: DropTest | None = None

    @property
    def test(self) -> DropTest:
        """The world."""
        if self._test is None:
            self._test = DropTest(self._container, self._config)
        return self._test

    def close(self) -> None:
        """Free the engine's memory."""
        if self._test is not None:
            self._test.close()
            self._test = None


class PhysicsConstraint(Constraint):
    """The item is dropped on the pile as physics left it, and must come to rest where it was planned.

    The last drop of each candidate makes the pile on which the next item is dropped; the others only have
    to go well.
    """

    def __init__(
        self,
        items: Mapping[str, PhysicsItem],
        scratch: Scratch,
        meshes: Mapping[str, Item],
        rule: DropRule = STRICT,
        releases: Sequence[Release] = CAREFUL,
    ) -> None:
        """Keep what is needed.

        Args:
            items: what physics needs of every item of the order, by name.
            meshes: the same items, as the geometry that is planned with.
            scratch: the world.
            rule: what counts as resting in place.
            releases: how each candidate is dropped; the last one is the one that is planned on.
        """
        self._items, self._meshes, self._scratch, self.rule = items, meshes, scratch, rule
        self._releases = tuple(releases)

    @property
    def name(self) -> str:
        """The word for this constraint in figures and messages."""
        return "physics"

    def start(self, resting: Sequence[Resting] = ()) -> tuple[Lying, ...]:
        """The pile to begin with, in a world of its own."""
        self._scratch.close()
        return tuple(Lying(self._items[p.item.name], Pose(p.rotation, p.position)) for p in resting)

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        """Drop the candidate."""
        item = self._items[trial.oriented.item]
        for how in self._releases:
            dropped = self._scratch.test.drop(
                state, item, trial.oriented.rotation, trial.position, how, self.rule
            )
            if dropped.reason:
                return Verdict(False, f"physics-{dropped.reason}")
        details = {
            "shift_m": round(dropped.shift_m, 6),
            "sink_m": round(dropped.sink_m, 6),
            "turned_deg": round(math.degrees(dropped.turned_rad), 3),
            "rule": self.rule.name,
        }
        # Where it was meant to be, where physics has it, and what it moved: what comes next must clear all.
        meant = surface.with_item(trial.oriented, trial.ix, trial.iy, trial.z)
        moved = [now for was, now in zip(state, dropped.pile, strict=False) if _travel(was, now) > _STILL]
        landed = [Resting(self._meshes[now.item.name], *now.pose) for now in (*moved, dropped.pile[-1])]
        known = measured_map(surface.container, surface.cell_size, landed, meant)
        return Verdict(True, state=dropped.pile, details=details, surface=known)

    def close(self) -> None:
        """Free the scratch world; the next candidate builds a new one."""
        self._scratch.close()


class NoDrop(Constraint):
    """In place of a :class:`PhysicsConstraint` on the same states: drops nothing, and knows of no drop."""

    @property
    def name(self) -> str:
        """One word: that of the constraint whose states it passes on."""
        return "physics"

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        """Every candidate passes."""
        return Verdict(True, state=state, details={"rule": "no-drop"})


def _travel(was: Lying, now: Lying) -> float:
    """A bound on how far any point of an item got, m."""
    way = now.item.com_at(now.pose) - was.item.com_at(was.pose)
    return float(np.linalg.norm(way)) + now.item.reach * angle_between(was.pose[0], now.pose[0])


def make_planner(
    options: PlanOptions,
    items: PlanningItems,
    container: Container,
    physics: Mapping[str, PhysicsItem],
    world: WorldConfig | None = None,
    *,
    margins: bool = False,
    give_up: bool = False,
) -> Planner:
    """The planner that the options ask for, ``stability`` ``physics`` included.

    Physics is asked in tiers. First what also stands by a margin on its own, for nearly all of that comes to
    rest in a drop; then the rest of what stands. An item that finds no place so waits until the others are
    placed, and may then come to rest a little off; if nothing helps, equilibrium alone decides, as without
    physics. Where items are left over even so, the order is planned once more with equilibrium alone to
    decide from the first item on, but where physics has what was placed before; and if that is no use either,
    as under ``paper``. All if restarts are allowed: so neither physics nor clearance costs an item.

    Args:
        options: how to plan.
        items: every item of the order.
        container: the box.
        physics: every item of the order, for physics; read for ``physics`` alone.
        world: of the scratch world.
        margins: as for :func:`packenv.planning.assembly.assemble`.
        give_up: likewise.
    """
    if options.stability != "physics":
        return assemble(options, items, container, margins=margins, give_up=give_up)
    static = replace(options, stability="cautious")
    planner = assemble(static, items, container, margins=margins, give_up=give_up)
    release = options.setup.release_height
    careful_drops, exact = (
        tuple(replace(how, height=release) for how in drops) for drops in (CAREFUL, EXACT)
    )
    scratch = Scratch(
        container, world or WorldConfig(mu=options.setup.friction, engine=engine_config(options.engine))
    )
    strict = PhysicsConstraint(physics, scratch, items.shapes, STRICT, careful_drops)
    lenient = PhysicsConstraint(physics, scratch, items.shapes, LENIENT, exact)
    inside = PhysicsConstraint(physics, scratch, items.shapes, INSIDE, exact)
    careful, levels = with_margin(planner.constraints, MARGIN), clearances(options.clearance, options.grid)

    def margin(cells: int) -> Tier:
        return Tier(cells, careful, each=EACH_WITH_MARGIN, risk=_risk(cells, strict))

    def tried(cells: int, last: PhysicsConstraint) -> Tier:
        return Tier(cells, {last.name: last}, _DROPPED, _EACH_DROPPED, _risk(cells, last))

    def _risk(cells: int, last: PhysicsConstraint) -> float:
        return _RISKS[last.rule.name] + (_TIGHT if cells == 0 and levels[0] > 0 else 0.0)

    # What comes last may lie a little off: rather that than pass its neighbours by a hair.
    roomy = [
        tier for cells in levels[:-1] for tier in (margin(cells), tried(cells, strict), tried(cells, lenient))
    ]
    roomy += [tried(cells, inside) for cells in levels[:-1]]
    last_resort = Tier(0, {inside.name: inside}, risk=_risk(0, inside))
    tight = [margin(0), tried(0, strict), tried(0, lenient), last_resort]
    first = [tier for cells in levels[:-1] or (0,) for tier in (margin(cells), tried(cells, strict))]
    no_drop = NoDrop()
    strategy = replace(
        planner.strategy,
        first=first,
        fallback=(roomy, tight) if roomy else (tight,),
        # An order that does not fit with room to spare may fit without.
        restart_tiers=(*first, margin(0), tried(0, strict)) if roomy else None,
        # Rather a risk than an order that is not packed: as the paper plans, first with physics' own pile.
        last_resorts=((last_resort,), *as_paper(levels, {no_drop.name: no_drop})),
        clearance=levels[0],
        roomy=None,
    )
    return replace(planner, constraints=(*planner.constraints, strict), strategy=strategy)


def make_spares(
    options: PlanOptions, items: PlanningItems, container: Container, *, margins: bool = False
) -> tuple[Planner, ...]:
    """Planners to ask where the plan of the chosen one fails in rehearsal (:mod:`packenv.execution.rehearsal`).

    Where physics is asked of every placement, the cautious rule knows places that no drop confirms, and asks a tenth
    of the time; what its plans are worth, the rehearsal tells. Where clearance is asked for, a second one does
    without it: of an order that fits only so, the first one packs what the paper's rule packs. A cautious plan
    without clearance fails mostly where there is no room to spare, so there the spare one asks for room.

    Args:
        options: how to plan.
        items: every item of the order.
        container: the box.
        margins: as for :func:`packenv.planning.assembly.assemble`.
    """
    if options.stability == "cautious" and options.clearance == 0.0 and options.constraints == "robot":
        roomy = replace(options, clearance=ROOM, restarts=0)
        return (assemble(roomy, items, container, margins=margins),)
    if options.stability != "physics":
        return ()
    quicker = replace(options, stability="cautious", restarts=min(options.restarts, 1))
    clear = (0.0,) if options.clearance == 0.0 else (options.clearance, 0.0)
    return tuple(assemble(replace(quicker, clearance=c), items, container, margins=margins) for c in clear)
