"""The same plans carried out in two ways: do both give the same verdict, and how far are the items apart?

``engines``: in PyBullet and in MuJoCo: the same convex parts (balls as spheres), masses, inertia, friction, rolling
resistance, robot, way down and rule of rest; another engine. ``early-rest``: until all is at rest by
:class:`packenv.sim.rest.RestRule`, as always, and the full 20 s an item; in the full time items also never sleep.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from packenv.config import EngineName

from .columns import chosen
from .execution_jobs import ExecutionJob, experiment, in_turn
from .execution_tables import Figures, Way, table
from .experiment import Experiment, Row
from .orders import random_orders
from .results import Result
from .spec import RunSpec

ENGINES: tuple[EngineName, ...] = ("bullet", "mujoco")
UNTIL_REST, FULL_TIME = "until rest", "full time"
_GUARDED = ("script",)
"""Plans that were not rehearsed: those that were fail too seldom to tell of verdicts."""
_MOVING = ("paper",)
"""Plans by the paper's check, which move more than safer ones."""


def engine_jobs(spec: RunSpec) -> list[ExecutionJob]:
    """Every order in one engine, then in the other."""
    first = list(_jobs(replace(spec, engine=ENGINES[0]), _GUARDED))
    return first + [replace(job, engine=ENGINES[1]) for job in first]


def early_rest_jobs(spec: RunSpec) -> list[ExecutionJob]:
    """Every order until rest, then for the full time."""
    early = list(_jobs(spec, _MOVING))
    return early + [replace(job, full_settle=True) for job in early]


def _jobs(spec: RunSpec, usual: Sequence[str]) -> Iterable[ExecutionJob]:
    return in_turn(spec, chosen(spec.columns, usual), (spec.box,), partial(random_orders, size=spec.items))


def engines_table(spec: RunSpec, rows: Sequence[Row]) -> Result:
    """Verdicts and ends in both engines."""
    return _table(TWO_ENGINES, spec, rows, lambda row: str(row["engine"]))


def early_rest_table(spec: RunSpec, rows: Sequence[Row]) -> Result:
    """Verdicts and ends until rest and after the full time."""
    return _table(EARLY_REST, spec, rows, lambda row: FULL_TIME if row["full_settle"] else UNTIL_REST)


def _table(asked: Experiment, spec: RunSpec, rows: Sequence[Row], variant: Callable[[Row], str]) -> Result:
    """Of each column the variants in the sequence in which their jobs come, each against the first."""
    ways: list[Way] = []
    first: dict[str, Way] = {}
    for column, name in dict.fromkeys((row["method"], variant(row)) for row in rows):
        own = [row for row in rows if (row["method"], variant(row)) == (column, name)]
        reference = first.get(column)
        way = Way(f"{column}, {name}", own, reference.name if reference else "")
        first.setdefault(column, way)
        ways.append(way)
    named = {way.name: way for way in ways}

    def more(way: Way, same: Sequence[Row], world: str) -> Figures:
        others = {(row["items"], row["index"]): row for row in named[way.against].rows} if way.against else {}
        return agreement([(row[world], others[row["items"], row["index"]][world]) for row in same if others])

    return table(asked.name, asked.title, spec, ways, more=more)


def agreement(pairs: Sequence[tuple[Row, Row]]) -> Figures:
    """How alike two executions of each plan are.

    Args:
        pairs: of a plan's execution in one way and in the other; empty for a way that is compared with none.

    Returns:
        The share with the same success and cause, and how far items' centres of mass are apart in the end, of the
        plans that succeed in both.
    """
    same = [a["cause"] == b["cause"] for a, b in pairs]
    both = [(a["ends_m"], b["ends_m"]) for a, b in pairs if a["success"] and b["success"]]
    gaps = [1e3 * np.linalg.norm(np.subtract(a, b), axis=1) for a, b in both]
    apart = np.concatenate(gaps) if gaps else None
    return {
        "same verdict, %": 100.0 * float(np.mean(same)) if same else None,
        "apart: median, mm": None if apart is None else float(np.median(apart)),
        "apart: 95 %, mm": None if apart is None else float(np.quantile(apart, 0.95)),
        "apart: most, mm": None if apart is None else float(apart.max()),
    }


TWO_ENGINES = experiment("engines", "Two physics engines", engine_jobs, engines_table)
EARLY_REST = experiment(
    "early-rest", "Settling until rest, and for the full time", early_rest_jobs, early_rest_table
)
