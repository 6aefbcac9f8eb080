"""Speed and agreement of the stability check: ``python -m benchmarks.stability [--catalogue DIR] --json``.

Items are placed where HM puts them without looking at stability; a placement that falls is taken out again,
so every question is asked of a pile that stands. ``contact_ms`` and ``solve_ms`` are medians of CPU time over
the questions at large piles (``--largest`` items and more, the new one included). ``agreement`` is the share
of all questions where the checker, shortcuts included, says what the CVXPY reference says of the contacts: the
rule of ``--stability paper``. ``settling`` is the same for what all other rules ask besides, whether the new
item settles, of every fourth question where the pile is balanced; ``settle_ms`` is over all of these.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import json
import statistics
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from typing import Any

from tqdm import tqdm

from benchmarks.settling_reference import reference_motion
from packenv.config import GridConfig
from packenv.experiments.orders import fitting, random_orders
from packenv.experiments.shelf import open_shelf
from packenv.io.containers import parse_container, read_boxes
from packenv.planning.planner import Planner, by_box_volume
from packenv.planning.search.heuristics import HEURISTICS
from packenv.planning.stability.checker import StabilityChecker
from packenv.planning.stability.contact_patches import thin, tighten
from packenv.planning.stability.contacts import Body, item_contacts, join, no_contacts
from packenv.planning.stability.equilibrium import build_equilibrium
from packenv.planning.stability.margins import MarginRule, check_margin, measure_margin
from packenv.planning.stability.paper_contacts import paper_contacts
from packenv.planning.stability.settling import SETTLED, settles
from packenv.planning.stability.solvers import solve_cvxpy


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """CPU-milliseconds of a call, and its result."""
    start = time.process_time()
    result = work()
    return 1e3 * (time.process_time() - start), result


def median(values: list[float]) -> float | None:
    """The median, or None of nothing."""
    return statistics.median(values) if values else None


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--container", default="0.32x0.32x0.30")
    parser.add_argument("--orders", type=int, default=20)
    parser.add_argument("--size", type=int, default=14, help="items of an order, those that fall included")
    parser.add_argument("--largest", type=int, default=8, help="smallest pile that the medians count")
    parser.add_argument("--tilt", type=float, default=MarginRule.tilt_deg, help="of the margin rule, degrees")
    parser.add_argument("--mu", type=float, default=MarginRule.mu, help="friction of the margin rule")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()

    grid = GridConfig()
    container = parse_container(arguments.container, read_boxes())
    shelf = open_shelf(arguments.catalogue, grid=grid)
    meshes, prepared, fields = shelf.items, shelf.prepared, shelf.fields
    checker = StabilityChecker()
    rule = MarginRule(arguments.tilt, arguments.mu)

    times: dict[str, list[float]] = defaultdict(list)
    decided: Counter[str] = Counter()
    questions = agreed = stable = 0
    compared: Counter[tuple[bool, bool]] = Counter()
    contact_counts = []
    settling: Counter[tuple[bool, bool]] = Counter()
    names = sorted(fitting(prepared, container, grid))
    for order in tqdm(random_orders(names, arguments.size, arguments.orders, arguments.seed)):
        plan = Planner(HEURISTICS["hm"], grid).pack(by_box_volume(order, prepared), prepared, container)
        bodies: list[Body] = []
        masses: list[float] = []
        coms: list[Any] = []
        contacts, previous, tilted = no_contacts(), None, None
        by_paper = no_contacts()
        for p in plan.placements:
            item = meshes[p.item]
            body = Body(fields[p.item], p.rotation, p.position)
            index = len(bodies) + 1
            contact_ms, found = timed(
                lambda b=body, i=index, others=tuple(bodies): thin(
                    item_contacts(b, others, container, index=i)
                )
            )
            pile = join([part for part in (contacts, found) if len(part)])
            question = (pile, [*masses, item.mass], [*coms, p.rotation @ item.com + p.position])
            solve_ms, result = timed(lambda q=question, before=previous: checker.check(*q, previous=before))
            reference = solve_cvxpy(build_equilibrium(*question))
            paper_ms, theirs = timed(
                lambda b=body, i=index, others=tuple(bodies): paper_contacts(b, others, container, index=i)
            )
            paper_pile = join([part for part in (by_paper, theirs) if len(part)])
            verdict = checker.check(paper_pile, *question[1:]).stable
            compared[verdict, result.stable] += 1
            questions += 1
            agreed += result.stable == (reference.status == "stable")
            stable += result.stable
            decided[f"{result.decided_by}/{'stable' if result.stable else 'unstable'}"] += 1
            large = index >= arguments.largest
            if large:
                times["contact"].append(contact_ms)
                times["paper contact"].append(paper_ms)
                times["solve"].append(solve_ms)
                times[f"solve {result.decided_by}/{'stable' if result.stable else 'unstable'}"].append(
                    solve_ms
                )
                contact_counts.append(len(pile))
            if not result.stable:
                continue
            settle_ms, stays = timed(
                lambda c=found, q=question, i=index: settles(checker, tighten(c), q[2][-1], i)
            )
            times["settle"].append(settle_ms)
            if len(times["settle"]) % 4 == 0:
                motion = reference_motion(tighten(found), question[2][-1], index, checker.mu)
                settling[stays, bool(abs(motion).max() <= SETTLED)] += 1
            rule_ms, tilts = timed(
                lambda q=question, before=tilted: check_margin(checker, *q, rule, previous=before)
            )
            if large:
                times["margin rule"].append(rule_ms)
                times["margin"].append(timed(lambda q=question: measure_margin(checker, *q))[0])
            bodies.append(body)
            contacts, masses, coms, previous, tilted = *question, result, tilts
            by_paper = paper_pile

    report = {
        "agreement": agreed / questions if questions else None,
        "contact_ms": median(times["contact"]),
        "solve_ms": median(times["solve"]),
        "margin_rule_ms": median(times["margin rule"]),
        "margin_ms": median(times["margin"]),
        "settle_ms": median(times["settle"]),
        "settling": {
            "questions": settling.total(),
            "agreement": (settling[True, True] + settling[False, False]) / max(settling.total(), 1),
            "falls": settling[False, False] + settling[False, True],
        },
        "solve_ms_by_step": {
            name.removeprefix("solve "): median(values)
            for name, values in sorted(times.items())
            if name.startswith("solve ")
        },
        "questions": questions,
        "questions_timed": len(times["solve"]),
        "stable_share": stable / questions if questions else None,
        "decided_by": dict(decided),
        "contacts_median": median(contact_counts),
        "paper_contact_rule": {
            "same_verdict": (compared[True, True] + compared[False, False]) / max(questions, 1),
            "stable_by_the_paper_alone": compared[True, False] / max(questions, 1),
            "stable_by_ours_alone": compared[False, True] / max(questions, 1),
            "contact_ms": median(times["paper contact"]),
        },
    }
    print(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
