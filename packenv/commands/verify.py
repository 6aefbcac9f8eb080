"""``robotpack verify``: audit a plan from the exact meshes."""

from __future__ import annotations

import argparse

from packenv.audit import AuditReport, audit_plan, misstated_boxes
from packenv.commands.loading import load_plan
from packenv.commands.output import say, say_json


def run(arguments: argparse.Namespace) -> int:
    """Audit a plan; returns the exit code."""
    plan, items = load_plan(arguments.plan, arguments.catalogue, arguments.unit)
    report = audit_plan(plan, items)
    misstated = misstated_boxes(plan, items)
    ok = report.ok and not misstated
    counts = {"placed": len(plan.placements), "left_over": len(plan.leftovers)}
    if arguments.json:
        say_json({**report.to_json(), "misstated_boxes": misstated, **counts, "ok": ok})
    else:
        _report(report, misstated)
        verdict = "ok" if ok else "failed"
        say(f"{verdict}: {counts['placed']} items placed, {counts['left_over']} left over")
    return 0 if ok else 1


def _report(report: AuditReport, misstated: tuple[int, ...]) -> None:
    for o in report.overlaps:
        depth = o.depth * 1e3
        say(f"overlap: step {o.step_b} ({o.item_b}) is {depth:.3f} mm inside step {o.step_a} ({o.item_a})")
    for p in report.protrusions:
        say(f"protrusion: step {p.step} ({p.item}) is {p.depth * 1e3:.3f} mm outside at {p.axis} {p.side}")
    for b in report.blocked:
        say(f"blocked: step {b.step} ({b.item}) cannot be lowered past step {b.by_step} ({b.by_item})")
    for m in report.miscounted:
        say(f"miscounted: {m.item}: {m.ordered} ordered, {m.in_plan} in the plan")
    for step in misstated:
        say(f"misstated: step {step}: corner and extents are not those of the mesh at its pose")
    found = ", ".join(
        f"{len(getattr(report, kind))} {kind}"
        for kind in ("overlaps", "protrusions", "blocked", "miscounted")
    )
    say(f"{report.pairs_checked} pairs checked: {found}, {len(misstated)} misstated")
