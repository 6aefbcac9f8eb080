"""Fill a box from a stream of items: ``python -m benchmarks.fill [--catalogue DIR] [--json]``.

Items come in a random sequence, drawn with repetition; the first few that are left, the *buffer*, can be chosen from.
Each of them is tried at its stable poses on the pile as it is; the one that wastes least room for its volume is
placed (:func:`waste`), and the next of the sequence comes into the buffer. It ends when nothing of the buffer has a
place.

``geometry`` asks for no overlap, ``stable`` also for force balance, ``robot`` also for a way of the arm. Utilization is
the volume of the placed items as a share of the box's, compactness as a share of the box's up to the pile's top.
Stopped and started again with the same ``--out``, it goes on.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from packenv.cli.exit_codes import reported
from packenv.cli.pack import options_from
from packenv.cli.parser import grid_options, planning_options
from packenv.errors import InputError
from packenv.execution.planning_job import PlanningJob
from packenv.experiments.orders import fitting
from packenv.experiments.revision import revision
from packenv.experiments.runner import Pool, finish
from packenv.experiments.shelf import open_shelf
from packenv.geometry.prepare import PreparedItem
from packenv.io.containers import parse_container, read_boxes
from packenv.io.rows import row_key
from packenv.items.shelf import ItemShelf
from packenv.planning.assembly import own_code
from packenv.planning.options import PlanOptions
from packenv.planning.packing import Pile
from packenv.planning.packing_pass import PackingPass, PassRules
from packenv.planning.sequence import Piece
from packenv.planning.trails import on_stable_poses
from packenv.types import Container, Placement

MODES = {"geometry": "overlap", "stable": "stability", "robot": "robot"}
"""The level of constraints of each mode."""
FIGURES = ("utilization", "compactness", "items", "cpu_s")
"""What is measured, besides the mode and the buffer."""
ITEMS = 80
"""Of a sequence: more than a box takes."""


@dataclass(frozen=True)
class Job:
    """One sequence with one buffer in one mode."""

    mode: str
    buffer: int
    options: PlanOptions
    container: tuple[float, float, float]
    sequence: tuple[str, ...]
    meshes: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        return row_key(self, own_code(self.options))


@dataclass(frozen=True, eq=False)
class Step:
    """An item at its place on a pile.

    Attributes:
        item: prepared.
        placement: where it lies.
        before: the pile without it.
        pile: the pile with it.
    """

    item: PreparedItem
    placement: Placement
    before: Pile
    pile: Pile


def waste(step: Step) -> float:
    """Room under the pile's surface that a placement fills with something else than the item, by the item's volume.

    Of the items of a buffer the one of which it is least is placed.
    """
    surface = step.pile.surface
    raised = (surface.total - step.before.surface.total) * surface.cell_size**2
    return raised / step.item.volume - 1.0


def fill(
    rules: PassRules,
    items: Mapping[str, PreparedItem],
    container: Container,
    sequence: Sequence[str],
    buffer: int,
    cost: Callable[[Step], float] = waste,
) -> list[Placement]:
    """Place items out of a buffer until nothing of it has a place.

    Args:
        rules: how an item is placed on a pile.
        items: by name.
        container: the box, empty.
        sequence: names of the items that come.
        buffer: how many of them can be chosen from.
        cost: of a placement; that of least is made.
    """
    left, pile, placements = list(sequence), None, []
    while left:
        steps: list[Step] = []
        for name in dict.fromkeys(left[:buffer]):
            run = PackingPass(rules, items, container, pile)
            before = run.pile
            admitted = rules.admission.refusal(name, before.held, container) is None
            if admitted and run.first_pass(Piece(name, 1 + sum(p.item == name for p in placements))) is None:
                held = rules.admission.with_item(before.held, name)
                steps.append(Step(items[name], run.placements[0], before, replace(run.pile, held=held)))
        if not steps:
            break
        best = min(steps, key=cost)
        placements.append(best.placement)
        pile = best.pile
        left.remove(best.placement.item)
    return placements


def sequences(names: Sequence[str], size: int, count: int, seed: int) -> list[tuple[str, ...]]:
    """``count`` sequences of ``size`` items, drawn with repetition; the same seed gives the same ones."""
    rng = np.random.default_rng([seed, size])
    return [tuple(str(name) for name in rng.choice(list(names), size)) for _ in range(count)]


class _Worker:
    """What a worker process loads once."""

    shelf: ItemShelf
    warm: set[str]


def prepare(catalogue: str, options: PlanOptions) -> None:
    """Open the catalogue in this process."""
    _Worker.shelf, _Worker.warm = open_shelf(catalogue, options.geometry or "mesh", options.grid), set()


def work(job: Job) -> dict[str, Any]:
    """Fill one box."""
    planning = PlanningJob(_Worker.shelf, job.options, margins=False)
    planning.load(set(job.sequence))
    box, items = Container(*job.container), {name: _Worker.shelf.prepared[name] for name in job.sequence}
    with planning.planner(box) as planner:
        rules = on_stable_poses(planner)
        if job.mode not in _Worker.warm:  # compiled before it is measured
            fill(rules, items, box, job.sequence[:4], 1)
            _Worker.warm.add(job.mode)
        start = time.process_time()
        placements = fill(rules, items, box, job.sequence, job.buffer)
        seconds = time.process_time() - start
    volume = sum(items[p.item].volume for p in placements)
    top = max((float(p.corner[2] + p.extents[2]) for p in placements), default=0.0)
    return {
        "key": job.key,
        "mode": job.mode,
        "buffer": job.buffer,
        "utilization": volume / box.volume,
        "compactness": volume / (box.volume / box.height * top) if placements else 0.0,
        "items": len(placements),
        "cpu_s": seconds,
        "height": top,
        "used_up": len(placements) == len(job.sequence),
    }


def summarize(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, dict[str, float]]]:
    """Means over the sequences, by mode and buffer."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    done = [row for row in rows if "error" not in row]
    for mode, buffer in sorted({(row["mode"], row["buffer"]) for row in done}):
        own = [row for row in done if (row["mode"], row["buffer"]) == (mode, buffer)]
        found.setdefault(mode, {})[str(buffer)] = {
            name: statistics.fmean(row[name] for row in own) for name in FIGURES
        }
    return found


def main() -> int:
    """Run, resume, print the summary."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--container", default="0.32x0.32x0.30")
    parser.add_argument("--sequences", type=int, default=10, help="how many (default: %(default)s)")
    parser.add_argument("--items", type=int, default=ITEMS, help="of a sequence (default: %(default)s)")
    parser.add_argument("--buffers", type=int, nargs="+", default=[1, 3, 5, 10])
    parser.add_argument("--modes", nargs="+", choices=tuple(MODES), default=list(MODES))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--out", type=Path, default=Path("runs/fill.jsonl"), help="rows (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="JSON only, no table")
    planning_options(
        parser, without=("constraints", "method", "sequence", "restarts", "budget", "plans", "goal", "seed")
    )
    grid_options(parser)
    parser.set_defaults(heuristic="minz")
    arguments = parser.parse_args()
    options = options_from(arguments)
    if options.asks_physics:
        raise InputError("benchmarks.fill: fills boxes without physics, leave stability physics out")
    if min(arguments.buffers) < 1:
        raise InputError(f"--buffers {min(arguments.buffers)}: is no buffer, give at least 1")
    box = parse_container(arguments.container, read_boxes())
    prepare(arguments.catalogue, options)
    shelf = _Worker.shelf
    names = sorted(fitting(shelf.prepared, box, options.grid))
    jobs = [
        Job(
            mode,
            buffer,
            options.changed({"constraints": MODES[mode]}),
            box.size,
            sequence,
            tuple(shelf.items[name].sha256[:16] for name in sequence),
        )
        for sequence in sequences(names, arguments.items, arguments.sequences, arguments.seed)
        for mode in arguments.modes
        for buffer in dict.fromkeys(arguments.buffers)
    ]
    found = finish(
        work,
        jobs,
        out=arguments.out,
        pool=Pool("pebble" if arguments.workers > 1 else "serial", arguments.workers),
        revision=revision(work),
        timeout=3600.0,
        prepare=prepare,
        arguments=(arguments.catalogue, options),
    )
    report = {
        "catalogue": arguments.catalogue,
        "container": box.label,
        "sequences": arguments.sequences,
        "modes": summarize(found.rows),
        "failed_jobs": list(found.broken),
    }
    if arguments.json:
        print(json.dumps(report, indent=1))
    else:
        print(f"{'mode':<10}{'buffer':>6}{'utilization':>13}{'compactness':>13}{'items':>7}{'CPU s':>9}")
        for mode, buffers in summarize(found.rows).items():
            for buffer, line in buffers.items():
                print(
                    f"{mode:<10}{buffer:>6}{line['utilization']:>13.1%}{line['compactness']:>13.1%}"
                    f"{line['items']:>7.1f}{line['cpu_s']:>9.2f}"
                )
    for row in found.broken:
        print(f"fill: {row['error']}", file=sys.stderr)
    return 1 if found.broken else 0


if __name__ == "__main__":
    sys.exit(reported("benchmarks.fill", main))
