"""Closed loop: look at the pile after every placement, and plan anew what no longer fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from packenv.config import CLEARANCE
from packenv.execution.rehearsal import Rehearsal, pack_rehearsed
from packenv.geometry.heightmaps import orient_item
from packenv.geometry.prepare import PreparedItem
from packenv.planning.deadline import NEVER, Deadline
from packenv.planning.packing import Packing
from packenv.planning.planner import Planner
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting, measured_map
from packenv.planning.search.replay import replay
from packenv.sim.disturbance import Disturbance
from packenv.sim.drop_test import Lying
from packenv.sim.plan_tasks import task_of
from packenv.sim.session import Execution, Session
from packenv.types import Item, Leftover, Placement, Pose
from packenv.watcher import SILENT, Watcher

_Waiting: TypeAlias = list[tuple[Placement, ContainerMap]]
"""Placements to come, each with the heightmap on which it was planned."""

DEEPER = 0.003
"""How much deeper or higher than planned an item may come to lie before the rest is rehearsed, m."""
ASIDE = 2
"""Cells by which an item may be off sideways: what comes nearer than that calls for a rehearsal."""
WORLDS = 3
"""Simulated worlds in which to rehearse the rest of an order: somebody waits."""


@dataclass(frozen=True, eq=False)
class ClosedLoopResult:
    """What became of an order in closed loop.

    Attributes:
        execution: in physics; its success needs every planned item placed.
        placements: as they were planned last, in packing sequence; after a collision, more than were placed.
        leftovers: items for which the last plan found no place.
        plans: how many plans were looked at, the first one included.
    """

    execution: Execution
    placements: tuple[Placement, ...]
    leftovers: tuple[Leftover, ...]
    plans: int

    @property
    def success(self) -> bool:
        """Every item of the order is inside the container and nothing collided."""
        return self.execution.success and not self.leftovers


def run_closed_loop(
    planner: Planner,
    packing: Packing,
    session: Session,
    meshes: Mapping[str, Item],
    prepared: Mapping[str, PreparedItem],
    rehearsal: Rehearsal,
    disturbance: Disturbance | None = None,
    spares: Sequence[Planner] = (),
    lying: Sequence[Lying] = (),
    until: Deadline = NEVER,
    watcher: Watcher = SILENT,
) -> ClosedLoopResult:
    """Carry out a plan; after every placement measure all poses and see whether the plan still fits.

    The measured poses become the heightmap. Where the next placement does not fit it any more, what was
    planned for the rest of the order is rehearsed from those poses on, and where that fails in any world, the
    rest is planned anew on the heightmap, and the plan that does best in rehearsal is gone on with.

    Args:
        planner: plans the rest.
        packing: the plan to begin with.
        session: a world that is empty but for ``lying``.
        meshes: every item of the order, of the geometry that is planned with, by name.
        prepared: the same, prepared.
        rehearsal: of the whole order; the worlds that the robot knows of.
        disturbance: makes the tasks differ from what was planned; the session's world is the caller's.
        spares: more planners for the rest.
        lying: the plan's first items, where they were carried out before, as the session has them.
        until: after it nothing is rehearsed and planned anew: the plan goes on as it is.
        watcher: is told of progress, and of every plan.
    """
    physics = rehearsal.physics
    container, cell = session.container, planner.grid.cell_size
    done = list(packing.placements[: len(lying)])
    leftovers = packing.leftovers
    plans = 1

    def resting() -> list[Resting]:
        return [Resting(meshes[p.item], *pose) for p, pose in zip(done, session.measured(), strict=True)]

    def planned_anew(waiting: _Waiting) -> _Waiting:
        """What is still to be placed, after a look at the pile: as it was, or as it was planned again."""
        nonlocal leftovers, plans
        if until.passed:
            return waiting
        pile = resting()
        surface = measured_map(container, cell, pile)
        if waiting:
            following, believed = waiting[0]
            if _still_good(following, meshes[following.item], believed, surface, planner.release):
                return waiting
        names = [p.item for p, _ in waiting] + [left.item for left in leftovers]
        watcher.remark(
            f"after {len(done)} items: the rest is rehearsed from where they lie, {len(names)} items"
        )
        there = tuple(Lying(physics[r.item.name], Pose(r.rotation, r.position)) for r in pile)
        again = pack_rehearsed(
            planner,
            names,
            prepared,
            replace(rehearsal, lying=there),
            running=Packing(container, tuple(p for p, _ in waiting), leftovers, (), 0.0),
            start=(surface, pile),
            spares=spares,
            until=until,
            report=watcher.remark,
        )
        plans += again.plans - 1
        leftovers = again.packing.leftovers
        return _expected(again.packing, surface, meshes)

    if lying:
        rest = replace(packing, placements=packing.placements[len(lying) :], surfaces=())
        waiting = planned_anew(_expected(rest, measured_map(container, cell, resting()), meshes))
    else:
        waiting = _expected(packing, ContainerMap.empty(container, cell), meshes)
    steps = iter(watcher.progress(range(len(packing.placements) - len(done)), "executing"))
    while waiting and not session.failed:
        next(steps, None)
        placement, _ = waiting.pop(0)
        task = task_of(placement, physics[placement.item], session.cell)
        session.place(task if disturbance is None else disturbance.task(task, len(done) + 1))
        done.append(placement)
        if session.failed or not (waiting or leftovers):
            break
        waiting = planned_anew(waiting)
    planned = (placement for placement, _ in waiting)
    return ClosedLoopResult(session.result(), (*done, *planned), leftovers, plans)


def _expected(packing: Packing, before: ContainerMap, meshes: Mapping[str, Item]) -> _Waiting:
    """Placements, each with the heightmap on which it was planned."""
    placements = packing.placements
    surfaces = packing.surfaces or replay(placements, meshes, packing.container, before.cell_size, before)
    return list(zip(placements, (before, *surfaces[:-1]), strict=True)) if placements else []


def _still_good(
    placement: Placement, mesh: Item, believed: ContainerMap, measured: ContainerMap, release: float
) -> bool:
    """Whether a planned placement fits what the container really holds.

    It must lie as deep as planned, and nothing may have come nearer: at the release, and off by ``ASIDE``
    cells, it clears all that it was to clear.
    """
    oriented = orient_item(mesh, placement.rotation, cell_size=measured.cell_size)
    x, y, z = (placement.position - oriented.offset).tolist()
    beyond = np.add([x, y], oriented.extents[:2]) - measured.container.size[:2]
    if min(x, y) < -CLEARANCE or beyond.max() > CLEARANCE:
        return False
    oriented, ix, iy = measured.locate(oriented, max(x, 0.0), max(y, 0.0))

    def lowest(surface: ContainerMap) -> float:
        return surface.bound(oriented, ix, iy)

    if abs(lowest(measured) - z) > DEEPER:
        return False
    around = lowest(measured.spread(ASIDE))
    return bool(around <= max(z + release, lowest(believed.spread(ASIDE)) + DEEPER))
