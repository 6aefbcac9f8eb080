"""What there is to see of an execution: measured poses, and the plan's beside them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from packenv.io.executions import mean_lengths
from packenv.types import Item, Plan, Pose
from packenv.view.scene import Scene, build_scene

if TYPE_CHECKING:
    from packenv.sim.session import Execution, ItemOutcome


def executed_scene(plan: Plan, items: Mapping[str, Item], execution: Execution, placed: int = 0) -> Scene:
    """The scene of a plan with what physics made of it.

    Args:
        plan: what was carried out.
        items: the plan's items by name.
        execution: outcomes and final poses, in the plan's sequence; after a collision, fewer than planned.
        placed: items that lay there at the beginning, without outcomes.

    Returns:
        The scene of the plan, without heightmaps, with measured poses at the end of the execution.
    """
    outcomes = execution.items
    unplaced: dict[str, object] = {"Execution": "not placed: the robot had stopped"}
    figures: list[dict[str, object]] = [{"Execution": "lay there at the beginning"}] * placed
    figures += [_figures(o, items[o.item], execution, k) for k, o in enumerate(outcomes, start=placed)]
    figures += [unplaced] * (len(plan.placements) - len(figures))
    scene = build_scene(plan, items, extra_figures=figures)
    poses = [*execution.final, *[None] * (len(plan.placements) - len(execution.final))]
    steps = tuple(
        replace(step, figures=_first(extra, step.figures), measured=pose)
        for step, extra, pose in zip(scene.steps, figures, poses, strict=True)
    )
    return replace(scene, steps=steps, verdict=_verdict(execution), title=f"Execution: {scene.title}")


def _first(first: Mapping[str, object], figures: Mapping[str, object]) -> dict[str, object]:
    """Figures with some of them before all others."""
    return {**first, **figures}


def _figures(outcome: ItemOutcome, item: Item, execution: Execution, k: int) -> dict[str, object]:
    figures: dict[str, object] = {}
    if outcome.collided:
        figures["Execution"] = execution.detail
    else:
        figures["Drop"] = f"{outcome.drop_m * 1e3:.1f} mm"
        figures["Shift"] = f"{outcome.shift_m * 1e3:.1f} mm"
        figures["Turned"] = f"{math.degrees(outcome.turned_rad):.1f}°"
        figures["At rest"] = (
            f"after {outcome.settle_s:.2f} s" if outcome.at_rest else f"not within {outcome.settle_s:.0f} s"
        )
        later = _travel(item, outcome.measured, execution.final[k])
        if later >= 5e-4:
            figures["Moved later"] = f"{later * 1e3:.1f} mm"
    if outcome.deepest_m is not None:
        figures["Deepest contact"] = f"{outcome.deepest_m * 1e3:.2f} mm, {outcome.met}"
    if outcome.moved:
        figures["Displaced steps"] = [m + 1 for m in outcome.moved]
    return figures


def _travel(item: Item, a: Pose, b: Pose) -> float:
    """How far the centre of mass is between two poses, m."""
    return float(np.linalg.norm(a[0] @ item.com + a[1] - b[0] @ item.com - b[1]))


def _verdict(execution: Execution) -> tuple[tuple[str, str], ...]:
    result = "success" if execution.success else f"{execution.cause}: {execution.detail}"
    figures = [("Execution", result)]
    means = mean_lengths(execution)
    if means is not None:
        figures += [(n, f"{m * 100:.2f} cm") for n, m in zip(("Drop", "Shift"), means, strict=True)]
    return tuple(figures)
