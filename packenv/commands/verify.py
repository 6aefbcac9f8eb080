"""``robotpack verify``: audit a plan from the exact meshes."""

from __future__ import annotations

import argparse

from packenv.audit import AuditReport, audit_plan
from packenv.commands.loading import load_plan
from packenv.commands.output import say, say_json


def run(arguments: argparse.Namespace) -> int:
    """Audit a plan; returns the exit code."""
    plan, items = load_plan(arguments.plan, arguments.catalogue, arguments.unit)
    report = audit_plan(plan, items)
    if arguments.json:
        say_json(report.to_json())
    else:
        _report(report)
    return 0 if report.ok else 1


def _report(report: AuditReport) -> None:
    for o in report.overlaps:
        depth = o.depth * 1e3
        say(f"overlap: step {o.step_b} ({o.item_b}) is {depth:.3f} mm inside step {o.step_a} ({o.item_a})")
    for p in report.protrusions:
        say(f"protrusion: step {p.step} ({p.item}) is {p.depth * 1e3:.3f} mm outside at {p.axis} {p.side}")
    for b in report.blocked:
        say(f"blocked: step {b.step} ({b.item}) cannot be lowered past step {b.by_step} ({b.by_item})")
    for m in report.miscounted:
        say(f"miscounted: {m.item}: {m.ordered} ordered, {m.in_plan} in the plan")
    found = ", ".join(
        f"{len(getattr(report, kind))} {kind}"
        for kind in ("overlaps", "protrusions", "blocked", "miscounted")
    )
    say(f"{'ok' if report.ok else 'failed'}: {report.pairs_checked} pairs checked, {found}")
