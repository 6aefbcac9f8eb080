"""Manipulation feasibility as a constraint of the planner (paper Alg. 1)."""

from __future__ import annotations

from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

from packenv.planning.constraints import Constraint, Trial, Verdict
from packenv.planning.manipulation.checker import ManipulationChecker
from packenv.planning.manipulation.grasps import Grasp, generate_grasps
from packenv.planning.options import GraspRule
from packenv.planning.search.container_map import ContainerMap
from packenv.types import OrientedItem, RobotPath

NO_GRASP = "no-grasp"
"""The word against an orientation on which the cup finds no spot."""


@dataclass(frozen=True, eq=False)
class ManipulationConstraint(Constraint):
    """The robot can bring the item to its place from above.

    Attributes:
        checker: robot cell and waypoints.
        rule: how grasps are generated.
    """

    checker: ManipulationChecker
    rule: GraspRule = "seal"
    _grasps: WeakKeyDictionary[OrientedItem, tuple[Grasp, ...]] = field(
        default_factory=WeakKeyDictionary, repr=False
    )

    @property
    def name(self) -> str:
        """The word for this constraint in figures and messages."""
        return "manipulation"

    def objection(self, oriented: OrientedItem) -> str | None:
        """An orientation without a graspable spot is of no use anywhere."""
        return None if self.grasps(oriented) else NO_GRASP

    def barrier(self, tallest: float) -> str | None:
        """A container that is too deep, too high or too far away is said to be so before any search."""
        return self.checker.cell.barrier(tallest)

    def grasps(self, oriented: OrientedItem) -> tuple[Grasp, ...]:
        """The grasps of an oriented item, generated once."""
        oriented = oriented.whole or oriented
        grasps = self._grasps.get(oriented)
        if grasps is None:
            grasps = self._grasps[oriented] = generate_grasps(
                oriented, rule=self.rule, radius=self.checker.cell.robot.gripper.radius
            )
        return grasps

    def check(self, trial: Trial, surface: ContainerMap, state: None) -> Verdict:
        """Whether some grasp has a feasible way down."""
        found = self.checker.check(trial.oriented, trial.corner, surface, self.grasps(trial.oriented))
        if found.reason is not None:
            return Verdict(False, found.reason)
        assert found.grasp is not None
        assert found.joints is not None
        assert found.lip_heights is not None
        grasp = trial.corner + found.grasp.point
        path = RobotPath(grasp, found.grasp.kind, found.grasps_tried, found.lip_heights, found.joints)
        return Verdict(True, path=path)
