"""Orders that are planned and audited: the jobs of small orders, heuristics, 5D search and fallback.

Every plan is audited on the exact meshes (:mod:`packenv.verification.exact_meshes`) outside the time that is told.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from packenv import api
from packenv.config import GridConfig
from packenv.errors import InputError
from packenv.io.containers import read_boxes
from packenv.items.shelf import ItemShelf
from packenv.planning.options import Geometry, PlanOptions
from packenv.planning.search.orientations import perturbations
from packenv.types import Container, Order, Plan
from packenv.verification.exact_meshes import audit_plan

from .experiment import ALL, UNSEEN, Experiment, Job, Row
from .orders import fitting, random_orders, small_orders, unseen_items
from .plan_store import fingerprints
from .planning_tables import fallback_table, heuristics_table, search5d_table, small_orders_table
from .results import Result
from .setting import options_of
from .shelf import open_shelf
from .spec import RunSpec

METHODS = ("hm", "dblf", "mta", "minz", "auto", "gls")
"""What is compared unless other methods are named."""
PAPERS = ("hm", "dblf", "mta")
"""Methods of the paper that plan one item after another: those that are run with its preset."""
WITNESSES = ("hm", "dblf", "mta", "minz")
"""An order that one of these, or a method that is compared, packs without overlap is *feasible*."""
GLS = "gls"
SEARCH_5D = "search=5d"
WARM = 4
"""Items of the plan that a worker makes in each way before it tells any time of it."""
_TIMEOUT = 1800.0


class _Worker:
    """What a process loads once: shelves by grid and geometry."""

    spec: RunSpec | None = None
    shelves: dict[tuple[GridConfig, Geometry], ItemShelf]
    warm: set[PlanOptions]


def prepare(spec: RunSpec, folder: str) -> None:
    """Open the catalogue in this process, unless it was open when this one was forked."""
    if _Worker.spec != spec:
        _Worker.spec, _Worker.shelves, _Worker.warm = spec, {}, set()


def shelf_of(options: PlanOptions) -> ItemShelf:
    """The items that options plan with, in this process."""
    asked = options.grid, options.shape
    if asked not in _Worker.shelves:
        spec = _Worker.spec
        assert spec is not None
        _Worker.shelves[asked] = open_shelf(spec.catalogue, options.shape, options.grid, spec.unit)
    return _Worker.shelves[asked]


def challenge_boxes() -> tuple[Container, ...]:
    """The five boxes of the paper's small orders, smallest volume first."""
    return tuple(sorted((box for box in read_boxes() if box.name != "S32"), key=lambda box: box.volume))


def plan_again(job: Job) -> Plan:
    """The plan of a job."""
    shelf = shelf_of(job.options)
    boxes = list(job.boxes) if len(job.boxes) > 1 else job.boxes[0]
    return api.plan(Order.of(*job.order), boxes, shelf, job.options, margins=False)


def work(job: Job) -> dict[str, Any]:
    """Plan one order and audit the plan; ``prepare_cpu_s`` is what maps of all orientations of a 5D search take."""
    shelf = shelf_of(job.options)
    shelf.load(job.order, fields=job.options.constraints != "overlap")
    if job.options not in _Worker.warm:  # kernels are compiled or loaded by the first plan that needs them
        plan_again(replace(job, order=job.order[:WARM]))
        _Worker.warm.add(job.options)
    start = time.process_time()
    if job.options.search == "5d":
        _tilt(job, shelf)
    prepared = time.process_time()
    plan = plan_again(job)
    seconds = time.process_time() - prepared
    audit = audit_plan(plan, {name: shelf.items[name] for name in set(job.order)})
    rejections: Counter[str] = Counter()
    for counts in (part.rejections for parts in (plan.placements, plan.leftovers) for part in parts):
        rejections.update(counts)
    return {
        "complete": plan.complete,
        "placed": len(plan.placements),
        "container": plan.container.label,
        "height": plan.metrics["height"],
        "utilization": plan.metrics["utilization"],
        "made_by": plan.made_by,
        "leftovers": [(left.item, left.reason) for left in plan.leftovers],
        "routes": dict(Counter(placement.route for placement in plan.placements)),
        "checked": sum(placement.checked for placement in plan.placements),
        "rejections": dict(rejections),
        "overlaps": len(audit.overlaps),
        "protrusions": len(audit.protrusions),
        "blocked": len(audit.blocked),
        "cpu_s": seconds,
        "prepare_cpu_s": prepared - start,
    }


def _tilt(job: Job, shelf: ItemShelf) -> None:
    """Have the heightmaps of all perturbed orientations at hand: they depend on the items alone."""
    for name in job.order:
        poses = shelf.prepared[name].poses
        for box in job.boxes:
            for _ in perturbations(shelf.shapes[name], poses, job.options.grid, box.size):
                pass


def method_options(spec: RunSpec, setting: str, method: str, constraints: str) -> PlanOptions:
    """How a method plans in a setting."""
    if method == GLS:
        words = {"heuristic": "auto", "method": GLS, "plans": spec.gls_plans, "budget": None}
    else:
        words = {"heuristic": method}
    return options_of(setting).changed({**words, "constraints": constraints})


def drawn(
    spec: RunSpec, names: Sequence[str], box: Container, draw: Callable[..., list[list[str]]]
) -> Iterator[tuple[str, int, list[str]]]:
    """From which items, index and names of each order: of all items, then of those that nothing was tuned on.

    Raises:
        InputError: no item fits.
    """
    groups = {ALL: list(names)}
    if spec.unseen is not None:
        chosen = set(unseen_items([*shelf_of(options_of("default")).catalogue.names], spec.unseen))
        groups[UNSEEN] = [name for name in names if name in chosen]
    for items, group in groups.items():
        if not group:
            which = "items" if items == ALL else f"items of --unseen {spec.unseen}"
            raise InputError(
                f"catalogue {spec.catalogue}: none of its {which} fits {box.full_label} alone, "
                "give a larger --container"
            )
        for index, order in enumerate(draw(group, count=spec.orders, seed=spec.seed)):
            yield items, index, order


def _jobs(
    spec: RunSpec,
    boxes: tuple[Container, ...],
    draw: Callable[..., list[list[str]]],
    ways: Iterable[tuple[str, str, str]],
) -> list[Job]:
    """Jobs of each order, in each way: method, constraints, setting."""
    chosen = [(*way, method_options(spec, way[2], way[0], way[1])) for way in ways]
    shelf = shelf_of(options_of("default"))
    names = fitting(shelf.prepared, boxes[-1], GridConfig())
    return [
        Job(method, constraints, setting, items, index, tuple(order), made_of, boxes, options)
        for items, index, order in drawn(spec, names, boxes[-1], draw)
        for made_of in (fingerprints(shelf.items, order),)
        for method, constraints, setting, options in chosen
    ]


def _of_setting(setting: str, methods: Sequence[str]) -> list[str]:
    """Methods that are run in a setting: with the paper's preset those that the paper runs so, and own ones."""
    if not setting.startswith("paper"):
        return list(methods)
    return [method for method in methods if method in PAPERS or method not in METHODS]


def heuristics_jobs(spec: RunSpec) -> list[Job]:
    """All methods, non-overlap and all constraints, and overlap alone by each witness."""
    methods = spec.methods or METHODS
    ways = [
        (method, constraints, setting)
        for constraints in spec.constraints
        for setting in spec.settings or ("default", "paper")
        for method in _of_setting(setting, methods)
    ]
    ways += [(witness, "overlap", "default") for witness in WITNESSES]
    return _jobs(spec, (spec.box,), partial(random_orders, size=spec.items), dict.fromkeys(ways))


def small_orders_jobs(spec: RunSpec) -> list[Job]:
    """Orders of three to five items into the smallest of five boxes, all constraints."""
    methods = [method for method in spec.methods or ("hm", "auto") if method != GLS]
    ways = [
        (method, "robot", setting)
        for setting in spec.settings or ("default", "paper")
        for method in _of_setting(setting, methods)
    ]
    return _jobs(spec, challenge_boxes(), small_orders, ways)


def search5d_jobs(spec: RunSpec) -> list[Job]:
    """HM with the fallback, and all orientations at once."""
    settings = spec.settings or ("default",)
    ways = [("hm", "robot", f"{setting}{more}") for setting in settings for more in ("", f",{SEARCH_5D}")]
    return _jobs(spec, (spec.box,), partial(random_orders, size=spec.items), ways)


def fallback_jobs(spec: RunSpec) -> list[Job]:
    """HM with the fallback: the same rows as those of the heuristics."""
    ways = [("hm", "robot", setting) for setting in spec.settings or ("default", "paper")]
    return _jobs(spec, (spec.box,), partial(random_orders, size=spec.items), ways)


def _experiment(
    name: str,
    title: str,
    jobs: Callable[[RunSpec], list[Job]],
    table: Callable[[RunSpec, Sequence[Row]], Result],
) -> Experiment:
    return Experiment(name, title, "planning", _TIMEOUT, prepare, work, jobs, table, plan_again)


HEURISTICS = _experiment("heuristics", "Heuristics on large orders", heuristics_jobs, heuristics_table)
SMALL_ORDERS = _experiment("small-orders", "Small orders", small_orders_jobs, small_orders_table)
SEARCH5D = _experiment("search5d", "5D search alone", search5d_jobs, search5d_table)
FALLBACK = _experiment("fallback", "Fallback", fallback_jobs, fallback_table)
