"""Whether what a plan says that its piles withstand tells which executions succeed.

``python -m experiments.robustness --catalogue DIR --orders 24``: random orders, planned without and with a clearance,
are carried out in the nominal world and in disturbed ones, with guarded moves and without. For each figure, the least
over the steps of a plan, it prints the share of executions that succeed in the lower, middle and upper third of the
plans, and how often a plan that succeeds has more than one that fails: 0.5 where the figure says nothing, 1 where it
says all. Stopped and started again with the same ``--out``, it goes on.
"""

from __future__ import annotations

import itertools
import json
import statistics
import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from packenv.cli.exit_codes import reported
from packenv.config import EngineName
from packenv.execution.execute import execute
from packenv.io.rows import row_key
from packenv.planning.options import PlanOptions
from packenv.planning.robustness import least_of, measure_robustness

from .physics_orders import GRID, Worker, drawn_orders, options, prepare
from .plan_store import fingerprints
from .runner import finish, product_code

CLEARANCES = (0.0, 0.005)
"""M."""


@dataclass(frozen=True)
class Job:
    """One plan in one world.

    Attributes:
        order: item names.
        items: hashes of theirs.
        clearance: of the plan, m.
        feel: the robot feels contacts.
        world: seed of a disturbed world; None is the nominal one.
        engine: of the physics.
    """

    order: tuple[str, ...]
    items: tuple[str, ...]
    clearance: float
    feel: bool
    world: int | None
    engine: EngineName

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        return row_key(product_code(), GRID, self)


def work(job: Job) -> dict[str, Any]:
    """Plan, measure, carry out."""
    chosen = PlanOptions("hm", clearance=job.clearance, geometry="parts")
    plan = Worker.store.plan(job.order, chosen).plan
    row: dict[str, Any] = {"key": job.key, "planned": plan.complete}
    if plan.complete:
        shelf = Worker.store.shelf
        least = least_of(measure_robustness(plan, shelf.shapes, shelf.fields, chosen).values())
        done = execute(plan, shelf, feel=job.feel, disturb=job.world, engine=job.engine)
        way = "guarded" if job.feel else "open loop"
        world = "nominal" if job.world is None else "disturbed"
        row |= {"clearance_m": job.clearance, "way": way, "world": world, "success": done.success, **least}
    return row


def summarize(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """By way, world and clearance, and for all clearances: success, and what each figure tells of it."""
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        if row.get("planned"):
            for clearance in (f"{row['clearance_m'] * 1e3:g} mm", "all"):
                groups[f"{row['way']}, {row['world']}, {clearance}"].append(row)
    return {
        name: {
            "n": len(group),
            "success": statistics.mean(row["success"] for row in group),
            **{
                figure: told([row[f"min_{figure}"] for row in group], [row["success"] for row in group])
                for figure in ("tilt_deg", "push", "offset_m")
            },
        }
        for name, group in sorted(groups.items())
    }


def told(figures: Sequence[float], successes: Sequence[bool]) -> dict[str, Any]:
    """What a figure tells of success.

    Args:
        figures: of each execution.
        successes: of each.

    Returns:
        ``thirds``: success in the third with the least figures, in the middle and in the upper one. ``more``: how
        often one that succeeds has more than one that fails, ties by half; None where all or none succeed.
        ``zero`` and ``above``: successes and executions where the figure is 0, and where it is more.
    """
    good = np.array(successes, dtype=bool)
    values = np.array(figures)
    thirds = np.array_split(good[np.argsort(values, kind="stable")], 3)
    higher, lower = values[good][:, None], values[~good]
    pairs = (higher > lower) + 0.5 * (higher == lower)
    return {
        "thirds": [float(third.mean()) if len(third) else None for third in thirds],
        "more": float(pairs.mean()) if pairs.size else None,
        "zero": [int(good[values == 0.0].sum()), int((values == 0.0).sum())],
        "above": [int(good[values > 0.0].sum()), int((values > 0.0).sum())],
    }


def main() -> int:
    """Run, resume, print the table."""
    parser = options((__doc__ or "").splitlines()[0], orders=24, out="runs/robustness.jsonl")
    parser.add_argument("--worlds", type=int, default=2, help="disturbed worlds (default: %(default)s)")
    parser.add_argument("--engine", choices=get_args(EngineName), default="auto")
    arguments = parser.parse_args()
    prepare(arguments.catalogue, arguments.plans)
    shapes = Worker.store.shelf.shapes
    worlds = (None, *range(1000, 1000 + arguments.worlds))
    ways = list(itertools.product(worlds, CLEARANCES, (True, False)))
    orders = [tuple(order) for order in drawn_orders(arguments)]
    jobs = [
        Job(order, fingerprints(shapes, order), clearance, feel, world, arguments.engine)
        for world, clearance, feel in ways
        for order in orders
    ]
    done, failed = finish(
        work,
        jobs,
        out=arguments.out,
        workers=arguments.workers,
        timeout=600,
        prepare=prepare,
        arguments=(arguments.catalogue, arguments.plans),
    )
    print(json.dumps({"figures": summarize(done), "failed_jobs": failed}, indent=1))  # noqa: T201
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(reported("experiments.robustness", main))
