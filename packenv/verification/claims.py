"""What a plan says of itself in figures: compared with the catalogue and the poses, or named as not checked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from packenv.errors import is_number
from packenv.planning.robustness import Robustness, least_of
from packenv.types import Item, Plan

_TOLERANCE = 1e-6
"""Share of a figure that it may be off."""

_ROUNDING = {"tilt_deg": 0.5, "push": 0.01, "offset_m": 5e-4}
"""By how much a plan may say that it withstands more: samples of a surface that are equally far off take turns."""

_NEVER_CHECKED = ("stable_pose", "yaw", "route", "score", "candidates", "checked", "rejections", "made_by")


@dataclass(frozen=True)
class Misstatement:
    """A figure that is not what the meshes and the poses say.

    Attributes:
        where: its place in the plan file.
        stated: what the plan says.
        found: what it is.
    """

    where: str
    stated: object
    found: object


def misstatements(
    plan: Plan, items: Mapping[str, Item], shapes: Mapping[str, Item]
) -> tuple[Misstatement, ...]:
    """Masses, volumes and limits that are not the catalogue's, and metrics that are not the plan's own.

    Of metrics those are compared that are there, but for what rehearsals found.

    Args:
        plan: the plan.
        items: its placed items by name, as the catalogue has them.
        shapes: the same, as the geometry that the plan was made with.
    """
    claims = (*_of_meshes(plan, items), *_of_metrics(plan, items, shapes))
    return tuple(Misstatement(*claim) for claim in claims if not _agree(*claim[1:]))


def overstatements(plan: Plan, found: Mapping[int, Robustness]) -> tuple[Misstatement, ...]:
    """Figures of what piles withstand that are larger than those found; of steps and of metrics.

    Args:
        plan: the plan.
        found: what the pile of each step withstands; empty where nothing of it is asked.
    """
    rows = {
        f"steps[{step - 1}].details.robustness": (plan.placements[step - 1].details.get("robustness"), row)
        for step, row in ((step, row.to_details()) for step, row in found.items())
    }
    rows["metrics"] = plan.metrics, least_of(found.values())
    return tuple(
        Misstatement(f"{where}.{name}", stated[name], most)
        for where, (stated, row) in rows.items()
        if isinstance(stated, Mapping)
        for name, most in row.items()
        if name in stated and not _no_more(stated[name], most, name.removeprefix("min_"))
    )


def _no_more(stated: object, most: float, name: str) -> bool:
    return is_number(stated) and stated <= most + _ROUNDING[name]


def not_checked(plan: Plan) -> tuple[str, ...]:
    """Names of what the plan says and nothing here compares (docs/plan-format.md)."""
    details = dict.fromkeys(name for p in plan.placements for name in p.details)
    named = [f"details.{name}" for name in details if name != "robustness"]
    rehearsed = [f"metrics.{name}" for name in plan.metrics if name.startswith("rehearsal_")]
    reasons = ["leftovers.reason"] if plan.leftovers else []
    return (*_NEVER_CHECKED, *named, *rehearsed, *reasons)


def _of_meshes(plan: Plan, items: Mapping[str, Item]) -> Iterator[tuple[str, object, object]]:
    for name, item in items.items():
        record = plan.meshes.get(name)
        if record is not None:
            yield f"meshes.{name}.volume", record.volume, item.volume
            yield f"meshes.{name}.mass", record.mass, item.mass
            yield f"meshes.{name}.mass_estimated", float(record.mass_estimated), float(item.mass_estimated)
            yield f"meshes.{name}.friction", record.friction, item.friction
            yield f"meshes.{name}.limits", record.limits.to_mapping(), item.limits.to_mapping()


def _of_metrics(
    plan: Plan, items: Mapping[str, Item], shapes: Mapping[str, Item]
) -> Iterator[tuple[str, object, object]]:
    tops = [float((shapes[p.item].vertices @ p.rotation[2] + p.position[2]).max()) for p in plan.placements]
    found = {
        "ordered": float(sum(line.qty for line in plan.order)),
        "packed": float(len(plan.placements)),
        "utilization": float(np.sum([items[p.item].volume for p in plan.placements])) / plan.container.volume,
        "height": max(tops, default=0.0),
    }
    routes = Counter(f"route_{p.route}" for p in plan.placements)
    for name, stated in plan.metrics.items():
        if name in found or name.startswith("route_"):
            yield f"metrics.{name}", stated, found.get(name, float(routes[name]))


def _agree(stated: object, found: object) -> bool:
    if not is_number(found):
        return stated == found
    return is_number(stated) and abs(stated - found) <= _TOLERANCE * abs(found)
