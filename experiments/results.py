"""What rows say: the lines of a table, and differences between methods on the same orders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, TypeAlias

from .spec import RunSpec

Interval: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class Line:
    """One line of a table.

    Attributes:
        method: heuristic, or way to plan and execute.
        constraints: under which it planned.
        setting: of the planner.
        items: ``all``, or ``unseen``: orders of items that nothing was tuned on.
        n: orders.
        success: share of them, 0 to 1.
        ci95: its 95 % interval (Wilson).
        cpu_s_median: CPU-seconds a plan, or an execution.
        cpu_s_mean: likewise.
        cpu_s_max: likewise.
        world: ``nominal`` or ``disturbed``, of an execution.
        paper_success: what the paper reports; None: nothing.
        paper_s: seconds that the paper reports.
        figures: further columns by name with their unit (``drop, cm``), in the order in which they are shown; None
            where there is nothing to measure.
    """

    method: str
    constraints: str
    setting: str
    items: str
    n: int
    success: float
    ci95: Interval
    cpu_s_median: float
    cpu_s_mean: float
    cpu_s_max: float
    world: str = ""
    paper_success: float | None = None
    paper_s: float | None = None
    figures: Mapping[str, float | int | str | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Comparison:
    """Two methods on the same orders.

    Attributes:
        a: the first method.
        b: the second.
        constraints: of both, as all up to ``world``.
        setting: of the planner.
        items: as in :class:`Line`.
        world: likewise.
        n: orders that both have a row of.
        a_only: orders in which a alone succeeds.
        b_only: orders in which b alone does.
        p: of McNemar's exact test: chance of so unlike numbers if both were equally good.
        difference: success of a minus that of b, 0 to 1.
        difference_ci95: its 95 % interval (paired bootstrap).
        time_ratio: CPU-seconds of a by those of b, geometric mean over the orders.
        time_ratio_ci95: its 95 % interval (paired bootstrap).
    """

    a: str
    b: str
    constraints: str
    setting: str
    items: str
    world: str
    n: int
    a_only: int
    b_only: int
    p: float
    difference: float
    difference_ci95: Interval
    time_ratio: float
    time_ratio_ci95: Interval


@dataclass(frozen=True)
class Failure:
    """A row that a person may want to look at.

    Attributes:
        key: of the row.
        method: as in :class:`Line`, as all up to ``items``.
        constraints: likewise.
        setting: likewise.
        items: likewise.
        index: of the order.
        why: in a few words.
    """

    key: str
    method: str
    constraints: str
    setting: str
    items: str
    index: int
    why: str


@dataclass(frozen=True)
class Result:
    """What one experiment found.

    Attributes:
        experiment: its name.
        title: for people.
        spec: what was asked for.
        lines: of its table.
        comparisons: between methods.
        failures: orders that were not packed or not carried out, and rows of jobs that broke.
        remarks: sentences that belong under the table.
        revisions: of the product, of all rows.
        broken: how many jobs failed, died or took too long.
        missing: how many jobs have no row yet.
    """

    experiment: str
    title: str
    spec: RunSpec
    lines: tuple[Line, ...]
    comparisons: tuple[Comparison, ...] = ()
    failures: tuple[Failure, ...] = ()
    remarks: tuple[str, ...] = ()
    revisions: tuple[str, ...] = ()
    broken: int = 0
    missing: int = 0

    def to_json(self) -> dict[str, Any]:
        """The result as JSON has it: ``rows`` are the lines of its table."""
        return {
            "experiment": self.experiment,
            "title": self.title,
            "spec": self.spec.to_mapping(),
            "rows": [asdict(line) for line in self.lines],
            "comparisons": [asdict(comparison) for comparison in self.comparisons],
            "failures": [asdict(failure) for failure in self.failures],
            "remarks": list(self.remarks),
            "revisions": list(self.revisions),
            "failed_jobs": self.broken,
            "missing_jobs": self.missing,
        }
