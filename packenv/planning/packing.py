"""What the planner works on and what it returns: a pile, a packing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from packenv.planning.admission import Held
from packenv.planning.search.container_map import ContainerMap
from packenv.types import Container, Leftover, Placement, Plan


@dataclass(frozen=True, eq=False)
class Pile:
    """A container with what is in it.

    Attributes:
        surface: its heightmap.
        states: what each constraint keeps of the pile, in their order.
        held: what is in it, as far as it matters for what else the box takes.
    """

    surface: ContainerMap
    states: tuple[Any, ...] = ()
    held: Held = field(default_factory=Held)


PERHAPS = ("no-legal-candidate", "no-packable-candidate")
"""Reasons of leftovers that may be placed in another sequence."""


@dataclass(frozen=True, eq=False)
class Packing:
    """What became of an order in one container.

    Attributes:
        container: the box.
        placements: in packing sequence.
        leftovers: what did not fit, and why.
        surfaces: the container heightmap after each placement; empty where they are not known.
        utilization: volume of the placed items as a share of the container's.
        makeshift: items that were placed by a risky tier.
        risk: sum of the risks of the tiers that placed them.
        made_by: as in :class:`packenv.types.Plan`.
    """

    container: Container
    placements: tuple[Placement, ...]
    leftovers: tuple[Leftover, ...]
    surfaces: tuple[ContainerMap, ...]
    utilization: float
    makeshift: tuple[str, ...] = ()
    risk: float = 0.0
    made_by: str = "planner"

    @classmethod
    def of_plan(cls, plan: Plan, surfaces: tuple[ContainerMap, ...] = ()) -> Packing:
        """The packing that a plan tells of, with heightmaps where they are known."""
        volume = sum(plan.meshes[p.item].volume for p in plan.placements)
        share = volume / plan.container.volume
        return cls(plan.container, plan.placements, plan.leftovers, surfaces, share, made_by=plan.made_by)

    @property
    def height(self) -> float:
        """Of the pile, m."""
        return max((float(p.corner[2] + p.extents[2]) for p in self.placements), default=0.0)

    @property
    def words(self) -> str:
        """How many items it has, and how high the pile is."""
        placed = len(self.placements)
        return f"{placed} of {placed + len(self.leftovers)} items, height {self.height:.3f} m"

    @property
    def complete(self) -> bool:
        """True where every item is placed."""
        return not self.leftovers

    @property
    def lost(self) -> tuple[str, ...]:
        """Leftovers that another plan may have a place for."""
        return tuple(left.item for left in self.leftovers if left.reason in PERHAPS)

    @property
    def improvable(self) -> bool:
        """True where there are such leftovers."""
        return bool(self.lost)
