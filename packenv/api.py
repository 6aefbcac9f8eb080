"""The one way from an order to a plan, and on: load, plan, verify, execute, show.

Command line, experiments, benchmarks and a user's scripts all go this way::

    import packenv as rp

    catalogue = rp.load_catalogue("builtin")
    order = rp.Order.of("mug", "bowl", "banana")
    plan = rp.plan(order, rp.Container(0.32, 0.32, 0.30), catalogue, heuristic="hm")
    assert rp.verify(plan, catalogue).ok
    execution = rp.execute(plan, catalogue, feel=True)
    rp.show(plan, "plan.html")
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from packenv.audit import AuditReport, audit_plan, misstated_boxes
from packenv.errors import InputError, OrderError, PlanError
from packenv.extensions import is_extension
from packenv.io.catalogues import MEMORY, Catalogue, closest_match, open_catalogue
from packenv.io.containers import parse_container, read_boxes
from packenv.io.memory import items_of_meshes
from packenv.io.orders import read_order
from packenv.io.plan_maker import make_plan
from packenv.io.plans import EnvelopeRecord, read_plan, write_plan
from packenv.io.shelves import ItemShelf
from packenv.planning.assembly import assemble
from packenv.planning.container_map import ContainerMap
from packenv.planning.measured import Resting, measured_map
from packenv.planning.options import OWN, PlanOptions
from packenv.planning.packer import Planner, by_box_volume
from packenv.planning.packing import Packing
from packenv.planning.replay import replay
from packenv.recheck import Recheck, recheck
from packenv.types import Container, Item, Order, OrderLine, Plan, Pose
from packenv.watcher import SILENT, Watcher

if TYPE_CHECKING:
    import trimesh

    from packenv.rehearsal import Rehearsed
    from packenv.sim.world import WorldConfig

Items: TypeAlias = "Catalogue | ItemShelf | str | Path"
"""Where items are from: a catalogue, a shelf that has loaded some of it, a folder, or ``builtin``."""

MEMORY_OF_A_SHELF = 2**29
"""Bytes of heightmaps, and of surfaces, that a shelf of this module keeps: one process, one user."""


def load_catalogue(
    source: str | Path | Mapping[str, Any] | trimesh.Scene = "builtin", *, unit: str | None = None
) -> Catalogue:
    """Open a catalogue of items.

    Args:
        source: ``builtin``; a folder of meshes, bare or with ``objects.csv``; meshes by name, such as
            ``trimesh.Trimesh`` or anything else with ``vertices`` and ``faces``, or :class:`Item`; or a
            ``trimesh.Scene``, each geometry of which is an item.
        unit: unit of the meshes: ``m``, ``cm``, ``mm`` or ``in``; None takes what a file, a table or a mesh
            states, else metres.

    Raises:
        InputError: the folder or its table is wrong, or a mesh in memory cannot be used. Mesh files are read
            when their items are first asked for.
    """
    if isinstance(source, str | Path):
        return open_catalogue(source, unit=unit)
    return Catalogue.of_items(items_of_meshes(source, unit))


def load_order(path: str | Path, catalogue: Items = "builtin") -> Order:
    """Read an order of items of a catalogue from a CSV or JSON file.

    Raises:
        OrderError: the file is wrong, or asks for an item that the catalogue does not have.
    """
    return read_order(Path(path), _catalogue(catalogue).names)


def load_plan(path: str | Path, catalogue: Items | None = None, *, unit: str | None = None) -> Plan:
    """Read a plan and the meshes of its placed items, and check that they are those it was made of.

    Args:
        path: the plan file.
        catalogue: where to find the meshes; None takes the folder that the plan names.
        unit: unit of the meshes; None takes the plan's.

    Raises:
        InputError: the plan or a mesh is wrong, or a mesh is not the one that the plan was made of.
    """
    plan = replace(read_plan(Path(path)), source=Path(path))
    shelf = shelf_of(plan, catalogue, unit=unit)
    names = [p.item for p in plan.placements]
    if plan.catalogue == MEMORY:  # no later call finds the others
        names += [left.item for left in plan.leftovers if left.item in shelf]
    return replace(plan, items={name: shelf.items[name] for name in names})


def save_plan(plan: Plan, path: str | Path) -> None:
    """Write a plan as JSON (docs/plan-format.md).

    Raises:
        InputError: the file cannot be written.
    """
    write_plan(Path(path), plan)


def plan(
    order: Order,
    container: Container | str | Sequence[Container],
    catalogue: Items = "builtin",
    options: PlanOptions | None = None,
    *,
    unit: str | None = None,
    margins: bool = True,
    watcher: Watcher = SILENT,
    **words: Any,
) -> Plan:
    """Plan where and in which sequence every item of an order goes.

    Args:
        order: the items.
        container: the box; or a size in metres such as ``0.32x0.32x0.30``, or the id of a box; or several
            boxes, or ``auto`` for the built-in ones: the smallest that takes all items is taken, else the
            largest.
        catalogue: where the items are from.
        options: how to plan; the default ones where None.
        unit: the unit that the user gave for the catalogue's meshes, for the plan's file.
        margins: tell the margin of every placed item, a few milliseconds each.
        watcher: is told of progress.
        words: options by name, in place of those of ``options``: ``heuristic="mta"``.

    Returns:
        The plan; what does not fit is among its ``leftovers``, with the reason.

    Raises:
        InputError: an option, the order, the container or a mesh is wrong.
    """
    chosen = (options or PlanOptions()).changed(words)
    shelf = shelf_for(catalogue, chosen)
    boxes = _boxes(container)
    _check_names(order, shelf)
    job = PlanningJob(shelf, chosen, margins=margins, watcher=watcher)
    job.load(order.names)
    sequence = job.sequence(order.names)
    packing, options_used = job.pack_smallest(boxes, sequence)
    if chosen.rehearse and packing.placements:
        rehearsed = replace(job, options=options_used).rehearse(packing.container, sequence, packing)
        return _rehearsed_plan(rehearsed, order.lines, shelf, options_used, unit)
    return make_plan(packing, order.lines, shelf, options_used, unit=unit)


def rehearse(
    plan: Plan,
    catalogue: Items | None = None,
    options: PlanOptions | None = None,
    *,
    watcher: Watcher = SILENT,
) -> Plan:
    """Carry a plan out in simulated worlds, and plan otherwise where it fails.

    Args:
        plan: the plan; of geometry ``parts``, on which physics and planning agree.
        catalogue: where its items are from; None takes what the plan names.
        options: how to plan otherwise, and in how many worlds to rehearse; None takes those of the plan.
        watcher: is told of progress.

    Raises:
        InputError: the plan, the options or a mesh is wrong.
    """
    chosen = options_again(plan, options)
    if not chosen.rehearse or options_of(plan).shape != "parts":
        raise InputError("rehearse: give options with rehearse of at least 1, and a plan of geometry parts")
    shelf = shelf_of(plan, catalogue, options=chosen)
    names = [line.item for line in plan.order for _ in range(line.qty)]
    job = PlanningJob(shelf, chosen, watcher=watcher)
    job.load(names)
    rehearsed = job.rehearse(plan.container, job.sequence(names), Packing.of_plan(plan))
    return _rehearsed_plan(rehearsed, plan.order, shelf, chosen, plan.unit)


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
        measured: poses of its first items, as many as were placed.
        catalogue: where its items are from; None takes what the plan names.
        options: how to plan, rehearsals included; None takes those of the plan.
        watcher: is told of progress.

    Returns:
        A plan whose first placements are at the measured poses, without a robot's path, and whose others are
        new. ``execute(rest, placed=measured)`` carries on.

    Raises:
        InputError: more poses than placements, or the plan, the options or a mesh is wrong.
    """
    if len(measured) > len(plan.placements):
        raise InputError(f"{len(measured)} measured poses, but the plan places {len(plan.placements)} items")
    chosen = options_again(plan, options)
    shelf = shelf_of(plan, catalogue, options=chosen)
    done = plan.placements[: len(measured)]
    names = [p.item for p in plan.placements[len(measured) :]] + [left.item for left in plan.leftovers]
    job = PlanningJob(shelf, chosen, watcher=watcher)
    job.load([p.item for p in done] + names)
    resting = [Resting(shelf.shapes[p.item], *pose) for p, pose in zip(done, measured, strict=True)]
    packing, metrics, made_by = job.pack_onto(plan.container, job.sequence(names), resting)
    moved = tuple(_moved(placement, rest) for placement, rest in zip(done, resting, strict=True))
    volume = sum(shelf.items[p.item].volume for p in (*moved, *packing.placements))
    whole = replace(
        packing,
        placements=(*moved, *packing.placements),
        utilization=volume / plan.container.volume,
    )
    made = make_plan(whole, plan.order, shelf, chosen, unit=plan.unit, made_by=made_by, metrics=metrics)
    return renumbered(made)


@dataclass(frozen=True, eq=False)
class Verification:
    """What became of a plan's claims: the exact meshes audited, and every step's constraints asked again.

    Attributes:
        audit: from the exact meshes: overlaps, protrusions, insertion from above, lost items.
        envelopes: the same from meshes and convex parts, for plans on these.
        misstated: steps (from 1) whose stated bounding box is not that of the item at its pose.
        recheck: stability and the robot's way.
        unchecked: own constraints that the plan names; only their authors can check them.
        placed: number of placed items.
        left_over: number of items that are not in the plan.
    """

    audit: AuditReport
    envelopes: AuditReport | None
    misstated: tuple[int, ...]
    recheck: Recheck
    unchecked: tuple[str, ...]
    placed: int
    left_over: int

    @property
    def ok(self) -> bool:
        """True where nothing was found."""
        sound = self.audit.ok and (self.envelopes is None or self.envelopes.ok)
        return sound and not self.misstated and self.recheck.ok

    def to_json(self) -> dict[str, object]:
        """The report as JSON-able lists and numbers; lengths in m, steps from 1."""
        document: dict[str, object] = {
            **self.audit.to_json(),
            "misstated_boxes": self.misstated,
            **asdict(self.recheck),
            "unchecked_constraints": self.unchecked,
            "placed": self.placed,
            "left_over": self.left_over,
            "ok": self.ok,
        }
        if self.envelopes is not None:
            document["envelopes"] = self.envelopes.to_json()
        return document


def verify(plan: Plan, catalogue: Items | None = None, *, unit: str | None = None) -> Verification:
    """Audit a plan from the exact meshes, and check stability and reach of every step again.

    Args:
        plan: the plan.
        catalogue: where its items are from; None takes what the plan names.
        unit: unit of the meshes; None takes the plan's.

    Raises:
        InputError: a mesh is not the one that the plan was made of, or the plan's settings are wrong.
    """
    options = options_of(plan)
    shelf = shelf_of(plan, catalogue, unit=unit)
    names = dict.fromkeys(p.item for p in plan.placements)
    items = {name: shelf.items[name] for name in names}
    shapes = {name: shelf.shapes[name] for name in names}
    return Verification(
        audit_plan(plan, items),
        audit_plan(plan, shapes) if options.shape == "parts" else None,
        misstated_boxes(plan, shapes),
        recheck(plan, shapes, shelf.fields, options),
        tuple(str(name) for name in options.own_constraints),
        len(plan.placements),
        len(plan.leftovers),
    )


def options_of(plan: Plan) -> PlanOptions:
    """How a plan was made.

    Raises:
        PlanError: its settings are not options.
    """
    for name in ("constraints", "stability", "contacts", "grasp", "cell_size"):
        if name not in plan.settings:
            raise PlanError(f"{plan.label}: settings has no {name!r}, plan again")
    try:
        return PlanOptions.from_mapping(plan.settings, f"{plan.label}: settings")
    except PlanError:
        raise
    except InputError as problem:
        raise PlanError(str(problem)) from None


def options_again(
    plan: Plan, options: PlanOptions | None = None, given: Mapping[str, Any] | None = None
) -> PlanOptions:
    """How to plan again: as the caller says, else as the plan was made, unless that names own code.

    Args:
        plan: the plan.
        options: how to plan; None takes those of the plan.
        given: some of them by name, in place of the plan's.

    Raises:
        PlanError: the plan's settings are not options, or they name own code in place of which none is given:
            a file may not say which code is run.
    """
    given = given or {}
    if options is not None:
        return options.changed(given)
    chosen = options_of(plan)
    heuristics = () if "heuristic" in given else (chosen.heuristic,)
    constraints = () if "own_constraints" in given else chosen.own_constraints
    for name in map(str, (*heuristics, *constraints)):
        if is_extension(name) or name == OWN:
            raise PlanError(
                f"{plan.label}: was planned with own code ({name}), which a file may not call; to plan again "
                "with it, give it again: --heuristic or --constraint, options= in a script"
            )
    return chosen.changed(given)


def shelf_for(catalogue: Items, options: PlanOptions) -> ItemShelf:
    """A shelf of a catalogue's items for planning with some options.

    Raises:
        InputError: the catalogue cannot be opened.
    """
    if isinstance(catalogue, ItemShelf):
        return catalogue.like(options.grid, options.shape)
    opened = _catalogue(catalogue)
    memory = MEMORY_OF_A_SHELF
    return ItemShelf(opened, options.grid, options.shape, field_memory=memory, map_memory=memory)


def shelf_of(
    plan: Plan,
    catalogue: Items | None = None,
    *,
    unit: str | None = None,
    options: PlanOptions | None = None,
    leftovers: bool = False,
) -> ItemShelf:
    """A shelf of a plan's items, which are those that the plan was made of.

    Args:
        plan: the plan.
        catalogue: where its items are from; None takes what the plan names.
        unit: unit of the meshes; None takes the plan's.
        options: geometry and grid; None takes those of the plan.
        leftovers: check the items that are not in the plan, too.

    Raises:
        InputError: an item is missing, or is not the one that the plan was made of.
    """
    if catalogue is None and plan.catalogue == MEMORY and plan.items:
        catalogue = Catalogue.of_items(plan.items)
    elif catalogue is None and plan.catalogue == MEMORY:
        raise PlanError(
            f"{plan.label}: its meshes were in a script's memory, in no folder; give them again: --catalogue DIR, "
            "catalogue= in a script"
        )
    elif catalogue is None or isinstance(catalogue, str | Path):
        catalogue = open_catalogue(catalogue or plan.catalogue, unit=unit or plan.unit)
    chosen = options or options_of(plan)
    shelf = shelf_for(catalogue, chosen)
    names = [p.item for p in plan.placements] + [left.item for left in plan.leftovers if leftovers]
    for name in dict.fromkeys(names):
        if name not in shelf:
            raise PlanError(
                f"{plan.label}: item {name!r} is not in {shelf.catalogue.label}, name its folder by --catalogue"
            )
        _check_mesh(plan, name, shelf)
    return shelf


def surfaces_of(plan: Plan, shelf: ItemShelf) -> tuple[ContainerMap, ...]:
    """The container heightmap after each step of a plan.

    Raises:
        ValueError: an item is not inside the container.
    """
    return replay(plan.placements, shelf.shapes, plan.container, shelf.grid.cell_size)


def renumbered(plan: Plan) -> Plan:
    """The plan with every piece of a name numbered in its sequence, placed ones first."""
    counts: dict[str, int] = {}

    def number(name: str) -> int:
        counts[name] = counts.get(name, 0) + 1
        return counts[name]

    placements = tuple(replace(p, instance=number(p.item)) for p in plan.placements)
    leftovers = tuple(replace(left, instance=number(left.item)) for left in plan.leftovers)
    return replace(plan, placements=placements, leftovers=leftovers)


@dataclass(frozen=True, eq=False)
class PlanningJob:
    """Items and options, and the planners that they make for a container.

    Attributes:
        shelf: the items.
        options: how to plan.
        margins: tell the margin of every placed item.
        world: physics of drops; the usual one where None.
        watcher: is told of progress.
    """

    shelf: ItemShelf
    options: PlanOptions
    margins: bool = True
    world: WorldConfig | None = None
    watcher: Watcher = SILENT

    def load(self, names: Collection[str]) -> None:
        """Load all that planning will ask for; say what was repaired."""
        options = self.options
        self.shelf.load(
            names,
            fields=options.constraints != "overlap",
            physics=options.asks_physics,
            progress=self.watcher.progress,
        )
        for name in dict.fromkeys(names):
            item = self.shelf.items[name]
            if item.repairs:
                self.watcher.remark(f"{item.file}: repaired: {'; '.join(item.repairs)}")

    def sequence(self, names: Sequence[str]) -> list[str]:
        """The names in the sequence in which they are packed."""
        given = self.options.sequence == "given"
        return list(names) if given else by_box_volume(names, self.shelf.prepared)

    def planner(self, box: Container, *, give_up: bool = False) -> Planner:
        """The planner for a container."""
        if self.options.stability != "physics":
            return assemble(self.options, self.shelf, box, margins=self.margins, give_up=give_up)
        from packenv.physics_planning import make_planner

        return make_planner(
            self.options,
            self.shelf,
            box,
            self.shelf.physics,
            self.world,
            margins=self.margins,
            give_up=give_up,
        )

    def spares(self, box: Container) -> tuple[Planner, ...]:
        """Planners to ask where the plan of the chosen one fails in rehearsal."""
        from packenv.physics_planning import make_spares

        return make_spares(self.options, self.shelf, box)

    def pack(self, box: Container, sequence: Sequence[str], *, give_up: bool = False) -> Packing:
        """Pack items, in sequence, into an empty container."""
        with self.planner(box, give_up=give_up) as planner:
            return planner.pack(sequence, self.shelf.prepared, box)

    def pack_smallest(
        self, boxes: Sequence[Container], sequence: Sequence[str]
    ) -> tuple[Packing, PlanOptions]:
        """The packing in the smallest container that takes all, else in the largest; and how it was planned.

        All but the last container are given up as soon as they are known not to do. What does without a margin
        in a small box goes before a margin in a larger one.
        """
        brisk = replace(self.options, restarts=0)
        rules = [brisk, replace(brisk, stability="paper")] if brisk.stability == "cautious" else [brisk]
        for box, rule in itertools.product(boxes[:-1], rules):
            packing = replace(self, options=rule).pack(box, sequence, give_up=True)
            if packing.complete:
                return packing, replace(self.options, stability=rule.stability)
        return self.pack(boxes[-1], sequence), self.options

    def rehearse(
        self, box: Container, sequence: Sequence[str], first: Packing | None, resting: Sequence[Resting] = ()
    ) -> Rehearsed:
        """What is left of plans that were carried out in simulated worlds."""
        from packenv.io.assets import robot_urdf
        from packenv.rehearsal import Rehearsal, pack_rehearsed
        from packenv.sim.drop_test import Lying

        physics = self.shelf.physics
        lying = tuple(Lying(physics[r.item.name], Pose(r.rotation, r.position)) for r in resting)
        rehearsal = Rehearsal(box, physics, robot_urdf(), self.options.rehearse, lying=lying)
        start = (measured_map(box, self.shelf.grid.cell_size, resting), resting) if resting else None
        prepared = self.shelf.prepared
        with self.planner(box) as planner:
            return pack_rehearsed(
                planner, sequence, prepared, rehearsal, first=first, start=start, spares=self.spares(box)
            )

    def pack_onto(
        self, box: Container, sequence: Sequence[str], resting: Sequence[Resting]
    ) -> tuple[Packing, Mapping[str, float], str]:
        """Pack items onto what lies in a container; the packing, further metrics, and how it was made."""
        if self.options.rehearse:
            found = self.rehearse(box, sequence, None, resting)
            return found.packing, found.metrics, found.how
        surface = measured_map(box, self.shelf.grid.cell_size, resting)
        with self.planner(box) as planner:
            pile = planner.pile(surface, resting)
            return planner.pack(sequence, self.shelf.prepared, box, pile), {}, "planner"


def _rehearsed_plan(
    rehearsed: Rehearsed,
    lines: tuple[OrderLine, ...],
    shelf: ItemShelf,
    options: PlanOptions,
    unit: str | None,
) -> Plan:
    metrics, how = rehearsed.metrics, rehearsed.how
    return make_plan(rehearsed.packing, lines, shelf, options, unit=unit, made_by=how, metrics=metrics)


def _moved(placement: Any, rest: Resting) -> Any:
    """A placement at the pose that was measured."""
    placed = Pose(rest.rotation, rest.position).apply(rest.item.vertices)
    low = placed.min(axis=0)
    return replace(
        placement,
        rotation=rest.rotation,
        position=rest.position,
        corner=low,
        extents=placed.max(axis=0) - low,
        path=None,
    )


def _catalogue(catalogue: Items) -> Catalogue:
    if isinstance(catalogue, ItemShelf):
        return catalogue.catalogue
    return catalogue if isinstance(catalogue, Catalogue) else open_catalogue(catalogue)


def _boxes(container: Container | str | Sequence[Container]) -> Sequence[Container]:
    """The containers to try, the smallest first."""
    if isinstance(container, Container):
        return [container]
    if isinstance(container, str) and container.lower() != "auto":
        return [parse_container(container, read_boxes())]
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
    for name in dict.fromkeys(order.names):
        if name not in shelf:
            hint = closest_match(name, shelf.catalogue.names)
            raise OrderError(
                f"the order asks for {name!r}, which {shelf.catalogue.label} does not have{hint}"
            )


def _check_mesh(plan: Plan, name: str, shelf: ItemShelf) -> None:
    item: Item = shelf.items[name]
    record = plan.meshes[name]
    if item.sha256 != record.sha256:
        raise PlanError(
            f"{plan.label}: {item.file} is not the mesh that the plan was made of (sha256 "
            f"{item.sha256[:12]}, not {record.sha256[:12]}), plan again or name its folder by --catalogue"
        )
    if shelf.geometry != "parts" or options_of(plan).shape != "parts":
        return
    if not isinstance(record, EnvelopeRecord):
        raise PlanError(
            f"{plan.label}: meshes.{name} has no 'envelope_sha256', which plans of geometry 'parts' have"
        )
    shape = shelf.shapes[name]
    if shape.sha256 != record.envelope_sha256:
        raise PlanError(
            f"{plan.label}: the convex parts of {shape.file} are not those that the plan was made of "
            f"(sha256 of the envelope {shape.sha256[:12]}, not {record.envelope_sha256[:12]}), plan again"
        )
