"""What every intermediate pile of a plan withstands, in three figures a step.

They are found from the poses and the meshes alone, once for a plan that is made, and again by whoever verifies it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.transforms import quaternion_to_rotation, rotation_to_quaternion
from packenv.planning.options import PlanOptions
from packenv.planning.search.container_map import ContainerMap
from packenv.planning.search.offsets import largest_offset
from packenv.planning.search.replay import seated, surfaces_before
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contact_finder import contact_finder, grounded
from packenv.planning.stability.contacts import Body
from packenv.planning.stability.strength import MOST, measure_strength
from packenv.types import Item, Placement, Plan, Pose

LARGEST_TILT = math.degrees(math.atan(MOST))
"""Tilts beyond this are not told apart, degrees."""

LARGEST_PUSH = MOST
"""Pushes beyond this are not told apart, weights."""

_DIGITS = 9
"""Decimals of a pose that count: a plan's file has the same figures as the plan in memory."""


@dataclass(frozen=True)
class Robustness:
    """What the pile of a step withstands.

    Attributes:
        tilt_deg: gravity may be tilted by this in any direction and the pile stays in balance, degrees.
        push: sideways force on the centre of mass of the step's item, in its weights, that the pile balances.
        offset_m: how far the item may be off sideways and meet nothing on its way down, m.
    """

    tilt_deg: float
    push: float
    offset_m: float

    def to_details(self) -> dict[str, float]:
        """The figures for a plan's file, rounded down."""
        return {name: math.floor(value * 1e4 + 1e-6) / 1e4 for name, value in asdict(self).items()}


def least_of(steps: Iterable[Robustness]) -> dict[str, float]:
    """The least of each figure over some steps, as a plan's metrics have it; nothing without steps."""
    rows = [step.to_details() for step in steps]
    return {f"min_{name}": min(row[name] for row in rows) for name in (rows[0] if rows else ())}


def with_robustness(
    plan: Plan, shapes: Mapping[str, Item], fields: Mapping[str, SurfaceField], options: PlanOptions
) -> Plan:
    """The plan with the figures of every step in its details, and the least of each among its metrics."""
    found = measure_robustness(plan, shapes, fields, options)
    placements = tuple(
        replace(p, details={**p.details, "robustness": found[step].to_details()}) if step in found else p
        for step, p in enumerate(plan.placements, start=1)
    )
    return replace(plan, placements=placements, metrics={**plan.metrics, **least_of(found.values())})


def measure_robustness(
    plan: Plan,
    shapes: Mapping[str, Item],
    fields: Mapping[str, SurfaceField],
    options: PlanOptions,
) -> dict[int, Robustness]:
    """What the pile of every step withstands; by step from 1, without those that lay there before.

    Args:
        plan: the plan.
        shapes: its placed items by name, as the geometry that it was made with.
        fields: their surfaces.
        options: how it was planned: friction, contacts, height of the release. Plans that keep no force balance
            have no figures.
    """
    if options.constraints == "overlap":
        return {}
    checker = StabilityChecker(options.setup.friction)
    find = contact_finder(options.contacts, checker.mu, tight=False)
    bodies: list[Body] = []
    found, masses, coms = [], [], []
    for step, placement in enumerate(plan.placements, start=1):
        item = shapes[placement.item]
        rotation, position = _rounded(placement)
        body = Body(fields[placement.item], rotation, position, friction=item.friction)
        if step > plan.lying:
            found.append(grounded(find(body, bodies, plan.container, step), plan.lying))
            masses.append(item.mass)
            coms.append(rotation @ item.com + position)
        bodies.append(body)
    before = surfaces_before(plan, shapes, options.grid.cell_size)
    strengths = measure_strength(checker, found, np.array(masses), np.array(coms).reshape(-1, 3))
    return {
        step: Robustness(
            strength.tilt_deg,
            strength.push,
            _offset(plan.placements[step - 1], shapes, before[step - 1 : step], options),
        )
        for step, strength in enumerate(strengths, start=plan.lying + 1)
    }


def _rounded(placement: Placement) -> Pose:
    """The pose as its file gives it, whatever is behind the ninth decimal."""
    turn = np.round(rotation_to_quaternion(placement.rotation), _DIGITS)
    return Pose(quaternion_to_rotation(turn / np.linalg.norm(turn)), np.round(placement.position, _DIGITS))


def _offset(
    placement: Placement, shapes: Mapping[str, Item], before: Sequence[ContainerMap], options: PlanOptions
) -> float:
    """Of an item on the one map before its step; 0 without, for then it is outside."""
    for surface in before:
        place = seated(placement, shapes[placement.item], surface)
        return largest_offset(surface, *place, options.setup.release_height)
    return 0.0
