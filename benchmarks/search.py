"""What a search gives for its time: ``python -m benchmarks.search [--catalogue DIR] [--json] [--svg FILE]``.

Random orders are packed by each method, on one thread, and every better plan is noted with the CPU-seconds that it
took: ``one-pass-hm`` is HM alone, ``one-pass-best`` the best of all rules of ``auto`` in one pass each, ``auto`` these
with restarts; ``search`` searches on from there; ``separate`` and ``gls`` are by layouts; ``budget`` is search, then
``separate``, as the product does with ``--budget``. The last four have
``--seconds`` of CPU time, or as many plans as ``--plans`` says, by which rows are the same but for their times. Every
plan is audited on the exact meshes. Stopped and started again with the same ``--out``, it goes on; rows of other
settings, or of other code, are left alone.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from packenv.agents.summary import mean, proportion
from packenv.cli.exit_codes import reported
from packenv.cli.pack import options_from
from packenv.cli.parser import grid_options, planning_options
from packenv.errors import InputError
from packenv.execution.planning_job import PlanningJob
from packenv.experiments.orders import fitting, random_orders
from packenv.experiments.revision import revision
from packenv.experiments.runner import Pool, finish
from packenv.experiments.shelf import open_shelf
from packenv.geometry.prepare import PreparedItem
from packenv.io.containers import parse_container, read_boxes
from packenv.io.rows import row_key
from packenv.items.plan_maker import make_plan
from packenv.items.shelf import ItemShelf
from packenv.planning.anytime import Anytime
from packenv.planning.assembly import own_code, packer
from packenv.planning.layouts.layout_packer import LayoutPacker
from packenv.planning.options import PlanOptions
from packenv.planning.packing import Packing, Pile
from packenv.planning.planner import Planner
from packenv.planning.portfolio import Packer, goal
from packenv.planning.relay import Relay
from packenv.types import Container, Order
from packenv.verification.exact_meshes import audit_plan

METHODS: Mapping[str, Mapping[str, Any]] = {
    "one-pass-hm": {"heuristic": "hm", "restarts": 0},
    "one-pass-best": {"heuristic": "auto", "restarts": 0},
    "auto": {"heuristic": "auto"},
    "search": {"heuristic": "auto", "method": "search"},
    "budget": {"heuristic": "auto", "method": "auto"},
    "separate": {"heuristic": "auto", "method": "separate"},
    "gls": {"heuristic": "auto", "method": "gls"},
}
"""Options of each method."""
SEARCHING = ("search", "budget", "separate", "gls")
"""Methods that go on for as long as they are given."""
WARM = 6
"""Items of the plan that every method makes before anything is measured: it compiles what it needs."""


@dataclass(frozen=True)
class Job:
    """One order by one method."""

    method: str
    options: PlanOptions
    container: tuple[float, float, float]
    order: tuple[str, ...]
    meshes: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        return row_key(self, own_code(self.options))


@dataclass(eq=False)
class Trace:
    """The best packing so far, over time.

    Attributes:
        better: figures of a packing, the larger the better.
        clock: tells seconds.
        points: seconds, items placed and height (m) at every improvement.
    """

    better: Callable[[Packing], tuple[float, ...]] = goal
    clock: Callable[[], float] = time.process_time
    points: list[tuple[float, int, float]] = field(default_factory=list)
    silent: bool = False

    def __post_init__(self) -> None:
        self.began = self.clock()
        self.best: tuple[float, ...] = ()

    def tell(self, packing: Packing) -> None:
        """Note a packing if it is better than all before."""
        figures = self.better(packing)
        if not self.silent and (not self.best or figures > self.best):
            self.best = figures
            self.points.append((self.clock() - self.began, len(packing.placements), round(packing.height, 6)))


@dataclass(frozen=True, eq=False)
class TracedPlanner(Planner):
    """A planner whose packings are noted; those that it makes on the way to one are not.

    Attributes:
        trace: where.
    """

    trace: Trace = field(default_factory=Trace)

    def pack(
        self,
        sequence: Sequence[str],
        items: Mapping[str, PreparedItem],
        container: Container,
        start: Pile | None = None,
    ) -> Packing:
        """As the planner."""
        outer, self.trace.silent = self.trace.silent, True
        try:
            packing = super().pack(sequence, items, container, start)
        finally:
            self.trace.silent = outer
        self.trace.tell(packing)
        return packing


def traced(job: PlanningJob, box: Container, trace: Trace) -> Packer:
    """What packs orders as the options ask, on the trace's clock."""
    planner = job.planner(box)
    own = {name: getattr(planner, name) for name in Planner.__dataclass_fields__}
    found = packer(job.options, TracedPlanner(**own, trace=trace), job.shelf.shapes)
    hooks: dict[str, Any] = {"clock": trace.clock, "found": trace.tell}
    if isinstance(found, Relay):
        return Relay(replace(found.search, **hooks), replace(found.layouts, **hooks))
    if isinstance(found, Anytime | LayoutPacker):
        return replace(found, **hooks)
    return found


class _Worker:
    """What a worker process loads once."""

    shelf: ItemShelf
    warm: set[str]


def prepare(catalogue: str, options: PlanOptions) -> None:
    """Open the catalogue in this process."""
    _Worker.shelf, _Worker.warm = open_shelf(catalogue, options.geometry or "mesh", options.grid), set()


def packed(job: Job, order: Sequence[str], options: PlanOptions) -> tuple[Packing, Trace, float]:
    """An order's packing, its trace, and its CPU-seconds."""
    planning = PlanningJob(_Worker.shelf, options, margins=False)
    planning.load(set(order))
    sequence = planning.sequence(order)
    prepared = {name: _Worker.shelf.prepared[name] for name in order}
    trace, box = Trace(), Container(*job.container)
    with traced(planning, box, trace) as made:
        found = made.pack(sequence, prepared, box)
    trace.tell(found)
    seconds = time.process_time() - trace.began
    return found, trace, seconds


def work(job: Job) -> dict[str, Any]:
    """Pack one order, and audit the plan."""
    if job.method not in _Worker.warm:
        few = {"plans": 1} if job.method in SEARCHING else {}
        packed(job, job.order[:WARM], job.options.changed(few))
        _Worker.warm.add(job.method)
    packing, trace, seconds = packed(job, job.order, job.options)
    plan = make_plan(packing, Order.of(*job.order).lines, _Worker.shelf, job.options)
    audit = audit_plan(plan, {name: _Worker.shelf.items[name] for name in set(job.order)})
    return {
        "key": job.key,
        "method": job.method,
        "order": job.order,
        "placed": len(packing.placements),
        "whole": packing.complete,
        "height": packing.height,
        "cpu_s": seconds,
        "made_by": packing.made_by,
        "trace": trace.points,
        "overlaps": len(audit.overlaps),
        "protrusions": len(audit.protrusions),
        "blocked": len(audit.blocked),
    }


def placed_at(row: Mapping[str, Any], seconds: float) -> int:
    """Items that the best plan until then has."""
    return max((placed for at, placed, _ in row["trace"] if at <= seconds), default=0)


def curve(rows: Sequence[Mapping[str, Any]], count: int = 60) -> list[tuple[float, float, float]]:
    """Seconds, share of the items placed, and share of the orders packed whole, of one method's rows."""
    times = [at for row in rows for at, _, _ in row["trace"]]
    first, last = max(min(times), 1e-3), max(row["cpu_s"] for row in rows)
    items = sum(len(row["order"]) for row in rows)
    points = []
    for seconds in np.geomspace(first, max(last, first), count).tolist():
        placed = [placed_at(row, seconds) for row in rows]
        whole = sum(n == len(row["order"]) for n, row in zip(placed, rows, strict=True))
        points.append((seconds, sum(placed) / items, whole / len(rows)))
    return points


def summarize(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One entry for each method that has rows."""
    lines = []
    for method in METHODS:
        own = [row for row in rows if row["method"] == method and "error" not in row]
        if not own:
            continue
        lines.append(
            {
                "method": method,
                "orders": len(own),
                "whole": sum(row["whole"] for row in own),
                "whole_share": asdict(proportion(sum(row["whole"] for row in own), len(own))),
                "placed_share": asdict(mean([row["placed"] / len(row["order"]) for row in own])),
                "height_mean": statistics.fmean(row["height"] for row in own),
                "cpu_s_median": statistics.median(row["cpu_s"] for row in own),
                **{name: sum(row[name] for row in own) for name in ("overlaps", "protrusions", "blocked")},
                "curve": [[round(value, 5) for value in point] for point in curve(own)],
            }
        )
    return lines


def table(lines: Sequence[Mapping[str, Any]]) -> str:
    """The summary for people; intervals of 95 % in brackets."""
    text = [
        f"{'method':<15}{'packed whole':<23}{'items placed':<26}{'height, m':>9}{'CPU s':>9}{'overlaps':>10}"
    ]
    for line in lines:
        whole, placed = line["whole_share"], line["placed_share"]
        orders = f"{line['whole']} of {line['orders']} ({whole['low']:.0%} to {whole['high']:.0%})"
        items = f"{placed['mean']:.1%}"
        if placed["low"] is not None:
            items += f" ({placed['low']:.1%} to {placed['high']:.1%})"
        figures = f"{line['height_mean']:>9.4f}{line['cpu_s_median']:>9.2f}{line['overlaps']:>10}"
        text.append(f"{line['method']:<15}{orders:<23}{items:<26}{figures}")
    return "\n".join(text)


def draw(lines: Sequence[Mapping[str, Any]], file: Path) -> None:
    """Items placed, and orders packed whole, over the CPU-seconds of an order."""
    from matplotlib import pyplot

    figure, both = pyplot.subplots(1, 2, figsize=(9.6, 3.6), layout="constrained")
    end = max(line["curve"][-1][0] for line in lines)
    for line in lines:
        seconds = [*(at for at, _, _ in line["curve"]), end]
        for k, axes in enumerate(both, 1):
            shares = [100.0 * point[k] for point in line["curve"]]
            axes.plot(seconds, [*shares, shares[-1]], label=line["method"], drawstyle="steps-post")
    for axes, label in zip(both, ("items placed, %", "orders packed whole, %"), strict=True):
        axes.set(xlabel="CPU-seconds an order", ylabel=label, xscale="log")
        axes.grid(alpha=0.3)
    both[0].legend()
    figure.savefig(file, metadata={"Date": None})
    pyplot.close(figure)


def options_of(method: str, options: PlanOptions, seconds: float | None) -> PlanOptions:
    """The options of one method.

    Args:
        method: one of :data:`METHODS`.
        options: what is the same for all; ``plans`` is for those that search.
        seconds: for those that search.
    """
    if method in SEARCHING:
        return options.changed({**METHODS[method], "budget": seconds})
    return options.changed({**METHODS[method], "plans": None, "budget": None})


def main() -> int:
    """Run, resume, print the summary; exit code 1 where a plan failed its audit or a job its run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--container", default="0.32x0.32x0.30")
    parser.add_argument("--size", type=int, default=22, help="items of an order (default: %(default)s)")
    parser.add_argument("--orders", type=int, default=50, help="how many (default: %(default)s)")
    parser.add_argument(
        "--seconds", type=float, help="CPU-seconds of a search (default: 10, or none where plans are given)"
    )
    parser.add_argument("--methods", nargs="+", choices=tuple(METHODS), default=list(METHODS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--out", type=Path, default=Path("runs/search.jsonl"), help="rows (default: %(default)s)"
    )
    parser.add_argument("--svg", type=Path, help="draw the curves into this file")
    parser.add_argument("--json", action="store_true", help="JSON only, no table")
    planning_options(parser, without=("heuristic", "method", "budget", "seed"))
    grid_options(parser)
    parser.set_defaults(constraints="overlap")
    arguments = parser.parse_args()
    options = options_from(arguments)
    if options.asks_physics:
        raise InputError("benchmarks.search: measures plans without physics, leave stability physics out")
    seconds = 10.0 if arguments.seconds is None and options.plans is None else arguments.seconds
    box = parse_container(arguments.container, read_boxes())
    prepare(arguments.catalogue, options)
    shelf = _Worker.shelf
    names = sorted(fitting(shelf.prepared, box, options.grid))
    jobs = [
        Job(
            method,
            options_of(method, options, seconds),
            box.size,
            tuple(order),
            tuple(shelf.items[name].sha256[:16] for name in order),
        )
        for order in random_orders(names, arguments.size, arguments.orders, arguments.seed)
        for method in arguments.methods
    ]
    found = finish(
        work,
        jobs,
        out=arguments.out,
        pool=Pool("pebble" if arguments.workers > 1 else "serial", arguments.workers),
        revision=revision(work),
        timeout=3600.0 + 10.0 * (seconds or 0.0),
        prepare=prepare,
        arguments=(arguments.catalogue, options),
    )
    lines = summarize(found.rows)
    if arguments.svg and lines:
        draw(lines, arguments.svg)
    report = {
        "catalogue": arguments.catalogue,
        "container": box.label,
        "items": arguments.size,
        "seconds": seconds,
        "constraints": options.constraints,
        "methods": lines,
        "failed_jobs": list(found.broken),
    }
    print(json.dumps(report, indent=1) if arguments.json else table(lines))
    for row in found.broken:
        print(f"search: {row['error']}", file=sys.stderr)
    return (
        1
        if found.broken or any(line["overlaps"] + line["protrusions"] + line["blocked"] for line in lines)
        else 0
    )


if __name__ == "__main__":
    sys.exit(reported("benchmarks.search", main))
