"""What an execution costs: ``python -m benchmarks.execution [--catalogue DIR] [--orders 5] --json``.

Random 10-item orders are planned, under the paper's rule, by default and with physics-checked planning, and
the complete plans are carried out with the robot, without rendering, in each engine. Planning, reading the
catalogue and one first execution are in no figure of an execution. One process, one thread, CPU time. JSON keys, for
each of ``rules`` (``paper``, ``default``, ``physics``):

- ``plan_cpu_s_median``, ``plan_cpu_s_max``: CPU-seconds of a plan; and in each of ``engines``:
- ``orders``, ``planned``: how many orders, and how many were planned whole; ``n``: how many of those plans
  were carried out to the end, successful or not (a collision ends an execution early, and cheaply);
- ``cpu_s_median``, ``cpu_s_max``: CPU-seconds of a whole execution, over the plans; each is the median of
  ``--repeats`` runs; ``cpu_s_an_item``: the median a plan, divided by its items;
- ``simulated_s_median``: simulated seconds, lowering and settling together; ``steps_median``: time steps of
  the engine, only those in which it moves items; ``cpu_s_a_simulated_s``: of all plans together;
- ``time_shares``: where the CPU time goes, over all plans, measured in one more run of each with a clock
  around the parts named; each part without what other parts do inside it, ``other`` is what is left: ``engine
  steps`` (items falling and settling), ``rest watch``, ``descent watch`` (overlaps of the held item), ``robot
  watch`` (overlaps of the robot, down and back up), ``path`` (waypoints to time steps, and where anything is near
  them), ``world`` (building floor and walls, and taking all down), ``items`` (making shapes and bodies), ``poses``
  (moving the held item, measuring, sleep and wake);
- ``clock_slows``: CPU time of those runs over that without the clock;
- ``drop_test_ms``: CPU-milliseconds of one drop of the next item of the plan on the pile before it, as
  physics-checked planning asks for it: ``median``, ``mean``, ``max`` and how many, ``n``; making the item's
  shape and body is part of it, carrying the pile over from the drop before likewise.

``rehearsed`` has, for plans that survive six worlds, ``cpu_s_median`` and ``cpu_s_max`` of planning and rehearsing by
``--rehearse 6`` alone, ``dropped_cpu_s_median`` of the same orders with a drop of every placement besides
(``--stability physics --clearance 0.01``), and ``ratio``, the median of their ratios.

``cpu_s_median`` at the top is that of the last rule in the first engine.
"""

from __future__ import annotations

from packenv.experiments import one_thread  # noqa: F401  isort: skip

import argparse
import functools
import json
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from tqdm import tqdm

from packenv import api
from packenv.config import GridConfig
from packenv.execution.physics_planner import CAREFUL, STRICT
from packenv.experiments.columns import CAUTIOUS, DROPPED, PAPER, REHEARSED
from packenv.experiments.orders import fitting, random_orders
from packenv.experiments.shelf import open_shelf
from packenv.io.containers import parse_container, read_boxes
from packenv.items.shelf import ItemShelf
from packenv.planning.options import PlanOptions
from packenv.robot.files import default_cell
from packenv.sim.descent import PlacementTask, Way
from packenv.sim.drop_test import DropTest, Lying
from packenv.sim.plan_tasks import run_tasks, task_of
from packenv.sim.rest import RestWatch
from packenv.sim.robot_model import RobotModel
from packenv.sim.session import Execution, ExecutionConfig
from packenv.sim.world import World
from packenv.types import Container, Order, Plan

GRID = GridConfig()
RULES = {"paper": PAPER, "default": CAUTIOUS, "physics": replace(DROPPED, rehearse=0)}
PARTS: tuple[tuple[type, str, str], ...] = (
    (World, "overlaps", "descent watch"),
    (RestWatch, "calm", "rest watch"),
    (RobotModel, "overlaps", "robot watch"),
    (RobotModel, "way", "path"),
    (RobotModel, "near", "path"),
    (World, "near", "path"),
    (World, "__init__", "world"),
    (World, "close", "world"),
    (World, "add", "items"),
    (World, "move", "poses"),
    (World, "pose", "poses"),
    (World, "sleep", "poses"),
    (World, "wake", "poses"),
    (World, "ghost", "poses"),
    (World, "solid", "poses"),
    (Way, "of_task", "path"),
)
"""Methods, and the parts of an execution that they are."""
STEPS = "engine steps"
"""The part that the engine's own method is."""


class Clock:
    """CPU time by part; what a part calls that is a part itself counts for that one alone."""

    def __init__(self) -> None:
        """Nothing spent."""
        self.spent: Counter[str] = Counter()
        self.calls: Counter[str] = Counter()
        self._inner = [0.0]

    @contextmanager
    def around(self, parts: Sequence[tuple[type, str, str]]) -> Iterator[None]:
        """Time these methods, of all objects of their classes, while the context lasts."""
        kept = [(owner, name, getattr(owner, name)) for owner, name, _ in parts]
        for (owner, name, part), (_, _, method) in zip(parts, kept, strict=True):
            setattr(owner, name, self._timed(method, part))
        try:
            yield
        finally:
            for owner, name, method in kept:
                setattr(owner, name, method)

    def _timed(self, method: Callable[..., Any], part: str) -> Callable[..., Any]:
        @functools.wraps(method)
        def timed(*args: Any, **kwargs: Any) -> Any:
            self._inner.append(0.0)
            start = time.process_time()
            try:
                return method(*args, **kwargs)
            finally:
                whole = time.process_time() - start
                self.spent[part] += whole - self._inner.pop()
                self._inner[-1] += whole
                self.calls[part] += 1

        return timed


def cpu(work: Callable[[], Any]) -> tuple[float, Any]:
    """CPU-seconds of a call, and its result."""
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def tasks_of(made: Plan, shelf: ItemShelf, box: Container) -> list[PlacementTask]:
    """What the robot does to carry a plan out."""
    cell = default_cell().with_container(box)
    return [task_of(p, shelf.physics[p.item], cell) for p in made.placements]


def plan(options: PlanOptions, order: Sequence[str], shelf: ItemShelf, box: Container) -> Plan:
    """The plan of an order."""
    return api.plan(Order.of(*order), box, shelf, options, margins=False)


def execute(tasks: Sequence[PlacementTask], box: Container, config: ExecutionConfig) -> Execution:
    """Carry a plan out as ``robotpack execute`` does."""
    return run_tasks(tasks, default_cell().with_container(box), config)


def rehearsed(orders: Sequence[Sequence[str]], shelf: ItemShelf, box: Container) -> dict[str, Any]:
    """What rehearsed plans cost, and what they cost with a drop of every placement."""
    alone, dropped = [], []
    for order in tqdm(orders, desc="rehearsing", disable=None):
        shelf.load(order, fields=True, physics=True)
        for options, spent in ((REHEARSED, alone), (DROPPED, dropped)):
            spent.append(cpu(functools.partial(plan, options, order, shelf, box))[0])
    return {
        "n": len(alone),
        "cpu_s_median": statistics.median(alone),
        "cpu_s_max": max(alone),
        "dropped_cpu_s_median": statistics.median(dropped),
        "ratio": statistics.median(d / a for a, d in zip(alone, dropped, strict=True)),
    }


def executions(
    plans: Sequence[list[PlacementTask]], box: Container, repeats: int, config: ExecutionConfig
) -> dict[str, Any]:
    """Time whole executions, then their parts."""
    rows = []
    with World(box, config.world) as world:
        parts = (*PARTS, (type(world.engine), "step", STEPS))
    clock = Clock()
    plain = clocked = 0.0
    for tasks in tqdm(plans, desc="executing", disable=None):
        runs = [cpu(functools.partial(execute, tasks, box, config)) for _ in range(repeats)]
        done = runs[0][1]
        if len(done.items) < len(tasks):
            continue
        seconds = statistics.median(spent for spent, _ in runs)
        steps = clock.calls[STEPS]
        with clock.around(parts):
            clocked += cpu(functools.partial(execute, tasks, box, config))[0]
        steps = clock.calls[STEPS] - steps
        plain += seconds
        rows.append((seconds, seconds / len(tasks), done.simulated_s, steps))
    if not rows:
        return {"n": 0}
    spent = {part: seconds / clocked for part, seconds in clock.spent.most_common()}
    whole, item, simulated, steps_made = zip(*rows, strict=True)
    return {
        "n": len(rows),
        "cpu_s_median": statistics.median(whole),
        "cpu_s_max": max(whole),
        "cpu_s_an_item": statistics.median(item),
        "simulated_s_median": statistics.median(simulated),
        "steps_median": statistics.median(steps_made),
        "cpu_s_a_simulated_s": sum(whole) / sum(simulated),
        "time_shares": {**spent, "other": 1.0 - sum(spent.values())},
        "clock_slows": clocked / plain,
    }


def drop_tests(
    plans: Sequence[list[PlacementTask]], box: Container, config: ExecutionConfig
) -> dict[str, Any]:
    """Time the drops of physics-checked planning, had its first choice always been the plan's."""
    seconds = []
    for tasks in plans:
        test = DropTest(box, config.world)
        pile: tuple[Lying, ...] = ()
        for task in tasks:
            for how in CAREFUL:
                spent, dropped = cpu(
                    functools.partial(test.drop, pile, task.item, task.rotation, task.position, how, STRICT)
                )
                seconds.append(1e3 * spent)
            if dropped.reason:
                # The item did not stay where it was planned, so there is no pile for what comes next.
                break
            pile = dropped.pile
        test.close()
    if not seconds:
        return {"n": 0}
    return {
        "median": statistics.median(seconds),
        "mean": statistics.mean(seconds),
        "max": max(seconds),
        "n": len(seconds),
    }


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--catalogue", default="builtin")
    parser.add_argument("--container", default="0.32x0.32x0.30")
    parser.add_argument("--orders", type=int, default=5)
    parser.add_argument("--items", type=int, default=10, help="items an order (default: %(default)s)")
    parser.add_argument("--rules", nargs="+", choices=tuple(RULES), default=list(RULES))
    parser.add_argument("--engines", nargs="+", choices=("bullet", "mujoco"), default=["mujoco"])
    parser.add_argument("--rehearsed", type=int, default=3, help="orders to rehearse (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each plan (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="JSON only, no table")
    arguments = parser.parse_args()
    box = parse_container(arguments.container, read_boxes())
    shelf = open_shelf(arguments.catalogue, "parts", GRID)
    names = fitting(shelf.prepared, box, GRID)
    orders = random_orders(names, arguments.items, arguments.orders, arguments.seed)
    report: dict[str, Any] = {}
    for rule in arguments.rules:
        spent, made = [], []
        for order in tqdm(orders, desc=f"planning, {rule}", disable=None):
            shelf.load(order, fields=True, physics=True)
            seconds, found = cpu(functools.partial(plan, RULES[rule], order, shelf, box))
            spent.append(seconds)
            made += [tasks_of(found, shelf, box)] if found.complete else []
        report[rule] = {
            "orders": len(orders),
            "planned": len(made),
            "plan_cpu_s_median": statistics.median(spent),
            "plan_cpu_s_max": max(spent),
            "engines": {},
        }
        for engine in arguments.engines if made else ():
            config = ExecutionConfig.of(default_cell(), engine)
            execute(made[0], box, config)
            told = report[rule]["engines"][engine] = {
                **executions(made, box, arguments.repeats, config),
                "drop_test_ms": drop_tests(made, box, config),
            }
            if not arguments.json and told["n"]:
                _tell(f"{rule}, {engine}", told)
    last = report[arguments.rules[-1]]["engines"].get(arguments.engines[0], {})
    document = {
        "catalogue": arguments.catalogue,
        "container": box.label,
        "items": arguments.items,
        "cpu_s_median": last.get("cpu_s_median"),
        "rehearsed": rehearsed(orders[: arguments.rehearsed], shelf, box) if arguments.rehearsed else None,
        "rules": report,
    }
    print(json.dumps(document, indent=1))
    return 0


def _tell(rule: str, found: dict[str, Any]) -> None:
    print(
        f"{rule:<16} {found['cpu_s_median']:.2f} CPU-seconds a plan, {found['cpu_s_an_item']:.2f} an item, "
        f"{found['simulated_s_median']:.1f} s simulated; a drop {found['drop_test_ms']['median']:.0f} ms",
        file=sys.stderr,
    )
    for part, share in found["time_shares"].items():
        print(f"  {part:<14} {share:6.1%}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
