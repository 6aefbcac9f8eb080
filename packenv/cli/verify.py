"""``robotpack verify``: audit a plan from the exact meshes."""

from __future__ import annotations

import argparse

from packenv import api
from packenv.cli.output import say, say_json
from packenv.items.plan_items import open_plan, options_of
from packenv.planning.robustness import least_of
from packenv.verification.exact_meshes import AuditReport
from packenv.verification.report import Verification
from packenv.view.words import robustness_words

_FINDINGS = ("overlaps", "protrusions", "blocked")
_LIMITS = {
    "upright": "not upright: step {step} ({item}) leans by {found:.1f}°, it may by {allowed:g}°",
    "load": "overload: from step {step} on up to {found:.3g} kg rest on {item}, which bears {allowed:g} kg",
    "keep_apart": "not kept apart: step {step} ({item}) is of group {allowed}, the box holds items of {found}",
}
_WITH_PARTS = "with convex parts: "


def run(arguments: argparse.Namespace) -> int:
    """Audit a plan; returns the exit code."""
    plan, shelf = open_plan(arguments.plan, arguments.catalogue, unit=arguments.unit)
    found = api.verify(plan, shelf)
    if arguments.json:
        say_json(found.to_json())
    else:
        _report(found, options_of(plan).constraints)
    return 0 if found.ok else 1


def _report(found: Verification, constraints: str) -> None:
    _report_findings(found.audit)
    if found.envelopes is not None:
        _report_findings(found.envelopes, _WITH_PARTS)
    for m in found.audit.miscounted:
        say(f"miscounted: {m.item}: {m.ordered} ordered, {m.in_plan} in the plan")
    for step in found.misstated:
        say(f"misstated: step {step}: corner and extents are not those of the item at its pose")
    for step in found.overweight:
        say(f"overweight: step {step}: from here on the box holds more than its max_kg")
    for broken in found.limits:
        say(_LIMITS[broken.limit].format(**vars(broken)))
    for claim in found.claims:
        right = f"{claim.found:g}" if isinstance(claim.found, float) else claim.found
        say(f"misstated: {claim.where} is {claim.stated!r:.60}, it should be {right}")
    counted = _counted(found.audit, (*_FINDINGS, "miscounted"))
    say(
        f"{found.audit.pairs_checked} pairs checked: {counted}, {len(found.misstated) + len(found.claims)} misstated"
    )
    if found.envelopes is not None:
        say(f"{_WITH_PARTS}{_counted(found.envelopes, _FINDINGS)}")
    if constraints != "overlap":
        _report_recheck(found, constraints)
    for name in found.unchecked:
        say(f"not checked: own constraint {name}")
    say(f"not checked: {', '.join(found.not_checked)}")
    verdict = "ok" if found.ok else "failed"
    say(f"{verdict}: {found.placed} items placed, {found.left_over} left over")


def _report_recheck(found: Verification, constraints: str) -> None:
    recheck = found.recheck
    for step in recheck.unstable_steps:
        say(f"unstable: the pile does not stand at step {step}")
    for step in recheck.unreachable_steps:
        say(f"unreachable: the robot cannot place step {step}")
    reach = f", {len(recheck.unreachable_steps)} unreachable" if constraints == "robot" else ""
    for step, row in found.robustness.items():
        say(f"step {step:>2} {robustness_words(row.to_details())}")
    if found.robustness:
        least = least_of(found.robustness.values())
        say(f"every step {robustness_words(least, 'min_')}")
    say(f"every step checked again: {len(recheck.unstable_steps)} unstable{reach}")


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
