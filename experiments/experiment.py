"""What an experiment is: the jobs that it wants, what a job does, and what the rows say."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, TypeAlias

from packenv.io.rows import row_key
from packenv.planning.assembly import own_code
from packenv.planning.options import PlanOptions
from packenv.types import Container, Plan

from .results import Result
from .spec import RunSpec

if TYPE_CHECKING:
    from packenv.execution.execute import ExecutedPlan

Row: TypeAlias = Mapping[str, Any]
"""One job's row, as JSON has it: what :meth:`Job.head` says, then ``key``, ``status`` (``ok``, ``failed``,
``timeout``, ``died``), ``error`` (of a job that is not ok), ``revision``, ``seconds`` (wall) and the job's figures."""

ALL, UNSEEN = "all", "unseen"
"""From which items an order is drawn."""


@dataclass(frozen=True)
class Job:
    """One order, planned one way; experiments that need more derive from it.

    Attributes:
        method: the heuristic, or the way to plan and execute.
        constraints: under which it is planned.
        setting: of the planner.
        items: ``all``, or ``unseen``: only items that nothing was tuned on.
        index: of the order in its draw.
        order: names of its items.
        made_of: what results depend on of each item.
        boxes: the order goes into the first that takes all.
        options: of the planner.
    """

    method: str
    constraints: str
    setting: str
    items: str
    index: int
    order: tuple[str, ...]
    made_of: tuple[str, ...]
    boxes: tuple[Container, ...]
    options: PlanOptions

    @property
    def key(self) -> str:
        """Hash of all that the row depends on but the product's revision."""
        return row_key(type(self).__name__, self, own_code(self.options))

    def head(self) -> dict[str, Any]:
        """What the row tells of the job."""
        told = {f.name: getattr(self, f.name) for f in fields(self)}
        told["boxes"] = [box.label for box in self.boxes]
        told["options"] = self.options.to_mapping()
        return told


@dataclass(frozen=True)
class Experiment:
    """One table, or part of one.

    Attributes:
        name: on the command line.
        title: of its section in the report.
        rows: name of the file of its rows; experiments whose jobs are alike share one, and their rows.
        timeout: seconds after which a job is given up.
        prepare: called once in each worker, with the folder of the run as well.
        work: a job to the figures of its row; module-level, as it is pickled.
        jobs: all jobs that it wants; called in a process that is prepared.
        summarize: the rows of its jobs to its tables.
        again: a job's plan, or what became of it in physics, made again to be looked at.
    """

    name: str
    title: str
    rows: str
    timeout: float
    prepare: Callable[[RunSpec, str], None]
    work: Callable[[Any], dict[str, Any]]
    jobs: Callable[[RunSpec], Sequence[Job]]
    summarize: Callable[[RunSpec, Sequence[Row]], Result]
    again: Callable[[Any], Plan | ExecutedPlan]
