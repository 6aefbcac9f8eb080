"""This side up: orientations at which an item may not stand are ruled out before any search."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from packenv.geometry.prepare import PreparedItem
from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.search.container_map import ContainerMap
from packenv.types import OrientedItem

NOT_UPRIGHT = "not-upright"
"""The word against an orientation at which an item leans too far."""


@dataclass(frozen=True, eq=False)
class UprightConstraint(Constraint):
    """Items that have a side which must be up.

    Attributes:
        items: by name. One that has no stable pose with that side up stands nowhere, on its tip neither.
    """

    items: Mapping[str, PreparedItem]

    @property
    def name(self) -> str:
        """The word for this constraint in figures and messages."""
        return "upright"

    def objection(self, oriented: OrientedItem) -> str | None:
        """An orientation at which the side that must be up is not."""
        item = self.items[oriented.item]
        stands = item.limits.upright is None or any(
            item.limits.allows(pose.rotation[2]) for pose in item.poses
        )
        return None if stands and item.limits.allows(oriented.rotation[2]) else NOT_UPRIGHT

    def explanation(self, oriented: OrientedItem) -> str | None:
        """How the item would have to stand."""
        if self.objection(oriented) is None:
            return None
        limits = self.items[oriented.item].limits
        return (
            f"{oriented.item} must stand with its {limits.upright} axis up, at most {limits.tilt_deg:g}° off, and no "
            "such pose both is stable and fits"
        )

    def check(self, trial: Trial, surface: ContainerMap, state: Any) -> Verdict:
        """Whether the candidate stands as it may."""
        reason = self.objection(trial.oriented)
        return Verdict(reason is None, reason or "")
