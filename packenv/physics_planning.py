"""Physics as a constraint of the planner: what passes the static checks is dropped in a scratch world."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from packenv.planning.constraints import Trial, Verdict
from packenv.planning.container_map import ContainerMap
from packenv.planning.measured import Resting
from packenv.sim.drop_test import DropRule, DropTest, Lying, Release
from packenv.sim.physics_items import PhysicsItem
from packenv.sim.world import WorldConfig
from packenv.types import Container, OrientedItem

NOMINAL = (Release(),)
"""One drop, released exactly over its place."""

CAREFUL = (
    Release(offset=(0.003, 0.003), yaw=math.radians(1.5)),
    Release(offset=(-0.003, -0.003), yaw=math.radians(-1.5)),
    Release(),
)
"""Two drops with errors of the size that a robot makes, and the exact one."""


class PhysicsConstraint:
    """The item is dropped on the pile as physics left it, and must come to rest where it was planned.

    The last drop of each candidate makes the pile on which the next item is dropped; the others only have
    to go well.
    """

    def __init__(
        self,
        items: Mapping[str, PhysicsItem],
        container: Container,
        world: WorldConfig | None = None,
        rule: DropRule | None = None,
        releases: Sequence[Release] = CAREFUL,
    ) -> None:
        """Keep what is needed; the world is built when the first candidate comes.

        Args:
            items: what physics needs of every item of the order, by name.
            container: the box.
            world: settings of the scratch world.
            rule: what counts as resting in place.
            releases: how each candidate is dropped; the last one is the one that is planned on.
        """
        self._items, self._container = items, container
        self._config, self._rule = world or WorldConfig(), rule or DropRule()
        self._releases = tuple(releases)
        self._test: DropTest | None = None

    @property
    def name(self) -> str:
        """One word."""
        return "physics"

    def start(self, resting: Sequence[Resting] = ()) -> tuple[Lying, ...]:
        """The pile to begin with, in a world of its own."""
        self.close()
        return tuple(Lying(self._items[p.item.name], (p.rotation, p.position)) for p in resting)

    def objection(self, oriented: OrientedItem) -> str | None:
        """None: what falls depends on the pile."""
        return None

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        """Drop the candidate."""
        if self._test is None:
            self._test = DropTest(self._container, self._config, self._rule)
        item = self._items[trial.oriented.item]
        for how in self._releases:
            dropped = self._test.drop(state, item, trial.oriented.rotation, trial.position, how)
            if dropped.reason:
                return Verdict(False, f"physics-{dropped.reason}")
        details = {
            "shift_m": round(dropped.shift_m, 6),
            "sink_m": round(dropped.sink_m, 6),
            "turned_deg": round(math.degrees(dropped.turned_rad), 3),
        }
        return Verdict(True, state=dropped.pile, details=details)

    def close(self) -> None:
        """Free the scratch world."""
        if self._test is not None:
            self._test.close()
            self._test = None
