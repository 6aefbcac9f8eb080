"""What rows of executions say: the table that every experiment on executions prints, and its differences."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from .execution_jobs import WORLDS
from .experiment import UNSEEN, Row
from .results import Comparison, Failure, Line, Result
from .spec import RunSpec
from .statistics import Group, Trial, compare, line

Figures: TypeAlias = dict[str, float | int | str | None]


@dataclass(frozen=True)
class Paper:
    """What the paper reports of a line.

    Attributes:
        success: share, 0 to 1.
        drop_cm: mean.
        shift_cm: mean.
    """

    success: float
    drop_cm: float
    shift_cm: float


@dataclass(frozen=True)
class Way:
    """What a line is of: one way to plan and execute.

    Attributes:
        name: of the line.
        rows: of its jobs, those that broke too.
        against: name of the way that it is compared with; "": none.
        paper: what the paper reports of the nominal world.
    """

    name: str
    rows: Sequence[Row]
    against: str = ""
    paper: Paper | None = None

    def sound(self, items: str) -> dict[int, Row]:
        """Its rows of jobs that did not break, by index of the order."""
        return {row["index"]: row for row in self.rows if "error" not in row and row["items"] == items}


More: TypeAlias = Callable[[Way, Sequence[Row], str], Figures]
"""Further figures of a line: of a way, its rows of the orders that are compared, and the world."""


def table(
    experiment: str,
    title: str,
    spec: RunSpec,
    ways: Sequence[Way],
    *,
    more: More = lambda way, rows, world: {},
) -> Result:
    """Lines of every way and world, over the orders that every way planned whole.

    Args:
        experiment: its name.
        title: for people.
        spec: what was asked for.
        ways: of its jobs.
        more: further figures of a line.
    """
    rows = [row for way in ways for row in way.rows]
    lines: list[Line] = []
    comparisons: list[Comparison | None] = []
    told: list[str] = []
    for items in dict.fromkeys(row["items"] for row in rows):
        sound = {way.name: way.sound(items) for way in ways}
        begun = [way for way in ways if sound[way.name]]
        whole = ({k for k, row in found.items() if row["planned"]} for found in sound.values() if found)
        common = sorted(set.intersection(*whole)) if begun else []
        drawn = {row["index"] for row in rows if row["items"] == items}
        unseen = " of items that nothing was tuned on" if items == UNSEEN else ""
        told.append(
            f"Of {len(drawn)} orders drawn{unseen} these are the {len(common)} that every way planned whole."
        )
        for world in WORLDS if common else ():
            tried = {way.name: {k: sound[way.name][k] for k in common} for way in begun}
            trials = {name: _trials(found, world) for name, found in tried.items()}
            groups = {name: _group(found.values(), items, world) for name, found in tried.items()}
            for way in begun:
                same = list(tried[way.name].values())
                figures = _figures(way, list(sound[way.name].values()), same, world)
                lines.append(
                    line(
                        way.name,
                        groups[way.name],
                        list(trials[way.name].values()),
                        paper_success=way.paper.success if way.paper and world == "nominal" else None,
                        figures={**figures, **more(way, same, world)},
                    )
                )
                if way.against in trials:
                    both = _both(groups[way.name], groups[way.against])
                    pair = trials[way.name], trials[way.against]
                    comparisons.append(compare(way.name, way.against, both, *pair))
    return Result(
        experiment,
        title,
        spec,
        tuple(lines),
        tuple(found for found in comparisons if found is not None),
        tuple(failure for way in ways for row in way.rows for failure in _failures(way.name, row)),
        tuple(told),
        tuple(sorted({str(row["revision"]) for row in rows})),
        sum("error" in row for row in rows),
    )


def moves(executions: Sequence[Mapping[str, Any]]) -> Figures:
    """Mean drop and shift over all released items, cm; None where there are none."""
    found: Figures = {}
    for name in ("drop", "shift"):
        lengths = [length for execution in executions for length in execution[f"{name}_m"]]
        found[f"{name}, cm"] = 100.0 * statistics.fmean(lengths) if lengths else None
    return found


def _trials(rows: Mapping[int, Row], world: str) -> dict[int, Trial]:
    return {k: Trial(bool(row[world]["success"]), float(row[world]["cpu_s"])) for k, row in rows.items()}


def _group(rows: Iterable[Row], items: str, world: str) -> Group:
    first = next(iter(rows))
    return Group(first["constraints"], first["setting"], items, world)


def _both(a: Group, b: Group) -> Group:
    """What two lines have in common."""
    return a if a.constraints == b.constraints else replace(a, constraints="")


def _figures(way: Way, sound: Sequence[Row], rows: Sequence[Row], world: str) -> Figures:
    """Columns that all tables of executions have.

    Args:
        way: of the line.
        sound: all of its rows.
        rows: those of the orders that are compared.
        world: of the executions.
    """
    found = [row[world] for row in rows]
    causes = Counter(execution["cause"] for execution in found if not execution["success"])
    paper: Figures = {}
    if way.paper and world == "nominal":
        paper = {"paper: drop, cm": way.paper.drop_cm, "paper: shift, cm": way.paper.shift_cm}
    return {
        "planned, %": 100.0 * statistics.fmean(row["planned"] for row in sound),
        **moves(found),
        **paper,
        "collisions, %": 100.0 * causes["collision"] / len(found),
        "failures": ", ".join(f"{cause} {n}" for cause, n in causes.most_common()),
        "plans an order": statistics.fmean(execution["plans"] for execution in found),
        "planning, CPU-s": statistics.median(row["plan_cpu_s"] for row in sound),
    }


def _failures(name: str, row: Row) -> list[Failure]:
    if "error" in row:
        reasons = [f"job {row['status']}: {row['error']}"]
    elif not row["planned"]:
        left = ", ".join(f"{item} ({reason})" for item, reason in row["left_over"])
        reasons = [f"left over: {left}"]
    else:
        reasons = [f"{world}: {_told(row[world])}" for world in WORLDS if not row[world]["success"]]
    return [
        Failure(row["key"], name, row["constraints"], row["setting"], row["items"], row["index"], why)
        for why in reasons
    ]


def _told(execution: Mapping[str, Any]) -> str:
    """Cause and detail."""
    return ", ".join(filter(None, (execution["cause"], execution["detail"])))
