"""What the owners of items allow, checked at every step of a plan from its poses and the meshes alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from packenv.geometry.distance_grids import SurfaceField
from packenv.planning.options import PlanOptions
from packenv.planning.search.measured import Resting
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contact_finder import contact_finder, grounded
from packenv.planning.stability.contacts import Body, join, no_contacts
from packenv.planning.stability.loads import SLACK, Balanced, loads_borne, with_supports
from packenv.types import Item, Plan


@dataclass(frozen=True)
class BrokenLimit:
    """A limit that a plan does not keep.

    Attributes:
        step: from 1, the first at which it is so.
        item: whose limit it is.
        limit: ``upright``, ``load`` or ``keep_apart``.
        allowed: how far it may lean, degrees; what may rest on it, kg; its group.
        found: how far it leans; what rests on it; the group of another item.
    """

    step: int
    item: str
    limit: str
    allowed: float | str
    found: float | str


def broken_limits(
    plan: Plan, shapes: Mapping[str, Item], fields: Mapping[str, SurfaceField], options: PlanOptions
) -> tuple[BrokenLimit, ...]:
    """The limits of items that a plan does not keep; those of what lay there before only where it bears more.

    Args:
        plan: the plan.
        shapes: its placed items by name, as the geometry that it was made with.
        fields: their surfaces; not read where nothing is limited.
        options: how it was planned: friction, and how contacts are found.
    """
    found = [*_leaning(plan, shapes), *_mixed(plan, shapes)]
    if any(np.isfinite(shapes[p.item].limits.bears) for p in plan.placements):
        found += _overloaded(plan, shapes, fields, options)
    return tuple(sorted(found, key=lambda broken: broken.step))


def _leaning(plan: Plan, shapes: Mapping[str, Item]) -> Iterator[BrokenLimit]:
    for step, placement in list(enumerate(plan.placements, start=1))[plan.lying :]:
        limits, up = shapes[placement.item].limits, placement.rotation[2]
        if not limits.allows(up):
            lean = round(limits.lean_deg(up), 3)
            yield BrokenLimit(step, placement.item, "upright", limits.tilt_deg, lean)


def _mixed(plan: Plan, shapes: Mapping[str, Item]) -> Iterator[BrokenLimit]:
    first: str | None = None
    for step, placement in enumerate(plan.placements, start=1):
        group = shapes[placement.item].limits.keep_apart
        if group is not None and first not in (None, group):
            yield BrokenLimit(step, placement.item, "keep_apart", group, str(first))
        first = first or group


def _overloaded(
    plan: Plan, shapes: Mapping[str, Item], fields: Mapping[str, SurfaceField], options: PlanOptions
) -> Iterator[BrokenLimit]:
    checker = StabilityChecker(options.setup.friction)
    find = contact_finder(options.contacts, checker.mu, tight=False)
    items: list[Resting] = []
    bodies: list[Body] = []
    rests_on: tuple[frozenset[int], ...] = ()
    contacts = no_contacts()
    told: set[int] = set()
    for step, placement in enumerate(plan.placements, start=1):
        items.append(Resting(shapes[placement.item], placement.rotation, placement.position))
        body = Body(
            fields[placement.item], placement.rotation, placement.position, friction=items[-1].item.friction
        )
        own = find(body, bodies, plan.container, step)
        bodies.append(body)
        rests_on = with_supports(rests_on, own, step)
        balanced = None
        if step > plan.lying:
            contacts = join([contacts, grounded(own, plan.lying)])
            free = items[plan.lying :]
            masses = np.array([p.item.mass for p in free])
            coms = np.array([p.rotation @ p.item.com + p.position for p in free])
            balanced = Balanced(checker, contacts, masses, coms, plan.lying)
        for number, load in loads_borne(items, rests_on, balanced).items():
            limits = items[number - 1].item.limits
            if load > limits.bears + SLACK and number not in told and step > plan.lying:
                told.add(number)
                yield BrokenLimit(step, items[number - 1].item.name, "load", limits.bears, round(load, 6))
