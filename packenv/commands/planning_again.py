"""What an execution in closed loop needs: the planner that made a plan, set up again from its settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from packenv.closed_loop import WORLDS, ClosedLoopResult, run_closed_loop
from packenv.commands.loading import MAX_CLEARANCE, end_planning, load_fields, prepare_items
from packenv.config import GridConfig
from packenv.errors import InputError, PlanError
from packenv.io.assets import robot_urdf
from packenv.physics_planning import make_planner, make_spares
from packenv.planning.assembly import Constraints, PlannerChoice, Search, Shelf, StabilityRule
from packenv.planning.grasps import Rule as GraspRule
from packenv.planning.packing import Packing
from packenv.planning.replay import replay
from packenv.planning.scores import HEURISTICS
from packenv.planning.stability_constraint import ContactRule
from packenv.rehearsal import Rehearsal
from packenv.types import Item, Plan

if TYPE_CHECKING:
    from packenv.sim.disturbance import Disturbance
    from packenv.sim.physics_items import PhysicsItem
    from packenv.sim.session import ExecutionConfig, Session

_WORDS = {
    "heuristic": tuple(HEURISTICS),
    "constraints": get_args(Constraints),
    "stability": get_args(StabilityRule),
    "search": get_args(Search),
    "contacts": get_args(ContactRule),
    "grasp": get_args(GraspRule),
}


class Again:
    """The planner of a plan and all that it plans with."""

    def __init__(
        self,
        plan: Plan,
        path: Path,
        items: dict[str, Item],
        physics: Mapping[str, PhysicsItem],
        config: ExecutionConfig,
    ) -> None:
        """Set the planner up.

        Args:
            plan: the plan.
            path: its file, for messages.
            items: every placed and every left-over item by name, as the geometry that the plan was made with.
            physics: the same items, for physics.
            config: of the nominal world, in which placements are tried and the rest is rehearsed.

        Raises:
            PlanError: the plan's settings are not those of a planner, or its placements not in the container.
        """
        choice, grid = planner_choice(plan, path), _grid(plan, path)
        self._items = items
        self._prepared = prepare_items(items, grid)
        fields = load_fields(items) if choice.constraints != "overlap" else {}
        shelf = Shelf(items, self._prepared, fields)
        try:
            surfaces = replay(plan.placements, items, plan.container, grid.cell_size)
        except ValueError as problem:
            raise PlanError(f"{path}: {problem}, plan again") from None
        self._start = Packing.of_plan(plan, surfaces)
        self._planner = make_planner(choice, shelf, plan.container, grid, physics, config.world)
        self._spares = make_spares(choice, shelf, plan.container, grid)
        self._rehearsal = Rehearsal(plan.container, physics, robot_urdf(), WORLDS, config)

    def run(self, session: Session, disturbance: Disturbance | None) -> ClosedLoopResult:
        """Carry the plan out in closed loop."""
        try:
            return run_closed_loop(
                self._planner,
                self._start,
                session,
                self._items,
                self._prepared,
                self._rehearsal,
                disturbance,
                self._spares,
            )
        finally:
            end_planning(self._planner)


def planner_choice(plan: Plan, path: Path) -> PlannerChoice:
    """What the user chose when a plan was made.

    Raises:
        PlanError: a setting is missing or wrong.
    """
    values: dict[str, Any] = {}
    for name, words in _WORDS.items():
        values[name] = plan.settings.get(name)
        if values[name] not in words:
            raise _wrong(plan, path, name, f"one of {words}")
    for name in ("seed", "restarts"):
        values[name] = plan.settings.get(name)
        if not isinstance(values[name], int) or isinstance(values[name], bool) or values[name] < 0:
            raise _wrong(plan, path, name, "a whole number of at least 0")
    clearance = plan.settings.get("clearance", 0.0)
    if not isinstance(clearance, int | float) or not 0.0 <= clearance <= MAX_CLEARANCE:
        raise _wrong(plan, path, "clearance", f"metres between 0 and {MAX_CLEARANCE:g}")
    return PlannerChoice(**values, clearance=float(clearance))


def renumbered(plan: Plan, result: ClosedLoopResult) -> Plan:
    """The plan that was carried out in the end, every piece with a number of its own."""
    counts: dict[str, int] = {}

    def number(name: str) -> int:
        counts[name] = counts.get(name, 0) + 1
        return counts[name]

    placements = tuple(replace(p, instance=number(p.item)) for p in result.placements)
    leftovers = tuple(replace(left, instance=number(left.item)) for left in result.leftovers)
    return replace(plan, placements=placements, leftovers=leftovers)


def _grid(plan: Plan, path: Path) -> GridConfig:
    values: dict[str, Any] = {}
    for name, kind in (("cell_size", float), ("grid_step", float), ("n_poses", int), ("n_yaws", int)):
        values[name] = plan.settings.get(name)
        if not isinstance(values[name], kind) or isinstance(values[name], bool):
            raise _wrong(plan, path, name, "as pack wrote it")
    try:
        return GridConfig(**values)
    except InputError as problem:
        raise PlanError(f"{path}: settings: {problem}") from None


def _wrong(plan: Plan, path: Path, name: str, right: str) -> PlanError:
    return PlanError(f"{path}: settings.{name} is {plan.settings.get(name)!r:.80}, should be {right}")
