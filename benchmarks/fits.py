"""What a person sees fits, is packed: ``python -m benchmarks.fits [--instances N] --json``.

``rows``, ``cubes``, ``nested``, ``angles``: shares of random instances (:mod:`benchmarks.known_fits`) of which exactly
as many items are placed as the closed form says, and none overlaps by the audit of the exact meshes. ``filled``: the
share of containers, filled until three items in a row find no place, that hold within one item of that.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import sys
import tempfile
import time
from collections import Counter, defaultdict
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import packenv as rp
from benchmarks.known_fits import KINDS, Instance
from packenv.cli.pack import options_from
from packenv.cli.parser import planning_options
from packenv.items.cache import ItemCache
from packenv.items.catalogue import Catalogue
from packenv.items.shelf import ItemShelf
from packenv.planning.options import PlanOptions
from packenv.verification.exact_meshes import audit_plan

WITHIN = {"filled": 1}
"""By how many items an answer may be off and still be right; by none where nothing is said."""


def solve(instance: Instance, options: PlanOptions, cache: ItemCache) -> tuple[rp.Plan, float]:
    """The plan of an instance, and its CPU-seconds, preparing the items left out."""
    shelf = ItemShelf(Catalogue.of_items(instance.items), options.grid, options.shape, cache=cache)
    shelf.load(instance.items, fields=options.constraints != "overlap")
    start = time.process_time()
    plan = rp.plan(rp.Order.of(*instance.order), instance.container, shelf, options, margins=False)
    return plan, time.process_time() - start


def main() -> int:
    """Pack and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--instances", type=int, default=200, help="of each kind")
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS))
    planning_options(parser, without=("seed",))
    parser.set_defaults(constraints="overlap")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="JSON only, no table")
    arguments = parser.parse_args()
    options = options_from(arguments)

    shares: dict[str, float] = {}
    details: dict[str, dict[str, Any]] = {}
    wrong: list[dict[str, Any]] = []
    overlaps = 0
    with tempfile.TemporaryDirectory() as folder:
        cache = ItemCache(Path(folder))
        for kind in arguments.kinds:
            rng = np.random.default_rng([arguments.seed, list(KINDS).index(kind)])
            instances = list(islice(KINDS[kind](rng), arguments.instances))
            right: dict[str, Counter[bool]] = defaultdict(Counter)
            seconds = []
            for number, instance in enumerate(tqdm(instances, desc=kind, disable=None)):
                plan, spent = solve(instance, options, cache)
                seconds.append(spent)
                report = audit_plan(plan, instance.items)
                overlaps += len(report.overlaps)
                placed = len(plan.placements)
                ok = report.ok and abs(placed - instance.fits) <= WITHIN.get(kind, 0)
                right[instance.kind][ok] += 1
                if not ok:
                    reasons = Counter(left.reason for left in plan.leftovers)
                    wrong.append(
                        {
                            "of": kind,
                            "number": number,
                            "instance": instance.label,
                            "fits": instance.fits,
                            "placed": placed,
                            "audit_ok": report.ok,
                            "reasons": dict(reasons),
                        }
                    )
            shares[kind] = sum(count[True] for count in right.values()) / len(instances)
            details[kind] = {
                "instances": len(instances),
                "cpu_s_median": float(np.median(seconds)),
                "cpu_s_max": max(seconds),
                "shares": {name: count[True] / count.total() for name, count in sorted(right.items())},
            }

    report_ = {**shares, "overlaps": overlaps, "details": details, "wrong": wrong}
    if arguments.json:
        print(json.dumps(report_, indent=1))
        return 0
    for kind, share in shares.items():
        parts = ", ".join(f"{name} {value:.0%}" for name, value in details[kind]["shares"].items())
        print(f"{kind:<8}{share:7.1%} of {details[kind]['instances']:>4}  ({parts})")
    print(f"overlaps by the audit: {overlaps}")
    for found in wrong:
        print(f"{found['of']} {found['number']}: {found['placed']} of {found['fits']}  {found['instance']}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
