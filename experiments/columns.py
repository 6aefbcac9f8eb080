"""The ways to plan and to carry out that experiments on executions compare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from packenv.errors import InputError, closest_match
from packenv.planning.options import PlanOptions


@dataclass(frozen=True)
class Column:
    """One way to plan and execute.

    Attributes:
        name: of the column.
        options: of the planner.
        against: the column that it is compared with, which differs in one thing.
        as_packed: planned as ``robotpack pack`` does: rehearsed by itself (:func:`packenv.api.plan_rehearsed`).
        feel: the robot feels contacts, as it always does in closed loop.
        closed: in closed loop.
    """

    name: str
    options: PlanOptions
    against: str = ""
    as_packed: bool = False
    feel: bool = False
    closed: bool = False


PAPER = PlanOptions("hm", stability="paper", clearance=0.0, geometry="parts")
CAUTIOUS = PlanOptions(geometry="parts")
REHEARSED = PlanOptions(rehearse=6)
DROPPED = PlanOptions("hm", stability="physics", clearance=0.01, rehearse=6)
"""A drop in physics of every placement, and rehearsals: minutes an order."""

COLUMNS = {
    column.name: column
    for column in (
        Column("overlap", PlanOptions("hm", constraints="overlap", stability="paper", geometry="parts")),
        Column("paper", PAPER, "overlap"),
        Column("cautious", CAUTIOUS, "paper"),
        Column("rehearsed", REHEARSED, "cautious"),
        Column("guarded", REHEARSED, "rehearsed", feel=True),
        Column("closed-loop", REHEARSED, "guarded", feel=True, closed=True),
        Column("pack", PlanOptions(), "guarded", as_packed=True, feel=True),
        Column("script", PlanOptions(), "pack", feel=True),
        Column("dropped", DROPPED, "guarded", feel=True),
    )
}
"""``script`` is what :func:`packenv.plan` gives without options: planned on meshes, not rehearsed."""
USUAL = ("overlap", "paper", "cautious", "rehearsed", "guarded", "closed-loop", "pack")
"""Columns that are run unless others are named."""


def chosen(names: Sequence[str], usual: Sequence[str] = USUAL) -> list[Column]:
    """The columns of these names, each once; the usual ones where there are none.

    Raises:
        InputError: there is no column of a name.
    """
    for name in names:
        if name not in COLUMNS:
            known = ", ".join(COLUMNS)
            raise InputError(
                f"--columns: there is no {name!r:.60}{closest_match(name, COLUMNS, f'; give {known}')}"
            )
    return [COLUMNS[name] for name in dict.fromkeys(names or usual)]
