"""``robotpack verify``: audit a plan from the exact meshes."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TypeVar, get_args

from packenv.audit import AuditReport, audit_plan, misstated_boxes
from packenv.commands.loading import (
    load_fields,
    load_plan,
    load_planned_shapes,
    plan_catalogue,
    plan_cell_size,
    plan_geometry,
)
from packenv.commands.output import say, say_json
from packenv.errors import PlanError
from packenv.planning.assembly import Constraints, StabilityRule
from packenv.planning.grasps import Rule as GraspRule
from packenv.planning.stability_constraint import ContactRule
from packenv.recheck import Recheck, recheck
from packenv.types import Plan

T = TypeVar("T")

CONSTRAINTS: tuple[Constraints, ...] = get_args(Constraints)
CONTACT_RULE_NAMES: tuple[ContactRule, ...] = get_args(ContactRule)
GRASP_RULES: tuple[GraspRule, ...] = get_args(GraspRule)
STABILITY_RULES: tuple[StabilityRule, ...] = get_args(StabilityRule)

_FINDINGS = ("overlaps", "protrusions", "blocked")
_WITH_PARTS = "with convex parts: "


def run(arguments: argparse.Namespace) -> int:
    """Audit a plan; returns the exit code."""
    plan, items = load_plan(arguments.plan, arguments.catalogue, arguments.unit)
    constraints = _claim(plan, "constraints", CONSTRAINTS, str(arguments.plan))
    stability = _claim(plan, "stability", STABILITY_RULES, str(arguments.plan))
    contacts = _claim(plan, "contacts", CONTACT_RULE_NAMES, str(arguments.plan))
    grasp = _claim(plan, "grasp", GRASP_RULES, str(arguments.plan))
    geometry = plan_geometry(plan, arguments.plan)
    shelf = plan_catalogue(plan, arguments.catalogue, arguments.unit)
    shapes = load_planned_shapes(plan, arguments.plan, items, shelf)
    report = audit_plan(plan, items)
    envelopes = audit_plan(plan, shapes) if geometry == "parts" else None
    misstated = misstated_boxes(plan, shapes)
    again = recheck(
        plan,
        shapes,
        load_fields(shapes) if constraints != "overlap" else {},
        constraints=constraints,
        stability=stability,
        contacts=contacts,
        grasp=grasp,
        cell_size=plan_cell_size(plan, arguments.plan),
    )
    ok = report.ok and (envelopes is None or envelopes.ok) and not misstated and again.ok
    counts = {"placed": len(plan.placements), "left_over": len(plan.leftovers)}
    if arguments.json:
        document = {**report.to_json(), "misstated_boxes": misstated, **asdict(again), **counts, "ok": ok}
        say_json(document if envelopes is None else {**document, "envelopes": envelopes.to_json()})
    else:
        _report(report, envelopes, misstated)
        if constraints != "overlap":
            _report_recheck(again, constraints)
        verdict = "ok" if ok else "failed"
        say(f"{verdict}: {counts['placed']} items placed, {counts['left_over']} left over")
    return 0 if ok else 1


def _claim(plan: Plan, name: str, choices: tuple[T, ...], path: str) -> T:
    """What the plan says it keeps."""
    for choice in choices:
        if plan.settings.get(name) == choice:
            return choice
    raise PlanError(f"{path}: settings.{name} is {plan.settings.get(name)!r}, should be one of {choices}")


def _report_recheck(again: Recheck, constraints: str) -> None:
    for step in again.unstable_steps:
        say(f"unstable: the pile does not stand at step {step}")
    for step in again.unreachable_steps:
        say(f"unreachable: the robot cannot place step {step}")
    reach = f", {len(again.unreachable_steps)} unreachable" if constraints == "robot" else ""
    say(f"every step checked again: {len(again.unstable_steps)} unstable{reach}")


def _report(report: AuditReport, envelopes: AuditReport | None, misstated: tuple[int, ...]) -> None:
    _report_findings(report)
    if envelopes is not None:
        _report_findings(envelopes, _WITH_PARTS)
    for m in report.miscounted:
        say(f"miscounted: {m.item}: {m.ordered} ordered, {m.in_plan} in the plan")
    for step in misstated:
        say(f"misstated: step {step}: corner and extents are not those of the item at its pose")
    found = _counted(report, (*_FINDINGS, "miscounted"))
    say(f"{report.pairs_checked} pairs checked: {found}, {len(misstated)} misstated")
    if envelopes is not None:
        say(f"{_WITH_PARTS}{_counted(envelopes, _FINDINGS)}")


def _report_findings(report: AuditReport, how: str = "") -> None:
    for o in report.overlaps:
        pair = f"step {o.step_b} ({o.item_b}) is {o.depth * 1e3:.3f} mm inside step {o.step_a} ({o.item_a})"
        say(f"{how}overlap: {pair}")
    for p in report.protrusions:
        where = f"{p.depth * 1e3:.3f} mm outside at {p.axis} {p.side}"
        say(f"{how}protrusion: step {p.step} ({p.item}) is {where}")
    for b in report.blocked:
        say(f"{how}blocked: step {b.step} ({b.item}) cannot be lowered past step {b.by_step} ({b.by_item})")


def _counted(report: AuditReport, kinds: tuple[str, ...]) -> str:
    return ", ".join(f"{len(getattr(report, kind))} {kind}" for kind in kinds)
