"""What lies in a box already, as files: a plan, poses that were measured, or a box with measured poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from packenv.errors import PlanError
from packenv.io.plans import Reader, read_plan
from packenv.json_text import read_json
from packenv.types import Container, Plan, Pose

Lying = tuple[str, Pose]
"""An item's name, and where it lies."""

_START = 'a plan that pack wrote, or {"container": {"size": [...]}, "items": [...]}'
_POSES = "a list of item, position (m) and quat_xyzw"


@dataclass(frozen=True, eq=False)
class PartlyFilled:
    """A box that is not empty.

    Attributes:
        container: the box.
        items: what lies in it, in packing sequence.
        plan: that placed the items, where one did: its first items are these.
    """

    container: Container
    items: tuple[Lying, ...]
    plan: Plan | None = None

    @classmethod
    def of_plan(cls, plan: Plan, measured: Sequence[Lying] | None = None) -> PartlyFilled:
        """The box of a plan that was carried out.

        Args:
            plan: the plan.
            measured: its first items where they lie; all where they were planned where None.

        Raises:
            PlanError: these are not its first items.
        """
        items = tuple((p.item, p.pose) for p in plan.placements)
        if measured is None:
            return cls(plan.container, items, plan)
        if len(measured) > len(items):
            raise PlanError(f"{len(measured)} measured poses, but the plan places {len(items)} items")
        for step, ((name, _), (planned, _)) in enumerate(zip(measured, items, strict=False), start=1):
            if name != planned:
                raise PlanError(
                    f"measured pose {step} is of {name!r:.60}, but step {step} of {plan.label} is {planned}: give "
                    "poses in packing sequence"
                )
        return cls(plan.container, tuple(measured), plan)


def read_partly_filled(start: str | Path, measured: str | Path | None = None) -> PartlyFilled:
    """Read what a box holds.

    Args:
        start: a plan, all of whose items lie in its box; or a JSON object of ``container`` (``size`` in m, as in a
            plan) and ``items``, a list as ``measured``.
        measured: where the first items of the plan were measured: a JSON list of ``item``, ``position`` (m) and
            ``quat_xyzw``, as in a plan's steps and in packing sequence.

    Raises:
        InputError: a file cannot be read or a value is wrong.
    """
    path = Path(start)
    document = read_json(path, _START, PlanError)
    if isinstance(document, dict) and "schema_version" not in document and "items" in document:
        if measured is not None:
            raise PlanError(f"{path}: has measured poses itself, give no others")
        reader = Reader(path)
        return PartlyFilled(reader.container(document), _items(reader, document["items"]))
    plan = read_plan(path)
    if measured is None:
        return PartlyFilled.of_plan(plan)
    poses = Path(measured)
    return PartlyFilled.of_plan(plan, _items(Reader(poses), read_json(poses, _POSES, PlanError)))


def _items(reader: Reader, rows: Any) -> tuple[Lying, ...]:
    if not isinstance(rows, list):
        raise reader.fail("items", rows, _POSES)
    found = []
    for k, row in enumerate(rows):
        where = f"items[{k}]"
        rotation = reader.rotation(row, where)
        found.append((reader.name(row, where), Pose(rotation, reader.vector(row, "position", where, 3))))
    return tuple(found)
