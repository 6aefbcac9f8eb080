"""The one way from an order to a plan, and on: load, plan, verify, execute, show, export.

Command line, experiments, benchmarks and a user's scripts all go this way::

    import packenv as rp

    catalogue = rp.load_catalogue("builtin")
    order = rp.Order.of("mug", "bowl", "banana")
    plan = rp.plan(order, rp.Container(0.32, 0.32, 0.30), catalogue)
    assert rp.verify(plan, catalogue).ok
    execution = rp.execute(plan, catalogue, feel=True)
    rp.show(plan, "plan.html")
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from packenv.config import EngineName
from packenv.errors import InputError, OrderError
from packenv.execution.planning_job import PlanningJob
from packenv.execution.several_boxes import pack_boxes, shared_out
from packenv.execution.trajectories import trajectories
from packenv.io.containers import parse_container, read_boxes
from packenv.io.files import check_outputs
from packenv.io.lying import PartlyFilled, read_partly_filled as load_partly_filled
from packenv.io.orders import read_order
from packenv.io.plans import write_plan
from packenv.io.trajectories import Trajectories
from packenv.items.catalogue import Catalogue
from packenv.items.plan_items import (
    Items,
    catalogue_of,
    open_plan,
    options_again,
    options_of,
    renumbered,
    require_plan,
    shelf_for,
    shelf_of,
)
from packenv.items.plan_maker import make_plan
from packenv.items.shelf import ItemShelf
from packenv.limits import NO_LIMITS
from packenv.planning.options import PRESETS, PlanOptions
from packenv.planning.packing import Packing
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting
from packenv.planning.search.replay import replay_plan
from packenv.types import Container, Order, OrderLine, Placement, Plan, Pose, limits_in
from packenv.verification.report import Verification, verify
from packenv.view.show import check_suffix, show
from packenv.watcher import SILENT, Watcher

if TYPE_CHECKING:
    import trimesh

    from packenv.execution.execute import ExecutedPlan, execute

__all__ = [
    "ExecutedPlan",
    "PartlyFilled",
    "Trajectories",
    "Verification",
    "execute",
    "load_catalogue",
    "load_order",
    "load_partly_filled",
    "load_plan",
    "plan",
    "plan_boxes",
    "plan_rehearsed",
    "plan_rest",
    "rehearse",
    "save_plan",
    "show",
    "trajectories",
    "verify",
]


def __getattr__(name: str) -> Any:
    """Load the physics engine only for those who execute: not every Python has one."""
    if name not in ("execute", "ExecutedPlan"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import packenv.execution.execute

    return getattr(packenv.execution.execute, name)


def load_catalogue(
    source: str | Path | Mapping[str, Any] | trimesh.Scene = "builtin",
    *,
    unit: str | None = None,
    density: float | None = None,
) -> Catalogue:
    """Open a catalogue of items.

    Args:
        source: ``builtin``; a folder of meshes, bare or with ``objects.csv``; meshes by name, such as
            ``trimesh.Trimesh`` or anything else with ``vertices`` and ``faces``, or :class:`Item`; or a
            ``trimesh.Scene``, each geometry of which is an item.
        unit: unit of the meshes: ``m``, ``cm``, ``mm`` or ``in``; None takes what a file, a table or a mesh
            states, else metres.
        density: of the items of a folder that have no mass, kg/m³; None estimates their masses.

    Raises:
        InputError: the folder or its table is wrong, or a mesh in memory cannot be used. Mesh files are read
            when their items are first asked for.
    """
    return catalogue_of(source, unit, density)


def load_order(path: str | Path, catalogue: Items = "builtin") -> Order:
    """Read an order of items of a catalogue from a CSV or JSON file.

    Raises:
        OrderError: the file is wrong, or asks for an item that the catalogue does not have.
    """
    return read_order(Path(path), catalogue_of(catalogue).names)


def load_plan(path: str | Path, catalogue: Items | None = None, *, unit: str | None = None) -> Plan:
    """Read a plan and the meshes of its placed items, and check that they are those it was made of.

    Args:
        path: the plan file.
        catalogue: where to find the meshes; None takes the folder that the plan names.
        unit: unit of the meshes; None takes the plan's.

    Raises:
        InputError: the plan or a mesh is wrong, or a mesh is not the one that the plan was made of.
    """
    return open_plan(path, catalogue, unit=unit)[0]


def save_plan(plan: Plan, path: str | Path) -> None:
    """Write a plan as JSON (docs/plan-format.md).

    Args:
        plan: the plan.
        path: the file, whose name ends in ``.json`` or has no ending.

    Raises:
        InputError: another ending, the file cannot be written, or it is the order's.
    """
    if not isinstance(plan, Plan):
        raise InputError(f"save_plan: {plan!r:.60} is no plan, give the plan, then the path")
    check_suffix(Path(path), "save_plan", (".json", ""))
    check_outputs({"save_plan": Path(path)}, filter(None, [plan.order_source]))
    write_plan(Path(path), plan)


def plan(
    order: Order,
    container: Container | str | Sequence[Container] | None = None,
    catalogue: Items | None = None,
    options: PlanOptions | Mapping[str, Any] | str | None = None,
    *,
    start: Plan | PartlyFilled | None = None,
    unit: str | None = None,
    margins: bool = True,
    workers: int = 1,
    watcher: Watcher = SILENT,
    **words: Any,
) -> Plan:
    """Plan where and in which sequence every item of an order goes.

    Args:
        order: the items.
        container: the box; or a size, as ``0.32x0.32x0.30`` in metres (in ``unit`` where it can be no metres) or
            ``320x320x300mm``; or the id of a box; or several boxes, or ``auto`` for the built-in ones: the smallest
            that takes all items is taken, else the largest. None takes the box of ``start``.
        catalogue: where the items are from; None takes those of the plan to start from, else the built-in ones.
        options: how to plan, as options, by name, or the word of a preset; the default ones where None.
        start: a box that is not empty: a plan, all of whose items lie where it says, or what
            :func:`load_partly_filled` reads. They are the plan's first items, ``lying`` says how many.
        unit: of the meshes, where ``catalogue`` is a folder or meshes in memory, and of such a container's size.
        margins: tell the margin of every placed item, and what the pile of every step withstands: some ten
            milliseconds a step.
        workers: processes that search where there is a ``budget`` or ``plans``; the same ``plans`` give the same plan
            on any number. With more than one a script keeps its work under ``if __name__ == "__main__":``.
        watcher: is told of progress.
        words: options by name, in place of those of ``options``: ``heuristic="mta"``.

    Returns:
        The plan; what does not fit is among its ``leftovers``, with the reason.

    Raises:
        InputError: an option, the order, the container or a mesh is wrong.
    """
    if start is not None:
        box = PartlyFilled.of_plan(start) if isinstance(start, Plan) else start
        _check_box(container, box, unit)
        return _plan_onto_start(
            order, box, catalogue, _options(options).changed(words), unit, watcher, margins, workers
        )
    if container is None:
        raise InputError(
            "container is None, give packenv.Container(0.32, 0.32, 0.30), or a plan to start from"
        )
    (made,) = plan_boxes(
        order,
        container,
        "builtin" if catalogue is None else catalogue,
        options,
        boxes_max=1,
        unit=unit,
        margins=margins,
        workers=workers,
        watcher=watcher,
        **words,
    )
    return made


def plan_boxes(
    order: Order,
    container: Container | str | Sequence[Container],
    catalogue: Items = "builtin",
    options: PlanOptions | Mapping[str, Any] | str | None = None,
    *,
    boxes_max: int,
    unit: str | None = None,
    margins: bool = True,
    workers: int = 1,
    watcher: Watcher = SILENT,
    **words: Any,
) -> tuple[Plan, ...]:
    """Plan an order into several boxes: what does not fit into one goes on into the next.

    Of what the search finds it takes fewest boxes, then least volume of all boxes together.

    Args:
        order: as for :func:`plan`.
        container: likewise; each box may be used as often as needed.
        catalogue: likewise.
        options: likewise.
        boxes_max: how many boxes may be used, at least 1.
        unit: likewise.
        margins: likewise.
        workers: likewise.
        watcher: likewise.
        words: likewise.

    Returns:
        A plan for each box, whose ``order`` is what is in it; the last one's has what no box takes, too, and names
        it among its ``leftovers``. With one box it is what :func:`plan` returns.

    Raises:
        InputError: an option, the number, the order, the container or a mesh is wrong.
    """
    if isinstance(boxes_max, bool) or not isinstance(boxes_max, int) or boxes_max < 1:
        raise InputError(f"boxes_max is {boxes_max!r:.60}, give a whole number of at least 1")
    _check_workers(workers)
    chosen = _options(options).changed(words)
    boxes = _boxes(container, unit)
    shelf = shelf_for(catalogue, chosen, unit)
    _check_names(order, shelf)
    if order.limits:
        shelf = shelf.with_limits(order.limits)
    job = PlanningJob(shelf, chosen, margins=margins, watcher=watcher, workers=workers)
    job.load(order.names)
    packings = pack_boxes(job, boxes, job.sequence(order.names), boxes_max)
    if len(packings) == 1:
        plans: Iterable[Plan] = [_boxed(job, packings[0], order.lines, unit)]
    else:
        shares = zip(packings, shared_out(order.lines, packings), strict=True)
        plans = (renumbered(_boxed(job, packing, lines, unit)) for packing, lines in shares)
    return tuple(replace(made, order_source=order.source) for made in plans)


REHEARSALS = 3
"""In how many simulated worlds a plan for the robot is carried out by itself: the nominal one, and two disturbed."""
ENGINE: EngineName = "mujoco"
"""Where, unless somebody names another engine: a world takes half of the time there."""


def rehearsing(options: PlanOptions) -> PlanOptions:
    """The same options with the rehearsals that ``robotpack pack`` makes by itself."""
    engine = ENGINE if options.engine == "auto" else options.engine
    return replace(options, rehearse=REHEARSALS, engine=engine)


def plan_rehearsed(
    order: Order,
    container: Container | str | Sequence[Container],
    catalogue: Items = "builtin",
    options: PlanOptions | Mapping[str, Any] | str | None = None,
    *,
    unit: str | None = None,
    margins: bool = True,
    workers: int = 1,
    watcher: Watcher = SILENT,
) -> Plan:
    """What ``robotpack pack`` gives for the robot: a plan on convex parts that was carried out in simulation.

    Where it fails there, another one in place of it; where not all items have a place on their convex parts, the plan
    on their meshes, which is not rehearsed.

    Args:
        order: as for :func:`plan`, as are all others.
        container: likewise.
        catalogue: likewise.
        options: likewise; rehearsals and geometry are chosen here.
        unit: likewise.
        margins: likewise.
        workers: likewise.
        watcher: likewise.

    Raises:
        InputError: an option, the order, the container or a mesh is wrong.
    """
    chosen = _options(options)
    rest: dict[str, Any] = {"unit": unit, "margins": margins, "workers": workers, "watcher": watcher}
    made = plan(order, container, catalogue, replace(chosen, geometry="parts"), **rest)
    if made.complete:
        return rehearse(made, catalogue, rehearsing(chosen), margins=margins, watcher=watcher)
    watcher.remark(
        f"not rehearsed: {len(made.placements)} of {len(made.placements) + len(made.leftovers)} items have a place "
        "on their convex parts; planned on their meshes"
    )
    return plan(order, container, catalogue, chosen, **rest)


def rehearse(
    plan: Plan,
    catalogue: Items | None = None,
    options: PlanOptions | None = None,
    *,
    margins: bool = True,
    watcher: Watcher = SILENT,
) -> Plan:
    """Carry a plan out in simulated worlds, and plan otherwise where it fails.

    Args:
        plan: the plan; of geometry ``parts``, on which physics and planning agree.
        catalogue: where its items are from; None takes what the plan names.
        options: how to plan otherwise, and in how many worlds to rehearse; None takes those of the plan.
        margins: as for :func:`plan`.
        watcher: is told of progress.

    Raises:
        InputError: the plan, the options or a mesh is wrong.
    """
    chosen = options_again(plan, options)
    if not chosen.rehearse or options_of(plan).shape != "parts":
        raise InputError("rehearse: give options with rehearse of at least 1, and a plan of geometry parts")
    shelf = shelf_of(plan, catalogue, options=chosen)
    names = [line.item for line in plan.order for _ in range(line.qty)]
    job = PlanningJob(shelf, chosen, margins=margins, watcher=watcher)
    job.load(names)
    made = _rehearsed(job, Packing.of_plan(plan), plan.order, plan.unit)
    return replace(made, order_source=plan.order_source)


def plan_rest(
    plan: Plan,
    measured: Sequence[Pose],
    catalogue: Items | None = None,
    options: PlanOptions | None = None,
    *,
    watcher: Watcher = SILENT,
) -> Plan:
    """Plan the rest of a plan that was carried out in part, from where the placed items really lie.

    Args:
        plan: the plan.
        measured: poses of its first items, as many as were placed, such as ``ExecutedPlan.measured``.
        catalogue: where its items are from; None takes what the plan names.
        options: how to plan, rehearsals included; None takes those of the plan.
        watcher: is told of progress.

    Returns:
        A plan whose first placements are at the measured poses, without a robot's path, and whose others are
        new: its ``lying`` says how many lie there, and :func:`execute` carries on from there.

    Raises:
        InputError: more poses than placements, or the plan, the options or a mesh is wrong.
    """
    require_plan(plan)
    if len(measured) > len(plan.placements):
        raise InputError(f"{len(measured)} measured poses, but the plan places {len(plan.placements)} items")
    chosen = options_again(plan, options)
    shelf = shelf_of(plan, catalogue, options=chosen)
    done = [p.item for p in plan.placements[: len(measured)]]
    lies = PartlyFilled.of_plan(plan, list(zip(done, measured, strict=True)))
    names = [p.item for p in plan.placements[len(done) :]] + [left.item for left in plan.leftovers]
    job = PlanningJob(shelf, chosen, watcher=watcher)
    return _plan_onto(job, lies, names, plan.order, plan.unit)


def _plan_onto_start(
    order: Order,
    lies: PartlyFilled,
    catalogue: Items | None,
    options: PlanOptions,
    unit: str | None,
    watcher: Watcher,
    margins: bool,
    workers: int,
) -> Plan:
    """Plan an order into a box that is not empty."""
    _check_workers(workers)
    done = [name for name, _ in lies.items]
    if lies.plan is None:
        shelf = shelf_for("builtin" if catalogue is None else catalogue, options, unit)
    else:
        shelf = shelf_of(lies.plan, catalogue, unit=unit, options=options)
        unit = unit or lies.plan.unit
    shelf.check_known(done)
    _check_names(order, shelf)
    known = {} if lies.plan is None else limits_in(lies.plan.order)
    lines = (*(OrderLine(name, 1, known.get(name, NO_LIMITS)) for name in done), *order.lines)
    if limits := limits_in(lines):
        shelf = shelf.with_limits(limits)
    job = PlanningJob(shelf, options, margins=margins, watcher=watcher, workers=workers)
    made = _plan_onto(job, lies, order.names, lines, unit)
    return replace(made, order_source=order.source)


def _plan_onto(
    job: PlanningJob, lies: PartlyFilled, names: Sequence[str], lines: tuple[OrderLine, ...], unit: str | None
) -> Plan:
    """Plan items onto what lies in a box.

    Args:
        job: how.
        lies: the box.
        names: of the items to be planned.
        lines: the order's, of what lies there and of the others.
        unit: that the user gave for the meshes.
    """
    shelf, count, source = job.shelf, len(lies.items), lies.plan
    job.load([name for name, _ in lies.items] + list(names))
    poses = [_pose(k, pose) for k, (_, pose) in enumerate(lies.items, start=1)]
    resting = [Resting(shelf.shapes[name], *pose) for (name, _), pose in zip(lies.items, poses, strict=True)]
    placed = [None] * count if source is None else list(source.placements[:count])
    found, metrics = job.pack_onto(
        lies.container, job.sequence(names), resting, _as_planned(lies, shelf, job.options)
    )
    there = tuple(_lying(*pair) for pair in zip(placed, resting, strict=True))
    placements = (*there, *found.placements)
    volume = sum(shelf.items[p.item].volume for p in placements)
    whole = replace(found, placements=placements, utilization=volume / lies.container.volume)
    made = make_plan(
        whole, lines, shelf, job.options, unit=unit, metrics=metrics, lying=count, margins=job.margins
    )
    return renumbered(made)


def _as_planned(lies: PartlyFilled, shelf: ItemShelf, options: PlanOptions) -> ContainerMap | None:
    """The map that the planner had of a box in which all lies as it was planned; None where it does not."""
    if lies.plan is None or not lies.items:
        return None
    planned = lies.plan.placements[: len(lies.items)]
    for placement, (_, pose) in zip(planned, lies.items, strict=True):
        if not all(map(np.array_equal, placement.pose, pose)):
            return None
    part = replace(lies.plan, placements=planned, lying=min(lies.plan.lying, len(planned)))
    try:
        return replay_plan(part, shelf.shapes, shelf.grid.cell_size, exact=options.heights == "mesh")[-1]
    except ValueError:
        return None


def _check_workers(workers: int) -> None:
    """Refuse a number of processes that is none.

    Raises:
        InputError: so it is.
    """
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise InputError(f"workers is {workers!r:.60}, give a whole number of at least 1")


def _check_box(
    container: Container | str | Sequence[Container] | None, lies: PartlyFilled, unit: str | None
) -> None:
    """Refuse a box that is not the one in which something lies.

    Raises:
        InputError: so it is.
    """
    if container is None:
        return
    (given, *others) = _boxes(container, unit)
    if others or given.size != lies.container.size:
        raise InputError(
            f"the items lie in {lies.container.full_label}, which is not the container that is given: leave that out"
        )


def _boxed(job: PlanningJob, packing: Packing, lines: tuple[OrderLine, ...], unit: str | None) -> Plan:
    """The plan of one box, rehearsed where that is asked."""
    if job.options.rehearse and packing.placements:
        return _rehearsed(job, packing, lines, unit)
    return make_plan(packing, lines, job.shelf, job.options, unit=unit, margins=job.margins)


def _rehearsed(job: PlanningJob, packing: Packing, lines: tuple[OrderLine, ...], unit: str | None) -> Plan:
    names = job.sequence([line.item for line in lines for _ in range(line.qty)])
    found = job.rehearse(packing.container, names, packing)
    return make_plan(
        found.chosen, lines, job.shelf, job.options, unit=unit, metrics=found.metrics, margins=job.margins
    )


def _pose(step: int, given: Pose) -> Pose:
    """A pose as it was measured.

    Raises:
        InputError: it is none.
    """
    try:
        rotation, position = (np.asarray(part, dtype=np.float64) for part in given)
    except (TypeError, ValueError):
        raise InputError(
            f"measured pose {step} is {given!r:.60}, give packenv.Pose(rotation, position)"
        ) from None
    sound = rotation.shape == (3, 3) and position.shape == (3,) and np.isfinite(position).all()
    if not sound or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
        raise InputError(f"measured pose {step}: give a (3, 3) rotation and a (3,) position in m, all finite")
    return Pose(rotation, position)


def _lying(placement: Placement | None, rest: Resting) -> Placement:
    """What lies in the box, of which a placement tells more where a plan placed it."""
    placed = Pose(rest.rotation, rest.position).apply(rest.item.vertices)
    low = placed.min(axis=0)
    size = placed.max(axis=0) - low
    if placement is None:
        return Placement(rest.item.name, 1, rest.rotation, rest.position, low, size, 0, 0.0, 0.0, 0)
    return replace(
        placement, rotation=rest.rotation, position=rest.position, corner=low, extents=size, path=None
    )


def _options(given: PlanOptions | Mapping[str, Any] | str | None) -> PlanOptions:
    """Options that the user gave in one of several ways."""
    if isinstance(given, PlanOptions):
        return given
    if given is None or isinstance(given, Mapping):
        return PlanOptions.from_mapping(given or {})
    if given not in PRESETS:
        raise InputError(f"options is {given!r:.60}, give PlanOptions, or one of {', '.join(PRESETS)}")
    return PRESETS[given]()


def _boxes(container: Container | str | Sequence[Container], unit: str | None) -> Sequence[Container]:
    """The containers to try, the smallest first."""
    if isinstance(container, Container):
        return [container]
    if isinstance(container, str) and container.lower() != "auto":
        return [parse_container(container, read_boxes(), unit)]
    boxes = read_boxes() if isinstance(container, str) else container
    if not isinstance(boxes, Sequence) or not all(isinstance(box, Container) for box in boxes):
        raise InputError(
            f"container is {container!r:.60}, give packenv.Container(0.32, 0.32, 0.30), '0.32x0.32x0.30', the id "
            "of a box, 'auto' or a list of containers"
        )
    if not boxes:
        raise InputError("no container is given, give at least one")
    return sorted(boxes, key=lambda box: box.volume)


def _check_names(order: Order, shelf: ItemShelf) -> None:
    if not isinstance(order, Order):
        raise OrderError(f"the order is {order!r:.60}, give packenv.Order.of('mug', 'bowl')")
    if not order.names:
        raise OrderError("the order is empty, give at least one item")
    shelf.check_known(order.names)
