"""Balance of large piles against CVXPY: ``python -m benchmarks.large_piles [--catalogue DIR] [--json]``.

Random orders are planned under force balance; of each plan, piles of so many of its first items are asked about in
three ways: as they were planned (``planned``), with the newest item thirty times as heavy (``heavy``), and with less
friction than was planned with (``slippery``), which all shortcuts of the checker are no help for. Each question goes to
:class:`packenv.planning.stability.checker.StabilityChecker` as a plan asks it, with the forces of the pile before, and
to CVXPY, which builds its program from the contacts alone and asks Clarabel first: the checker asks HiGHS.

Stopped and started again with the same ``--out``, it goes on.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from packenv.cli.exit_codes import reported
from packenv.execution.planning_job import PlanningJob
from packenv.experiments.orders import fitting, random_orders
from packenv.experiments.revision import revision
from packenv.experiments.runner import Pool, finish
from packenv.experiments.shelf import open_shelf
from packenv.io.containers import parse_container, read_boxes
from packenv.io.rows import row_key
from packenv.items.shelf import ItemShelf
from packenv.planning.options import PlanOptions
from packenv.planning.stability.checker import StabilityChecker, StabilityResult
from packenv.planning.stability.contact_patches import thin
from packenv.planning.stability.contacts import Body, item_contacts, join
from packenv.planning.stability.solvers import solve_cvxpy
from packenv.types import Contacts, Container, FloatArray, Placement

OPTIONS = PlanOptions("minz", constraints="stability", restarts=0)
"""How the piles are planned."""

HEAVY = 30.0
"""How many times as heavy the newest item is where it is heavy."""

SLIPPERY = 0.35
"""Coefficient of friction where it is slippery: half of what is planned with."""

WAYS = ("planned", "heavy", "slippery")


@dataclass(frozen=True)
class Job:
    """The piles of one order.

    Attributes:
        container: inner size, m.
        order: names of the items.
        sizes: how many items the piles have that are asked about.
        meshes: digests of the items.
    """

    container: tuple[float, float, float]
    order: tuple[str, ...]
    sizes: tuple[int, ...]
    meshes: tuple[str, ...]

    @property
    def key(self) -> str:
        """Hash of all that the row depends on."""
        return row_key(self)


@dataclass(frozen=True, eq=False)
class PileOf:
    """A pile that a plan went through.

    Attributes:
        contacts: thinned.
        masses: (n,) kg, the newest item last.
        coms: (n, 3) m.
    """

    contacts: Contacts
    masses: FloatArray
    coms: FloatArray


def piles(placements: Sequence[Placement], shelf: ItemShelf, container: Container) -> Iterator[PileOf]:
    """The pile after each placement, the contacts as the planner's constraint finds them."""
    bodies: list[Body] = []
    found: list[Contacts] = []
    for p in placements:
        bodies.append(Body(shelf.fields[p.item], p.rotation, p.position))
        found.append(thin(item_contacts(bodies[-1], bodies[:-1], container, index=len(bodies))))
        placed = placements[: len(bodies)]
        yield PileOf(
            join([part for part in found if len(part)]),
            np.array([shelf.items[q.item].mass for q in placed]),
            np.array([q.rotation @ shelf.items[q.item].com + q.position for q in placed]),
        )


def asked(pile: PileOf, way: str, before: StabilityResult | None) -> dict[str, Any]:
    """What the checker and CVXPY say of a pile, and the CPU-milliseconds of each."""
    checker = StabilityChecker(mu=SLIPPERY) if way == "slippery" else StabilityChecker()
    masses = pile.masses.copy()
    if way == "heavy":
        masses[-1] *= HEAVY
    previous = None if way == "slippery" else before
    start = time.process_time()
    ours = checker.check(pile.contacts, masses, pile.coms, previous=previous)
    middle = time.process_time()
    theirs = solve_cvxpy(checker.build(pile.contacts, masses, pile.coms, None), first="CLARABEL")
    return {
        "items": len(masses),
        "way": way,
        "contacts": len(pile.contacts),
        "stable": ours.stable,
        "decided_by": ours.decided_by,
        "cvxpy": theirs.status,
        "solver": theirs.solver,
        "check_ms": 1e3 * (middle - start),
        "cvxpy_ms": 1e3 * (time.process_time() - middle),
    }


class _Worker:
    """What a process reads once."""

    shelf: ItemShelf


def prepare(catalogue: str) -> None:
    """Read the catalogue."""
    _Worker.shelf = open_shelf(catalogue, grid=OPTIONS.grid)


def work(job: Job) -> dict[str, Any]:
    """The row of an order."""
    box, shelf = Container(*job.container), _Worker.shelf
    planning = PlanningJob(shelf, OPTIONS, margins=False)
    planning.load(set(job.order))
    placements = planning.pack(box, planning.sequence(list(job.order))).placements
    answers = []
    before: StabilityResult | None = None
    for pile in piles(placements, shelf, box):
        if len(pile.masses) in job.sizes:
            answers += [asked(pile, way, before) for way in WAYS]
        result = StabilityChecker().check(pile.contacts, pile.masses, pile.coms, previous=before)
        before = result if result.stable else None
    return {"key": job.key, "placed": len(placements), "answers": answers}


def summarize(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How often the two agree, by way and altogether; what CVXPY leaves open is told apart."""
    answers = [answer for row in rows for answer in row.get("answers", ())]

    def summary(some: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        told = [a for a in some if a["cvxpy"] != "undecided"]
        return {
            "questions": len(some),
            "stable": sum(a["stable"] for a in some),
            "agree": sum(a["stable"] == (a["cvxpy"] == "stable") for a in told),
            "cvxpy_undecided": len(some) - len(told),
            "by_clarabel": sum(a["solver"] == "cvxpy/CLARABEL" for a in told),
            "of_the_whole_pile": sum(a["decided_by"] == "pile" for a in some),
            "check_ms": _spread([a["check_ms"] for a in some]),
            "cvxpy_ms": _spread([a["cvxpy_ms"] for a in some]),
        }

    by_way = {way: summary([a for a in answers if a["way"] == way]) for way in WAYS}
    return {**summary(answers), "ways": by_way}


def _spread(values: Sequence[float]) -> dict[str, float] | None:
    return {"median": statistics.median(values), "max": max(values)} if values else None


def main() -> int:
    """Run, resume, print the summary."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--container", default="0.80x0.60x0.40")
    parser.add_argument("--orders", type=int, default=10, help="how many (default: %(default)s)")
    parser.add_argument("--size", type=int, default=60, help="items of an order (default: %(default)s)")
    parser.add_argument("--smallest", type=int, default=30, help="items of a pile (default: %(default)s)")
    parser.add_argument("--every", type=int, default=3, help="items between two piles (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--out", type=Path, default=Path("runs/large_piles.jsonl"), help="rows (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="JSON only, no table")
    arguments = parser.parse_args()
    box = parse_container(arguments.container, read_boxes())
    prepare(arguments.catalogue)
    shelf = _Worker.shelf
    names = sorted(fitting(shelf.prepared, box, OPTIONS.grid))
    sizes = tuple(range(arguments.smallest, arguments.size + 1, arguments.every))
    jobs = [
        Job(box.size, tuple(order), sizes, tuple(shelf.items[name].sha256[:16] for name in order))
        for order in random_orders(names, arguments.size, arguments.orders, arguments.seed)
    ]
    found = finish(
        work,
        jobs,
        out=arguments.out,
        pool=Pool("pebble" if arguments.workers > 1 else "serial", arguments.workers),
        revision=revision(work),
        timeout=3600.0,
        prepare=prepare,
        arguments=(arguments.catalogue,),
    )
    report = {
        "catalogue": arguments.catalogue,
        "container": box.label,
        "orders": arguments.orders,
        **summarize(found.rows),
        "failed_jobs": list(found.broken),
    }
    if arguments.json:
        print(json.dumps(report, indent=1))
    else:
        print(
            f"{'piles':<10}{'asked':>7}{'stable':>8}{'agree':>7}{'open':>6}{'check ms':>10}{'CVXPY ms':>10}"
        )
        for way, line in {**report["ways"], "all": report}.items():
            ours, theirs = ((line[f"{who}_ms"] or {"median": 0.0})["median"] for who in ("check", "cvxpy"))
            print(
                f"{way:<10}{line['questions']:>7}{line['stable']:>8}{line['agree']:>7}"
                f"{line['cvxpy_undecided']:>6}{ours:>10.2f}{theirs:>10.0f}"
            )
    for row in found.broken:
        print(f"large_piles: {row['error']}", file=sys.stderr)
    return 1 if found.broken else 0


if __name__ == "__main__":
    sys.exit(reported("benchmarks.large_piles", main))
