"""Check stability and manipulation of every step of a plan again, from its poses and the meshes alone.

Nothing that the plan says of contacts, forces, grasps or joints is believed. The pile of each step is
balanced from nothing, without the shortcuts of the planner and the forces of the step before; the way of
the robot is looked for anew, and the joints that the plan states are put through the forward kinematics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.heightmaps import orient_item
from packenv.geometry.transforms import axis_rotation
from packenv.planning.assembly import counts_prestress, margin_rule
from packenv.planning.manipulation.checker import ManipulationChecker
from packenv.planning.manipulation.grasps import generate_grasps
from packenv.planning.options import GraspRule, PlanOptions
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.replay import surfaces_before
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contact_finder import ContactFinder, contact_finder, grounded
from packenv.planning.stability.contact_patches import tighten
from packenv.planning.stability.contacts import Body, join, no_contacts
from packenv.planning.stability.margins import MarginRule, check_margin
from packenv.planning.stability.settling import settles_with
from packenv.robot.protocol import MAX_STEP
from packenv.types import Contacts, Item, Placement, Plan, RobotPath

JOINT_TOLERANCE = 1e-6
"""How far the cup of the stated joints may be from its stated way, m."""


_ROUNDING = 1e-9
"""Turn within which an answer may depend on rounding, rad: a plan file's quaternion is exact to 1e-16."""

_TURNS = (
    np.eye(3),
    *(axis_rotation(axis, sign * _ROUNDING) for axis in (0, 1, 2) for sign in (1.0, -1.0)),
)
"""An item that stands at one of these stands: samples that are equally far off are told apart by rounding alone."""


@dataclass(frozen=True)
class Recheck:
    """Steps (from 1) that fail.

    Attributes:
        unstable_steps: the pile with this step's item does not stand.
        unreachable_steps: the robot cannot bring this step's item to its place, or the stated joints are not
            those of the stated way.
    """

    unstable_steps: tuple[int, ...] = ()
    unreachable_steps: tuple[int, ...] = ()

    @property
    def ok(self) -> bool:
        """True where no step fails."""
        return not (self.unstable_steps or self.unreachable_steps)


def recheck(
    plan: Plan,
    items: Mapping[str, Item],
    fields: Mapping[str, SurfaceField],
    options: PlanOptions,
) -> Recheck:
    """Check what the plan's constraints ask beyond non-overlap.

    Args:
        plan: the plan.
        items: the placed items by name, as the geometry that the plan was made with.
        fields: their surfaces.
        options: what the plan claims to keep; of the stability rules ``cautious`` and ``physics`` that the pile
            is balanced and each item settles.
    """
    if options.constraints == "overlap":
        return Recheck()
    rule = margin_rule(options.stability)
    balance = StabilityChecker(options.setup.friction)
    find = contact_finder(options.contacts, balance.mu, tight=rule is not None)
    prestress = counts_prestress(options.stability)
    unstable = _unstable(plan, items, fields, balance, rule, find, prestress=prestress)
    if options.constraints == "stability":
        return Recheck(unstable)
    exact = options.heights == "mesh"
    surfaces = surfaces_before(plan, items, options.grid.cell_size, exact=exact)
    checker = ManipulationChecker(options.setup.with_container(plan.container))
    unreachable = tuple(
        step
        for step, placement in list(enumerate(plan.placements, start=1))[plan.lying :]
        if step > len(surfaces)
        or not _reachable(placement, items[placement.item], surfaces[step - 1], checker, options.grasp)
    )
    return Recheck(unstable, unreachable)


def _unstable(
    plan: Plan,
    items: Mapping[str, Item],
    fields: Mapping[str, SurfaceField],
    checker: StabilityChecker,
    rule: MarginRule | None,
    find: ContactFinder,
    *,
    prestress: bool,
) -> tuple[int, ...]:
    bodies: list[Body] = []
    contacts = no_contacts()
    masses: list[float] = []
    coms: list[np.ndarray] = []
    failed = []
    for step, placement in enumerate(plan.placements, start=1):
        item = items[placement.item]
        body = Body(fields[placement.item], placement.rotation, placement.position, friction=item.friction)
        if step <= plan.lying:  # it proved that it stands: like the floor, as in planning
            bodies.append(body)
            continue
        masses.append(item.mass)
        coms.append(placement.rotation @ item.com + placement.position)
        for turn in _TURNS:
            turned = replace(body, rotation=turn @ body.rotation)
            own = grounded(find(turned, bodies, plan.container, step), plan.lying)
            pile = join([contacts, own])
            carried = prestress or settles_with(checker, tighten(own), coms[-1], len(masses), rule)
            if carried and _stands(checker, pile, masses, coms, rule):
                break
        else:
            failed.append(step)
        contacts = pile
        bodies.append(body)
    return tuple(failed)


def _stands(
    checker: StabilityChecker,
    contacts: Contacts,
    masses: Sequence[float],
    coms: Sequence[np.ndarray],
    rule: MarginRule | None,
) -> bool:
    if rule is not None:
        return check_margin(checker, contacts, masses, np.array(coms), rule)[-1].stable
    return checker.check(contacts, masses, np.array(coms)).stable


def _reachable(
    placement: Placement,
    item: Item,
    surface: ContainerMap,
    checker: ManipulationChecker,
    grasp: GraspRule,
) -> bool:
    if item.mass > checker.cell.robot.gripper.heaviest:
        return False
    oriented = orient_item(item, placement.rotation, cell_size=surface.cell_size)
    corner = placement.position - oriented.offset
    grasps = generate_grasps(oriented, rule=grasp, radius=checker.cell.robot.gripper.radius)
    if not checker.check(oriented, corner, surface, grasps).feasible:
        return False
    cups = [corner + g.point for g in grasps]
    if placement.path is None or not _stated_way_holds(placement.path, corner, cups, checker):
        return False
    return checker.way_clear(oriented, corner, surface, placement.path.grasp, placement.path.joints)


def _stated_way_holds(
    path: RobotPath, corner: np.ndarray, cups: Sequence[np.ndarray], checker: ManipulationChecker
) -> bool:
    """Whether the stated joints bring the cup, holding this item, from above the rim to its place.

    The grasp must be one of the item's own, the way straight down from above the rim by way of the release
    without a turn, the joints one continuous branch within the limits.
    """
    joints, grasp, heights = path.joints, path.grasp, path.cup_heights
    cell, robot = checker.cell, checker.cell.robot
    if len(joints) < 3 or not all(np.isfinite(a).all() for a in (joints, grasp, heights)):
        return False
    own = min(float(np.abs(grasp - cup).max()) for cup in cups) <= JOINT_TOLERANCE
    ends = np.abs(heights[-2:] - (grasp[2] + np.array([checker.release, 0.0]))).max() <= JOINT_TOLERANCE
    lowered = heights[0] - grasp[2] + corner[2] >= cell.container.height - JOINT_TOLERANCE
    spaced = np.all(np.diff(heights) <= 0.0) and -np.diff(heights).min() <= 2 * checker.spacing
    ways = np.column_stack([np.tile(grasp[:2], (len(joints), 1)), heights])
    reached = robot.tool(joints)
    error = np.abs(reached[:, :3, 3] - cell.to_base(ways)).max()
    down = np.abs(reached[:, :3, 2] - np.array([0.0, 0.0, -1.0])).max()
    turned = np.abs(reached[:, :3, :3] - reached[0, :3, :3]).max()
    inside = np.all(robot.limit_margin(joints) >= -1e-9)
    smooth = np.abs(np.diff(joints, axis=0)).max() <= MAX_STEP
    return bool(
        own
        and ends
        and lowered
        and spaced
        and error <= JOINT_TOLERANCE
        and down <= JOINT_TOLERANCE
        and turned <= JOINT_TOLERANCE
        and inside
        and smooth
    )
