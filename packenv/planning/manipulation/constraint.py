"""Manipulation feasibility as a constraint of the planner (paper Alg. 1)."""

from __future__ import annotations

from collections.abc import Mapping
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

TOO_HEAVY = "too-heavy"
"""The word against an item that the cup cannot hold."""


@dataclass(frozen=True, eq=False)
class ManipulationConstraint(Constraint):
    """The robot can bring the item to its place from above.

    Attributes:
        checker: robot cell and waypoints.
        rule: how grasps are generated.
        masses: of the items by name, kg; one that is not there may be as light as it likes.
    """

    checker: ManipulationChecker
    rule: GraspRule = "seal"
    masses: Mapping[str, float] = field(default_factory=dict)
    _grasps: WeakKeyDictionary[OrientedItem, tuple[Grasp, ...]] = field(
        default_factory=WeakKeyDictionary, repr=False
    )

    def __reduce__(self) -> tuple[type[ManipulationConstraint], tuple[object, ...]]:
        """Copied to another process it finds its grasps anew."""
        return ManipulationConstraint, (self.checker, self.rule, self.masses)

    @property
    def name(self) -> str:
        """The word for this constraint in figures and messages."""
        return "manipulation"

    def objection(self, oriented: OrientedItem) -> str | None:
        """An item that is too heavy, or an orientation without a graspable spot, is of no use anywhere."""
        if self._mass(oriented) > self.checker.cell.robot.gripper.heaviest:
            return TOO_HEAVY
        return None if self.grasps(oriented) else NO_GRASP

    def explanation(self, oriented: OrientedItem) -> str | None:
        """What an item weighs that is too heavy, or what helps where the cup finds no spot."""
        mass, most = self._mass(oriented), self.checker.cell.robot.gripper.heaviest
        if mass > most:
            return f"{oriented.item} weighs {mass:.3g} kg, and the gripper holds at most {most:.3g} kg"
        if self.grasps(oriented):
            return None
        return (
            f"{oriented.item} has no graspable spot in any orientation that fits; a less strict rule of --grasp, or "
            "--constraints stability, which asks for no robot, may do"
        )

    def _mass(self, oriented: OrientedItem) -> float:
        return self.masses.get(oriented.item, 0.0)

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
