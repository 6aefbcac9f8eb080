"""Executions as JSON (described in docs/execution.md)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from packenv.geometry.transforms import rotation_to_quaternion
from packenv.io.files import write_whole
from packenv.types import Leftover, Placement, Pose
from packenv.version import __version__

if TYPE_CHECKING:
    from packenv.sim.disturbance import Disturbance
    from packenv.sim.session import Execution, ExecutionConfig, ItemOutcome

SCHEMA_VERSION = 1
_UNITS = {"length": "m", "time": "s", "angle": "rad"}


def execution_to_json(
    execution: Execution,
    placements: Sequence[Placement],
    config: ExecutionConfig,
    disturbance: Disturbance | None = None,
    *,
    plan: str = "",
    plans: int | None = None,
    leftovers: Sequence[Leftover] = (),
    placed: int = 0,
) -> dict[str, Any]:
    """What physics made of a plan, as a JSON-able mapping.

    Args:
        execution: outcomes, in packing sequence.
        placements: of the plan that was carried out; after a collision, more than there are outcomes.
        config: settings of the nominal world.
        disturbance: how the world differed from it; None for the nominal world.
        plan: the plan file's name.
        plans: how many plans were looked at, in closed loop; None in open loop.
        leftovers: items that should have been placed and found no place any more; any is a failure.
        placed: items that lay there at the beginning, without outcomes.
    """
    items = [
        _item_to_json(step, outcome, placement.instance, final)
        for step, (outcome, placement, final) in enumerate(
            zip(execution.items, placements, execution.final[placed:], strict=False), start=placed + 1
        )
    ]
    means = mean_lengths(execution)
    cause: str | None = execution.cause
    detail = execution.detail
    if cause is None and leftovers:
        cause, detail = "left-over", f"{leftovers[0].item}: {leftovers[0].detail}"
    return {
        "schema_version": SCHEMA_VERSION,
        "generator": f"robotpack {__version__}",
        "units": dict(_UNITS),
        "plan": plan,
        "loop": "open" if plans is None else "closed",
        "plans": plans,
        "success": cause is None,
        "cause": cause,
        "detail": detail,
        "planned": len(placements) + len(leftovers),
        "placed": sum(not outcome.collided for outcome in execution.items),
        "drop_m": None if means is None else means[0],
        "shift_m": None if means is None else means[1],
        "simulated_s": execution.simulated_s,
        "items": items,
        "config": _config_to_json(config),
        "disturbance": None if disturbance is None else _disturbance_to_json(disturbance, config),
    }


def mean_lengths(execution: Execution) -> tuple[float, float] | None:
    """Mean drop and mean shift of the items that were released, m; None where none was."""
    released = [outcome for outcome in execution.items if not outcome.collided]
    if not released:
        return None
    count = len(released)
    return sum(o.drop_m for o in released) / count, sum(o.shift_m for o in released) / count


def write_execution(path: Path, document: Mapping[str, Any]) -> None:
    """Write what :func:`execution_to_json` made.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, (json.dumps(document, indent=1, allow_nan=False) + "\n").encode())


def _item_to_json(step: int, outcome: ItemOutcome, instance: int, final: Pose) -> dict[str, Any]:
    return {
        "step": step,
        "item": outcome.item,
        "instance": instance,
        "drop_m": outcome.drop_m,
        "shift_m": outcome.shift_m,
        "turned_rad": outcome.turned_rad,
        "settle_s": outcome.settle_s,
        "at_rest": outcome.at_rest,
        "deepest_m": outcome.deepest_m,
        "met": outcome.met,
        "collided": outcome.collided,
        "moved": [k + 1 for k in outcome.moved],
        "planned": _pose_to_json(outcome.planned),
        "measured": _pose_to_json(outcome.measured),
        "final": _pose_to_json(final),
    }


def _config_to_json(config: ExecutionConfig) -> dict[str, Any]:
    document = asdict(config)
    document["world"]["engine"] = {"name": config.world.engine.name, **document["world"]["engine"]}
    return document


def _disturbance_to_json(disturbance: Disturbance, config: ExecutionConfig) -> dict[str, Any]:
    """Ranges, and the friction that was drawn from them."""
    return {**asdict(disturbance), "drawn_mu": disturbance.config(config).world.mu}


def _pose_to_json(pose: Pose) -> dict[str, list[float]]:
    rotation, position = pose
    return {"position": position.tolist(), "quat_xyzw": rotation_to_quaternion(rotation).tolist()}
