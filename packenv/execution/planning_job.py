"""Items and options together: the planners that they make for a container, and what these pack."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from packenv.items.shelf import ItemShelf
from packenv.items.sizes import suspicious_sizes
from packenv.planning.assembly import assemble, packer
from packenv.planning.deadline import NEVER, Deadline
from packenv.planning.options import PlanOptions
from packenv.planning.packing import Packing
from packenv.planning.planner import Planner, by_box_volume
from packenv.planning.portfolio import Packer, fullness, goal, robustness
from packenv.planning.search.contact_height import ExactPile
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.measured import Resting, measured_map
from packenv.types import Container, Pose
from packenv.watcher import SILENT, Watcher

if TYPE_CHECKING:
    from packenv.execution.rehearsal import Rehearsed, Start
    from packenv.sim.world import WorldConfig


SEARCHED = 0.5
"""Share of a budget that goes into the search where plans are rehearsed, too."""


def require_engine(options: PlanOptions) -> None:
    """Say before long work begins where physics is asked and there is no engine.

    Raises:
        PhysicsError: so it is.
    """
    if options.asks_physics:
        from packenv.sim.engines import engine_config

        engine_config(options.engine)


@dataclass(frozen=True, eq=False)
class PlanningJob:
    """Items and options, and the planners that they make for a container.

    Attributes:
        shelf: the items.
        options: how to plan.
        margins: tell the margin of every placed item.
        world: physics of drops; the usual one where None.
        watcher: is told of progress.
        workers: processes that search where there is a budget; plans do not depend on it.
        began: when the budget began to run, s of the monotonic clock.
    """

    shelf: ItemShelf
    options: PlanOptions
    margins: bool = True
    world: WorldConfig | None = None
    watcher: Watcher = SILENT
    workers: int = 1
    began: float = field(default_factory=time.monotonic)

    @property
    def until(self) -> Deadline:
        """When a budget of seconds is spent; never without."""
        budget = self.options.budget
        return NEVER if budget is None else Deadline(self.began + budget)

    def load(self, names: Collection[str]) -> None:
        """Load all that planning will ask for; say what was repaired.

        Raises:
            PhysicsError: physics is asked, and there is no engine.
            InputError: a mesh cannot be used.
        """
        options = self.options
        require_engine(options)
        self.shelf.load(
            names,
            fields=options.constraints != "overlap",
            physics=options.asks_physics,
            progress=self.watcher.progress,
        )
        items = {name: self.shelf.items[name] for name in names}
        sizes = suspicious_sizes({name: float(item.extents.max()) for name, item in items.items()})
        for name, item in items.items():
            repaired = [f"repaired: {'; '.join(item.repairs)}"] if item.repairs else []
            for text in (*repaired, *item.notes, *filter(None, [sizes.get(name)])):
                self.watcher.remark(f"{item.file}: {text}")

    def sequence(self, names: Sequence[str]) -> list[str]:
        """The names in the sequence in which they are packed."""
        given = self.options.sequence == "given"
        return list(names) if given else by_box_volume(names, self.shelf.prepared)

    def planner(self, box: Container, *, give_up: bool = False) -> Planner:
        """The planner for a container; one, whatever ``auto`` is made of."""
        if self.options.stability != "physics":
            margins = self.margins or self.options.goal == "robust"
            return assemble(self.options, self.shelf, box, margins=margins, give_up=give_up)
        from packenv.execution.physics_planner import make_planner

        return make_planner(
            self.options,
            self.shelf,
            box,
            self.shelf.physics,
            self.world,
            margins=self.margins,
            give_up=give_up,
        )

    def packer(self, box: Container, *, give_up: bool = False) -> Packer:
        """What packs orders into a container."""
        options, planner = self.options, self.planner(box, give_up=give_up)
        if options.stability == "physics":  # one plan; its restarts end with the budget
            options, planner = replace(options, budget=None), replace(planner, until=self.until)
        elif options.rehearse and options.budget is not None:
            options = replace(options, budget=SEARCHED * options.budget)
        return packer(
            options,
            planner,
            self.shelf.shapes,
            robustness if self.options.goal == "robust" else goal,
            self.watcher.remark,
            self.workers,
        )

    def spares(self, box: Container) -> tuple[Planner, ...]:
        """Planners to ask where the plan of the chosen one fails in rehearsal."""
        from packenv.execution.physics_planner import make_spares

        return make_spares(self.options, self.shelf, box, margins=self.margins)

    def pack(self, box: Container, sequence: Sequence[str], *, give_up: bool = False) -> Packing:
        """Pack items, in sequence, into an empty container."""
        with self.packer(box, give_up=give_up) as packing:
            return packing.pack(sequence, self.shelf.prepared, box)

    def smallest_for_all(self, boxes: Sequence[Container], sequence: Sequence[str]) -> Packing | None:
        """The packing in the first container that takes all.

        Each is given up as soon as it is known not to do, and there are no restarts. What does without a margin in a
        small box goes before a margin in a larger one.
        """
        hurried = self.hurried()
        for box in boxes:
            careful = hurried.planner(box, give_up=True)
            for planner in (careful, *self._without_margin(careful)):
                with packer(hurried.options, planner, self.shelf.shapes) as packing:
                    found = packing.pack(sequence, self.shelf.prepared, box)
                if found.complete:
                    return found
            self.watcher.remark(f"box {box.full_label} does not take all: {found.leftovers[0].detail}")
        return None

    def fill(self, box: Container, sequence: Sequence[str]) -> Packing:
        """Pack into an empty container what it takes, without restarts: the more volume, the better."""
        hurried = self.hurried()
        with packer(hurried.options, hurried.planner(box), self.shelf.shapes, fullness) as packing:
            return packing.pack(sequence, self.shelf.prepared, box)

    def hurried(self) -> PlanningJob:
        """The same without restarts, and without a search or layouts."""
        return replace(
            self, options=replace(self.options, restarts=0, method="search", budget=None, plans=None)
        )

    def _without_margin(self, planner: Planner) -> Iterator[Planner]:
        """A cautious planner without its preference."""
        strategy = planner.strategy
        if self.options.stability == "cautious":
            for tiers in strategy.last_resorts[:1]:
                yield replace(planner, strategy=replace(strategy, first=tiers, fallback=None, roomy=None))

    def rehearse(
        self, box: Container, sequence: Sequence[str], first: Packing | None, lies: Start | None = None
    ) -> Rehearsed:
        """The best of the plans that were carried out in simulated worlds."""
        from packenv.execution.rehearsal import Rehearsal, pack_rehearsed
        from packenv.sim.drop_test import Lying
        from packenv.sim.session import ExecutionConfig

        physics = self.shelf.physics
        resting = () if lies is None else lies[1]
        lying = tuple(Lying(physics[r.item.name], Pose(r.rotation, r.position)) for r in resting)
        setup = self.options.setup
        rehearsal = Rehearsal(
            setup.with_container(box),
            physics,
            self.options.rehearse,
            ExecutionConfig.of(setup, self.options.engine),
            lying,
        )
        prepared = self.shelf.prepared
        start = lies if resting else None
        with self.planner(box) as planner:
            return pack_rehearsed(
                planner,
                sequence,
                prepared,
                rehearsal,
                first=first,
                start=start,
                spares=self.spares(box),
                until=self.until,
                report=self.watcher.remark,
            )

    def pack_onto(
        self,
        box: Container,
        sequence: Sequence[str],
        resting: Sequence[Resting],
        surface: ContainerMap | None = None,
    ) -> tuple[Packing, Mapping[str, float]]:
        """Pack items onto what lies in a container.

        Args:
            box: the container.
            sequence: item names.
            resting: what lies there.
            surface: its heightmap; made of the meshes where None.

        Returns:
            the packing, and further metrics.
        """
        exact = ExactPile(self.shelf.shapes) if self.options.heights == "mesh" else None
        if surface is None:
            surface = measured_map(box, self.shelf.grid.cell_size, resting, exact=exact)
        if self.options.rehearse:
            found = self.rehearse(box, sequence, None, (surface, resting))
            return found.chosen, found.metrics
        with self.packer(box) as packing:
            return packing.pack(sequence, self.shelf.prepared, box, packing.pile(surface, resting)), {}
