"""``robotpack export``: a plan's motions for a robot."""

from __future__ import annotations

import argparse

from packenv.cli.output import Terminal, say
from packenv.execution.trajectories import trajectories
from packenv.io.files import check_outputs
from packenv.items.plan_items import open_plan
from packenv.robot.timing import MotionLimits
from packenv.view.show import check_suffix


def run(arguments: argparse.Namespace) -> int:
    """Write the file; returns the exit code: 1 where a step has no motion."""
    limits = MotionLimits(share=arguments.share, speed=arguments.speed)
    plan, shelf = open_plan(arguments.plan, arguments.catalogue, unit=arguments.unit)
    check_outputs({"--out": arguments.out}, [arguments.plan, *shelf.catalogue.files])
    check_suffix(arguments.out, "--out", (".json", ""))
    found = trajectories(plan, shelf, limits=limits, watcher=Terminal())
    found.save(arguments.out)
    for step in found.steps:
        if step.problem is not None:
            say(f"no motion: step {step.step} ({step.item}): {step.problem}")
    moved = sum(step.motion is not None for step in found.steps)
    say(f"{moved} of {len(found.steps)} steps have a motion: {found.duration:.1f} s")
    say(f"wrote {arguments.out}")
    return 0 if found.ok else 1
