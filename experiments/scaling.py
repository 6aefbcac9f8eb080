"""How long a run takes on so many workers: ``python -m packenv.experiments.scaling RUNFOLDER... --orders 1000``.

The times of jobs come from the rows of runs, drawn again (bootstrap) for as many orders as are asked for; the queue is
simulated event by event. Two ways to share the work out are compared: one queue, from which a worker takes its next
job when it is free, and shards, the orders of which are fixed (``--shard I/N``) and which know nothing of each other.
"""

from __future__ import annotations

import argparse
import heapq
import json
import random
import statistics
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeAlias

from packenv.cli.exit_codes import reported
from packenv.errors import InputError
from packenv.io.files import write_whole
from packenv.io.rows import read_rows

WORKERS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1000, 2048, 4096)
WORTH = 0.5
"""Efficiency below which more workers are not worth their time."""
GROUP = ("method", "constraints", "setting", "items")
"""Fields of a row that say of which kind a job is."""

Kind: TypeAlias = tuple[str, ...]
Order: TypeAlias = tuple[float, ...]
"""Seconds of the jobs of one order, one of each kind."""


@dataclass(frozen=True)
class Costs:
    """What a run takes beside its jobs, s; the defaults are Ray's, as :mod:`benchmarks.backends` measures them.

    Attributes:
        begin: of the driver before the first job: imports, the catalogue, drawing the orders. A shard does this, too.
        start: of a worker from its start to its first job: imports, the catalogue, kernels from the cache.
        row: of the driver for each job: it takes the outcome, writes the row and waits for the disk (fsync), and hands
            the next job over. One job after another.
        wait: of a worker between two jobs beside that: messages.
    """

    begin: float = 1.5
    start: float = 2.0
    row: float = 0.005
    wait: float = 0.0025


@dataclass(frozen=True)
class Estimate:
    """A run on so many workers.

    Attributes:
        workers: how many, or how many shards.
        wall_s: from its start to its last row.
        machine_s: workers are paid for: in a queue all to the end, in shards each to its own end.
        efficiency: share of that which goes into jobs.
    """

    workers: int
    wall_s: float
    machine_s: float
    efficiency: float


def queue(times: Sequence[float], workers: int, costs: Costs) -> Estimate:
    """One queue: whoever is free takes the next job (list scheduling).

    Args:
        times: seconds of each job, in the sequence of the queue.
        workers: how many take jobs.
        costs: what else takes time.
    """
    ready = costs.begin + costs.start
    busy: list[float] = []  # when workers end the jobs that they are at
    driver = ready
    for seconds in times:
        if len(busy) < workers:
            heapq.heappush(busy, ready + seconds)
            continue
        ended = heapq.heappop(busy)
        driver = max(driver, ended) + costs.row
        heapq.heappush(busy, driver + costs.wait + seconds)
    for ended in sorted(busy):
        driver = max(driver, ended) + costs.row
    return _estimate(times, workers, driver, workers * driver)


def shards(orders: Sequence[Order], count: int, costs: Costs) -> Estimate:
    """A process for each shard: it does the orders whose index is its own modulo the number of shards.

    Args:
        orders: seconds of each order's jobs.
        count: number of shards.
        costs: what else takes time.
    """
    ends = [
        costs.begin + costs.start + sum(sum(order) + costs.row * len(order) for order in orders[k::count])
        for k in range(count)
    ]
    return _estimate([t for order in orders for t in order], count, max(ends), sum(ends))


def least_wall(times: Sequence[float], workers: int) -> float:
    """Seconds that no sharing out goes below: the longest job, and the mean load of a worker."""
    return max(max(times, default=0.0), sum(times) / workers)


def _estimate(times: Sequence[float], workers: int, wall: float, machine: float) -> Estimate:
    return Estimate(workers, wall, machine, sum(times) / machine if machine else 1.0)


def job_times(folders: Iterable[Path]) -> dict[Kind, list[float]]:
    """Seconds of jobs by their kind, from the rows of runs.

    Args:
        folders: of runs; each ``*.jsonl`` file in them is read. Of a job's rows the last one counts.

    Raises:
        InputError: there is no row of a job that went well.
    """
    folders = list(folders)
    times: dict[Kind, dict[str, float]] = defaultdict(dict)
    for folder in folders:
        for path in sorted(folder.glob("*.jsonl")):
            for row in read_rows(path):
                if row.get("status") == "ok":
                    kind = (path.stem.partition(".")[0], *(str(row.get(name, "")) for name in GROUP))
                    times[kind][row["key"]] = float(row["seconds"])
    if not times:
        named = ", ".join(map(str, folders))
        raise InputError(
            f"{named}: no row of a job that went well, give folders of runs (robotpack bench --out)"
        )
    return {kind: list(of.values()) for kind, of in times.items()}


def drawn(
    times: Mapping[Kind, Sequence[float]], orders: int, *, seed: int = 0, scale: float = 1.0
) -> list[Order]:
    """Orders with a job of each kind, whose seconds are drawn from the measured ones.

    Args:
        times: seconds of jobs by their kind.
        orders: how many.
        seed: of the draw.
        scale: they are multiplied by this.
    """
    chance = random.Random(seed)
    return [tuple(scale * chance.choice(measured) for measured in times.values()) for _ in range(orders)]


def simulate(orders: Sequence[Order], costs: Costs, workers: Sequence[int] = WORKERS) -> dict[str, Any]:
    """Wall time, machine time and efficiency by the number of workers, for each way to share the work out.

    Args:
        orders: seconds of each order's jobs.
        costs: what else takes time.
        workers: the numbers of workers.
    """
    times = [seconds for order in orders for seconds in order]
    ways = {
        "queue": [queue(times, n, costs) for n in workers],
        "longest_first": [queue(sorted(times, reverse=True), n, costs) for n in workers],
        "shards": [shards(orders, n, costs) for n in workers if n <= len(orders)],
    }
    return {
        "orders": len(orders),
        "jobs": len(times),
        "jobs_s": sum(times),
        "longest_s": max(times, default=0.0),
        "costs": asdict(costs),
        "least_wall_s": [least_wall(times, n) for n in workers],
        "worth": {way: worth(found) for way, found in ways.items()},
        **{way: [asdict(estimate) for estimate in found] for way, found in ways.items()},
    }


def worth(estimates: Sequence[Estimate]) -> int:
    """The most workers of which at least half of the time goes into jobs; 0: not even of one."""
    return max((e.workers for e in estimates if e.efficiency >= WORTH), default=0)


def curve_svg(found: Mapping[str, Any]) -> str:
    """Wall time over workers, both logarithmic, as an SVG picture.

    Raises:
        InputError: matplotlib is not installed.
    """
    import io

    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ModuleNotFoundError:
        raise InputError("--svg needs matplotlib: pip install 'robotpack[bench]'") from None
    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.add_subplot(
        xscale="log", yscale="log", xlabel="workers, or shards", ylabel="wall time, s", title=_headline(found)
    )
    for way, style in (("queue", "o-"), ("longest_first", ".-"), ("shards", "s--")):
        points = found[way]
        axes.plot([p["workers"] for p in points], [p["wall_s"] for p in points], style, label=_name(way))
    several = [p["workers"] for p in found["queue"]]
    axes.plot(several, found["least_wall_s"], ":", color="#777777", label="no way is below")
    axes.grid(alpha=0.3)
    axes.legend()
    stream = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "robotpack"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()


def _headline(found: Mapping[str, Any]) -> str:
    hours = found["jobs_s"] / 3600
    return f"{found['orders']:,} orders, {found['jobs']:,} jobs, {hours:.2f} hours, longest {found['longest_s']:.1f} s"


def _name(way: str) -> str:
    return way.replace("_", " ")


def table(found: Mapping[str, Any]) -> str:
    """The simulation as text."""
    lines = [_headline(found), "workers  " + "  ".join(f"{_name(w):>24}" for w in found["worth"])]
    by_workers: dict[int, dict[str, Mapping[str, Any]]] = defaultdict(dict)
    for way in found["worth"]:
        for point in found[way]:
            by_workers[point["workers"]][way] = point
    for workers, points in by_workers.items():
        cells = (_cell(points.get(way)) for way in found["worth"])
        lines.append(f"{workers:>7}  " + "  ".join(f"{cell:>24}" for cell in cells))
    told = ", ".join(f"{n} ({_name(way)})" for way, n in found["worth"].items())
    lines.append(f"At least half of the time goes into jobs up to so many workers: {told}.")
    return "\n".join(lines)


def _cell(point: Mapping[str, Any] | None) -> str:
    if point is None:
        return "-"
    return f"{point['wall_s']:.0f} s, {point['machine_s'] / 3600:.2f} h, {100 * point['efficiency']:.0f} %"


def main() -> int:
    """Read rows, simulate, print."""
    usual = Costs()
    parser = argparse.ArgumentParser(prog="scaling", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="RUNFOLDER")
    parser.add_argument(
        "--orders", type=int, default=1000, help="so many of each kind of job (default: 1000)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the draw of times (default: 0)")
    parser.add_argument(
        "--scale",
        type=float,
        default=1.0,
        metavar="F",
        help="multiply the times of jobs by this, for faster cores or where the measuring machine was shared",
    )
    for name, value in asdict(usual).items():
        parser.add_argument(f"--{name}", type=float, default=value, help=f"seconds (default: {value:g})")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--svg", type=Path, help="draw wall times into this file")
    given = parser.parse_args()
    if given.orders < 1:
        raise InputError(f"--orders is {given.orders}, give 1 or more")
    costs = Costs(given.begin, given.start, given.row, given.wait)
    if min(asdict(costs).values()) < 0:
        raise InputError("--begin, --start, --row and --wait are seconds, give 0 or more")
    if not given.scale > 0:
        raise InputError(f"--scale is {given.scale:g}, give a number above 0")
    times = job_times(given.folders)
    found = simulate(drawn(times, given.orders, seed=given.seed, scale=given.scale), costs)
    found["kinds"] = [
        {
            **dict(zip(("rows", *GROUP), kind, strict=True)),
            "n": len(of),
            "mean_s": statistics.mean(of),
            "max_s": max(of),
        }
        for kind, of in times.items()
    ]
    if given.svg:
        write_whole(given.svg, curve_svg(found).encode())
    print(json.dumps(found, indent=1) if given.json else table(found))  # noqa: T201
    return 0


if __name__ == "__main__":
    import sys

    sys.exit(reported("packenv.experiments.scaling", main))
