"""Orders that are planned in several ways and carried out in physics, in the nominal and in a disturbed world.

The paper's second table (Sec. V-C) with more columns, and its small orders.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from .columns import Column, chosen
from .execution_jobs import ExecutionJob, experiment, in_turn
from .execution_tables import Paper, Way, table
from .experiment import Row
from .orders import random_orders, small_orders
from .planning import challenge_boxes
from .results import Result
from .spec import RunSpec

PAPER = {"overlap": Paper(0.1711, 1.95, 1.29), "paper": Paper(0.791, 1.36, 0.50)}
"""Ten items, by HM (Sec. V-C, the table of executions)."""
PAPER_SMALL = {"paper": Paper(1.0, 1.08, 0.49)}
"""Three to five items, likewise."""


def jobs(spec: RunSpec) -> list[ExecutionJob]:
    """Large orders."""
    large = partial(random_orders, size=spec.items)
    return list(in_turn(spec, chosen(spec.columns), (spec.box,), large))


def jobs_small(spec: RunSpec) -> list[ExecutionJob]:
    """Orders of three to five items into the smallest of five boxes."""
    return list(in_turn(spec, chosen(spec.columns), challenge_boxes(), small_orders))


def ways(columns: Sequence[Column], rows: Sequence[Row], paper: dict[str, Paper]) -> list[Way]:
    """A way for each column."""
    return [
        Way(c.name, [row for row in rows if row["method"] == c.name], c.against, paper.get(c.name))
        for c in columns
    ]


def summarize(spec: RunSpec, rows: Sequence[Row]) -> Result:
    """The paper's second table."""
    columns = ways(chosen(spec.columns), rows, PAPER if spec.as_paper else {})
    return table(EXECUTION.name, EXECUTION.title, spec, columns)


def summarize_small(spec: RunSpec, rows: Sequence[Row]) -> Result:
    """The paper's small orders."""
    columns = ways(chosen(spec.columns), rows, PAPER_SMALL)
    return table(EXECUTION_SMALL.name, EXECUTION_SMALL.title, spec, columns)


EXECUTION = experiment("execution", "Executions", jobs, summarize)
EXECUTION_SMALL = experiment("execution-small", "Executions of small orders", jobs_small, summarize_small)
