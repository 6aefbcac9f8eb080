"""One order on its way into one container: sequence, candidates, placements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, islice
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from packenv.env.arrangement import Arrangement, Landing, PlannedArrangement
from packenv.env.candidate_set import CandidateSet, choose
from packenv.env.config import PackConfig
from packenv.env.observation import HEURISTIC_COLUMNS, ItemView, View
from packenv.geometry.prepare import PreparedItem
from packenv.items.shelf import ItemShelf
from packenv.limits import ItemLimits
from packenv.planning.admission import Admission, Held
from packenv.planning.assembly import constraints_of, heuristic_of
from packenv.planning.constraints import Constraint
from packenv.planning.inquiry import Memory, barrier, place
from packenv.planning.manipulation.constraint import ManipulationConstraint
from packenv.planning.options import PlanOptions
from packenv.planning.planner import by_box_volume
from packenv.planning.search.contact_height import ExactPile
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.fitting import fitting_orientations
from packenv.planning.search.heuristics import HEURISTICS
from packenv.planning.search.orientations import OrientationMemory, perturbations
from packenv.planning.sequence import PackingSequence, Piece, pieces_of
from packenv.types import Container, FloatArray, Item, Leftover, OrientedItem, Placement, Pose

MAPS_MEMORY = 48 * 2**20
"""Bytes of perturbed heightmaps that an environment keeps."""

_ROUTES = ("first-pass", "later", "5d")


class Rules:
    """The constraints of a mask level, and what they remember of items from one episode to the next."""

    def __init__(
        self,
        config: PackConfig,
        shelf: ItemShelf,
        limits: Mapping[str, ItemLimits] = MappingProxyType({}),
    ) -> None:
        """Keep what is needed.

        Args:
            config: settings.
            shelf: the items.
            limits: those of the shelf's items that an order sets, by name.
        """
        self.config, self.shelf, self.limits = config, shelf, limits
        self.options = config.plan_options()
        self.admission = Admission(shelf.shapes)
        own = (heuristic_of(PlanOptions(heuristic=given)) for given in config.heuristics)
        self.heuristics = (*(HEURISTICS[name] for name in HEURISTIC_COLUMNS), *own)
        self._manipulation: dict[tuple[float, float, float], ManipulationConstraint] = {}
        self._maps = OrientationMemory(MAPS_MEMORY)
        self._empty: dict[tuple[float, float, float], Memory] = {}

    def memory(self, container: Container) -> Memory:
        """What was asked about candidates in the empty container, for the next episode."""
        return self._empty.setdefault(container.size, Memory())

    def constraints(self, container: Container) -> tuple[Constraint, ...]:
        """Those of an order in a container."""
        known = self._manipulation.get(container.size)
        found = constraints_of(self.options, self.shelf, container, manipulation=known)
        for constraint in found:
            if isinstance(constraint, ManipulationConstraint):
                self._manipulation[container.size] = constraint
        return found

    def groups(self, name: str, container: Container) -> Iterator[Sequence[OrientedItem]]:
        """Orientations of an item that is back: the stable poses, then perturbed ones (Alg. 4).

        Under legality alone, without limits and own constraints, the stable poses are all, as in the planner:
        heights only grow, so what fitted nowhere fits nowhere later.
        """
        item, first = self.shelf.prepared[name], self.orientations(name, container)
        if self.config.mask == "legal" and not (self.config.own_constraints or self.shelf.limited):
            return iter((first,))
        shape, grid = self.shelf.shapes[name], self.config.grid
        groups = perturbations(shape, item.poses, grid, container.size, self._maps)
        return groups if first is item.orientations else chain((first,), islice(groups, 1, None))

    def orientations(self, name: str, container: Container) -> tuple[OrientedItem, ...]:
        """The stable poses and yaws of an item; turned or leaning where it fits the container at none of these."""
        prepared = self.shelf.prepared[name]
        if self.config.heights == "map":
            return prepared.orientations
        return fitting_orientations(prepared, self.shelf.shapes[name], self.config.grid, container.size)


class Episode:
    """The state of an episode. It knows nothing of spaces, rewards and agents."""

    def __init__(self, config: PackConfig, rules: Rules, container: Container, names: Sequence[str]) -> None:
        """Begin, and offer the first item that has a valid candidate.

        Args:
            config: settings.
            rules: of the same settings.
            container: the box.
            names: the order's pieces, in its own sequence.
        """
        self.config, self.rules, self.shelf, self.container = config, rules, rules.shelf, container
        self.names = tuple(names)
        online = config.arrivals == "online"
        if not online and config.sequence == "volume":
            names = by_box_volume(names, self.shelf.prepared)
        self.sequence = PackingSequence(
            pieces_of(names), buffer=config.buffer if online else None, fallback=config.fallback
        )
        self.constraints = rules.constraints(container)
        self.barrier = barrier(self.constraints, (self.shelf.prepared[name] for name in dict.fromkeys(names)))
        if self.barrier is not None:
            self.sequence.abandon()
        self.arrangement = self._arrangement()
        self.placements: list[Placement] = []
        self._held = Held()
        self._refused: dict[Piece, tuple[str, str]] = {}
        self.outside: frozenset[int] = frozenset()
        self.collided = False
        self.offered: CandidateSet | None = None
        self._groups: Iterator[Sequence[OrientedItem]] = iter(())
        self._groups_of: Piece | None = None
        self._advance()

    def _arrangement(self) -> Arrangement:
        config = self.config
        if not config.physics:
            exact = ExactPile(self.shelf.shapes) if config.heights == "mesh" else None
            empty = ContainerMap.empty(self.container, config.grid.cell_size, exact)
            return PlannedArrangement(empty, self.constraints)
        from packenv.env.physical_arrangement import PhysicalArrangement

        cell = self.rules.options.setup.with_container(self.container)
        return PhysicalArrangement(
            cell,
            config.grid.cell_size,
            self.constraints,
            self.shelf,
            robot=config.mask == "robot",
            engine=config.engine,
        )

    @property
    def ended(self) -> bool:
        """True where nothing is left to do."""
        return self.offered is None

    @property
    def current(self) -> PreparedItem | None:
        """The item to be placed now."""
        piece = self.sequence.current
        return None if piece is None else self.shelf.prepared[piece.item]

    @property
    def perturbed(self) -> bool:
        """Whether the offered candidates are of perturbed orientations."""
        return self.config.arrivals == "offline" and self.sequence.stage == 2

    @property
    def inside(self) -> list[Placement]:
        """What is packed: every placed item that does not stick out of the container."""
        return [p for k, p in enumerate(self.placements) if k not in self.outside]

    @property
    def utilization(self) -> float:
        """Volume of what is packed, as a share of the container's."""
        volume = sum(self.shelf.items[p.item].volume for p in self.inside)
        return volume / self.container.volume

    def place(self, row: int) -> Landing:
        """Place the current item at the candidate of a row of the offered set, which must be valid."""
        offered, piece = self.offered, self.sequence.current
        assert offered is not None
        assert piece is not None
        index = int(offered.chosen[row])
        trial = offered.candidates.trial(index)
        placement, pile = place(
            piece,
            trial,
            offered.inquiry,
            offered.inquiry.verdicts(trial),
            score=float(offered.scores[row, 0]),
            candidates=len(offered.candidates),
            route=_ROUTES[self.sequence.stage],
            checked=offered.inquiry.asked,
        )
        landing = self.arrangement.place(placement, pile)
        self.placements.append(placement)
        self._held = self.rules.admission.with_item(self._held, piece.item)
        self.sequence.placed()
        self.outside, self.collided = landing.outside, landing.collided
        if landing.collided or landing.lost:
            self.sequence.abandon()
        self._advance()
        return landing

    def defer(self) -> None:
        """Let the current item wait, or try its next orientations."""
        self.sequence.defer()
        self._after_deferring()
        self._advance()

    def close(self) -> None:
        """Free what the container holds."""
        self.arrangement.close()
        for constraint in self.constraints:
            constraint.close()

    def leftovers(self) -> tuple[Leftover, ...]:
        """The pieces that were left over."""
        if self.barrier is not None:
            reason = "unreachable-container"
            return tuple(Leftover(p.item, p.instance, reason, self.barrier) for p in self.sequence.left_over)
        found = []
        for p in self.sequence.left_over:
            untaken = "given-up", f"no candidate of {p.item} was taken"
            found.append(Leftover(p.item, p.instance, *self._refused.get(p, untaken)))
        return tuple(found)

    def view(self) -> View:
        """What there is to see."""
        total = max(len(self.names), 1)
        return View(
            container=self.container,
            heights=self.arrangement.pile.surface.heights,
            current=self.current,
            offered=self.offered,
            items=[self._item_view(piece) for piece in self.sequence.seen[: self.config.max_items]],
            perturbed=self.perturbed,
            utilization=self.utilization,
            packed_share=len(self.inside) / total,
            left_share=self.sequence.waiting / total,
            stage=self.sequence.stage,
        )

    def scene(self) -> tuple[list[tuple[Item, Pose]], FloatArray | None]:
        """Placed items at their poses, and the robot's joints after the last placement."""
        poses = self.arrangement.poses
        items = [(self.shelf.items[p.item], pose) for p, pose in zip(self.placements, poses, strict=True)]
        path = self.placements[-1].path if self.placements else None
        return items, None if path is None else path.joints[0]

    def mask(self) -> NDArray[np.int8]:
        """(K + 1,) int8, 1 where an action is valid."""
        mask = np.zeros(self.config.candidates + 1, dtype=np.int8)
        mask[-1] = 1
        if self.offered is not None:
            mask[: len(self.offered.valid)] = self.offered.valid
        return mask

    def _item_view(self, piece: Piece) -> ItemView:
        prepared, item = self.shelf.prepared[piece.item], self.shelf.items[piece.item]
        return ItemView(
            prepared.orientations[0].extents,
            item.volume,
            item.mass,
            self.sequence.was_deferred(piece),
            item.limits,
            self._refusal(piece) is not None,
        )

    def _refusal(self, piece: Piece) -> tuple[str, str] | None:
        return self.rules.admission.refusal(piece.item, self._held, self.container)

    def _memory(self) -> Memory | None:
        """What other orders asked of the empty container; own constraints may answer each order otherwise."""
        if self.placements or self.config.own_constraints:
            return None
        return self.rules.memory(self.container)

    def _after_deferring(self) -> None:
        if self.sequence.left_over and self.config.on_infeasible == "terminate":
            self.sequence.abandon()

    def _advance(self) -> None:
        """Go on to the next item, or group of orientations, that offers a valid candidate."""
        self.offered = None
        while (piece := self.sequence.current) is not None:
            refusal = self._refusal(piece)
            group = None if refusal is not None else self._orientations(piece)
            if refusal is not None:
                self._refused[piece] = refusal
            if group is None:
                self.sequence.give_up()
            else:
                offered = choose(
                    group,
                    self.constraints,
                    self.arrangement.pile,
                    heuristics=self.rules.heuristics,
                    step=self.config.grid.step_cells,
                    size=self.config.candidates,
                    max_checked=self.config.max_checked,
                    memory=self._memory(),
                )
                if offered is not None and offered.valid.any():
                    self.offered = offered
                    return
                self.sequence.defer()
            self._after_deferring()

    def _orientations(self, piece: Piece) -> Sequence[OrientedItem] | None:
        """The next ones to try of a piece; None where there are no more."""
        if self.config.arrivals == "online" or self.sequence.stage == 0:
            return self.rules.orientations(piece.item, self.container)
        if piece != self._groups_of:
            self._groups_of = piece
            self._groups = iter(self.rules.groups(piece.item, self.container))
        return next(self._groups, None)
