"""What a plan claims, asked again: the exact meshes audited, stability and reach checked at every step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import accumulate
from typing import TYPE_CHECKING

from packenv.items.plan_items import Items, options_of, shelf_of
from packenv.planning.robustness import Robustness, least_of, measure_robustness
from packenv.types import Item, Plan
from packenv.verification.claims import Misstatement, misstatements, not_checked, overstatements
from packenv.verification.limits import BrokenLimit, broken_limits
from packenv.verification.stability_and_reach import Recheck, recheck

if TYPE_CHECKING:
    from packenv.verification.exact_meshes import AuditReport


@dataclass(frozen=True, eq=False)
class Verification:
    """What became of a plan's claims: the exact meshes audited, and every step's constraints asked again.

    Attributes:
        audit: from the exact meshes: overlaps, protrusions, insertion from above, lost items.
        envelopes: the same from meshes and convex parts, for plans on these.
        misstated: steps (from 1) whose stated bounding box is not that of the item at its pose.
        overweight: steps from which on the container holds more than it may.
        limits: limits of items that are not kept.
        claims: masses, volumes, limits and metrics that are not what the catalogue and the poses say, and what
            piles withstand where the plan says more than was found.
        recheck: stability and the robot's way.
        robustness: what the pile of each step withstands, by step; empty where the plan keeps no force balance.
        not_checked: what else the plan says, which nothing here compares.
        unchecked: own constraints that the plan names; only their authors can check them.
        placed: number of placed items.
        left_over: number of items that are not in the plan.
    """

    audit: AuditReport
    envelopes: AuditReport | None
    misstated: tuple[int, ...]
    overweight: tuple[int, ...]
    limits: tuple[BrokenLimit, ...]
    claims: tuple[Misstatement, ...]
    recheck: Recheck
    robustness: Mapping[int, Robustness]
    not_checked: tuple[str, ...]
    unchecked: tuple[str, ...]
    placed: int
    left_over: int

    @property
    def ok(self) -> bool:
        """True where nothing was found."""
        sound = self.audit.ok and (self.envelopes is None or self.envelopes.ok)
        true = not self.misstated and not (self.claims or self.overweight or self.limits)
        return sound and true and self.recheck.ok

    def to_json(self) -> dict[str, object]:
        """The report as JSON-able lists and numbers; lengths in m, steps from 1."""
        document: dict[str, object] = {
            **self.audit.to_json(),
            "misstated_boxes": self.misstated,
            "overweight_steps": self.overweight,
            "broken_limits": [asdict(broken) for broken in self.limits],
            "misstated_claims": [asdict(claim) for claim in self.claims],
            **asdict(self.recheck),
            "robustness": [{"step": step, **row.to_details()} for step, row in self.robustness.items()],
            **least_of(self.robustness.values()),
            "not_checked": self.not_checked,
            "unchecked_constraints": self.unchecked,
            "placed": self.placed,
            "left_over": self.left_over,
            "ok": self.ok,
        }
        if self.envelopes is not None:
            document["envelopes"] = self.envelopes.to_json()
        return document


def _overweight(plan: Plan, items: Mapping[str, Item]) -> tuple[int, ...]:
    most = plan.container.max_kg
    laden = accumulate(items[placement.item].mass for placement in plan.placements)
    return tuple(k for k, mass in enumerate(laden, start=1) if most is not None and mass > most + 1e-9)


def verify(plan: Plan, catalogue: Items | None = None, *, unit: str | None = None) -> Verification:
    """Audit a plan from the exact meshes, and check stability and reach of every step again.

    Args:
        plan: the plan.
        catalogue: where its items are from; None takes what the plan names.
        unit: unit of the meshes; None takes the plan's.

    Raises:
        InputError: a mesh is not the one that the plan was made of, or the plan's settings are wrong.
    """
    from packenv.verification.exact_meshes import (  # fcl and scipy: a quarter second
        audit_plan,
        misstated_boxes,
    )

    options = options_of(plan)
    shelf = shelf_of(plan, catalogue, unit=unit)
    names = dict.fromkeys(p.item for p in plan.placements)
    items = {name: shelf.items[name] for name in names}
    shapes = {name: shelf.shapes[name] for name in names}
    robustness = measure_robustness(plan, shapes, shelf.fields, options)
    return Verification(
        audit_plan(plan, items),
        audit_plan(plan, shapes) if options.shape == "parts" else None,
        misstated_boxes(plan, shapes),
        _overweight(plan, items),
        broken_limits(plan, shapes, shelf.fields, options),
        (*misstatements(plan, items, shapes), *overstatements(plan, robustness)),
        recheck(plan, shapes, shelf.fields, options),
        robustness,
        not_checked(plan),
        tuple(str(name) for name in options.own_constraints),
        len(plan.placements),
        len(plan.leftovers),
    )
