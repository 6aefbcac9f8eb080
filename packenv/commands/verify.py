"""``robotpack verify``: audit a plan from the exact meshes."""

from __future__ import annotations

import argparse

from packenv.audit import audit_plan
from packenv.commands.loading import load_plan
from packenv.commands.output import say, say_json


def run(arguments: argparse.Namespace) -> int:
    """Audit a plan; returns the exit code."""
    plan, items = load_plan(arguments.plan, arguments.catalogue, arguments.unit)
    report = audit_plan(plan, items)
    if arguments.json:
        say_json(report.to_json())
    else:
        for line in report.lines():
            say(line)
    return 0 if report.ok else 1
