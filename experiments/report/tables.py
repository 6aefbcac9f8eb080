"""The tables of a report, made once: whoever writes text, Markdown or HTML only lays them out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ..experiment import ALL, UNSEEN
from ..results import Comparison, Line, Result
from .significance import holm
from .words import DASH, chance, constraints_name, count, interval, method_name, number, percent, plain

Mark: TypeAlias = Literal["", "name", "paper", "text"]
"""What a column holds: a figure, a name, what the paper reports, or a sentence."""


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        title: its heading, with the unit behind a comma.
        mark: what it holds.
    """

    title: str
    mark: Mark = ""


@dataclass(frozen=True)
class Cell:
    """A cell of a table.

    Attributes:
        text: in one line.
        link: relative address of what there is to see of it.
    """

    text: str
    link: str = ""


@dataclass(frozen=True)
class Group:
    """Rows under one heading.

    Attributes:
        title: what they have in common; empty for nothing.
        rows: a cell for each column.
    """

    title: str
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        title: above it.
        columns: from the left.
        groups: from the top.
    """

    title: str
    columns: tuple[Column, ...]
    groups: tuple[Group, ...]


@dataclass(frozen=True)
class Sorting:
    """Which circumstances of a table's lines are headings of groups, and which are columns.

    A circumstance that is another one for each method, as the constraints of a way to execute, is a column; one
    under which each method was run, or that all lines share, is a heading.

    Attributes:
        headings: names of attributes of :class:`Line`.
        columns: likewise.
    """

    headings: tuple[str, ...]
    columns: tuple[str, ...]

    @classmethod
    def of(cls, lines: Sequence[Line]) -> Sorting:
        """How to sort some lines."""
        columns = []
        for name in ("constraints", "setting"):
            values = {(line.method, getattr(line, name)) for line in lines}
            methods, several = len({method for method, _ in values}), len({value for _, value in values}) > 1
            if several and len(values) == methods:
                columns.append(name)
        return cls(tuple(name for name in _CIRCUMSTANCES if name not in columns), tuple(columns))

    def groups(self, lines: Iterable[Line]) -> dict[str, list[Line]]:
        """Lines by the title of their group, groups in the order in which they first come."""
        found: dict[str, list[Line]] = {}
        for line in lines:
            found.setdefault(circumstances(line, self.headings), []).append(line)
        return found


_CIRCUMSTANCES: dict[str, Callable[[str], str]] = {
    "constraints": constraints_name,
    "setting": lambda setting: f"setting {plain(setting)}" if setting else "",
    "items": lambda items: {ALL: "", UNSEEN: "only items that nothing was tuned on"}.get(items, plain(items)),
    "world": lambda world: f"{plain(world)} world" if world else "",
}


def circumstances(thing: Line | Comparison, names: Iterable[str] = tuple(_CIRCUMSTANCES)) -> str:
    """What a line or a comparison is of, in words."""
    words = (_CIRCUMSTANCES[name](getattr(thing, name)) for name in names)
    return " · ".join(word for word in words if word)


def results_table(result: Result) -> Table:
    """The lines of a result, the paper's values beside ours."""
    lines = result.lines
    sorting = Sorting.of(lines)
    paper = any(line.paper_success is not None for line in lines)
    paper_s = any(line.paper_s is not None for line in lines)
    names = list(dict.fromkeys(name for line in lines for name in line.figures))
    columns = [Column("method", "name"), *(Column(name, "name") for name in sorting.columns)]
    columns += [Column("orders"), Column("success, %"), Column("95 % interval, %")]
    columns += [Column("paper, %", "paper")] * paper
    columns += [Column("CPU-s, median"), Column("CPU-s, mean"), Column("CPU-s, most")]
    columns += [Column("paper, s", "paper"), Column("ratio, paper / ours", "paper")] * paper_s
    columns += [_figure_column(name, lines) for name in names]

    def cells(line: Line) -> tuple[Cell, ...]:
        texts = [method_name(line.method)]
        texts += [
            _CIRCUMSTANCES[name](getattr(line, name)).removeprefix("setting ") for name in sorting.columns
        ]
        texts += [f"{line.n:,}", percent(line.success, line.n), interval(line.ci95, line.n)]
        texts += [percent(line.paper_success)] * paper
        texts += [number(float(s)) for s in (line.cpu_s_median, line.cpu_s_mean, line.cpu_s_max)]
        texts += [number(line.paper_s), number(times_faster(line))] * paper_s
        texts += [number(line.figures.get(name)) for name in names]
        return tuple(Cell(text) for text in texts)

    groups = (Group(title, tuple(map(cells, some))) for title, some in sorting.groups(lines).items())
    return Table("", tuple(columns), tuple(groups))


def _figure_column(name: str, lines: Sequence[Line]) -> Column:
    words = any(isinstance(line.figures.get(name), str) for line in lines)
    return Column(plain(name), "paper" if name.startswith(PAPER) else "name" if words else "")


PAPER = "paper: "
"""Before the name of a figure that is the paper's."""


def times_faster(line: Line) -> float | None:
    """The paper's mean seconds by our mean CPU-seconds; None where one of them is not known."""
    if line.paper_s is None or not line.cpu_s_mean > 0.0:
        return None
    return line.paper_s / line.cpu_s_mean


def comparisons_table(result: Result) -> Table:
    """Differences between methods on the same orders, and which of them are significant."""
    columns = (
        Column("methods", "name"),
        Column("orders"),
        Column("first alone, orders"),
        Column("second alone, orders"),
        Column("difference, points (95 % interval)"),
        Column("p, McNemar"),
        Column("p, Holm"),
        Column("significant", "name"),
        Column("CPU-s, first / second (95 % interval)"),
    )
    groups: dict[str, list[tuple[Cell, ...]]] = {}
    for c, p in zip(result.comparisons, adjusted(result), strict=True):
        texts = (
            f"{method_name(c.a)} against {method_name(c.b)}",
            f"{c.n:,}",
            f"{c.a_only:,}",
            f"{c.b_only:,}",
            f"{percent(c.difference, c.n, sign=True)} ({interval(c.difference_ci95, c.n, sign=True)})",
            chance(c.p),
            chance(p),
            "yes" if p < SIGNIFICANT else "no",
            f"{number(c.time_ratio)} ({number(c.time_ratio_ci95[0])} to {number(c.time_ratio_ci95[1])})",
        )
        groups.setdefault(circumstances(c), []).append(tuple(map(Cell, texts)))
    return Table("", columns, tuple(Group(title, tuple(rows)) for title, rows in groups.items()))


SIGNIFICANT = 0.05
"""A difference whose adjusted p-value is below this is called significant."""


def adjusted(result: Result) -> list[float]:
    """The p-values of a result's comparisons, adjusted over all of them (Holm)."""
    return holm([comparison.p for comparison in result.comparisons])


def failures_table(result: Result, links: dict[str, str], most: int) -> Table:
    """The first orders that were not packed or not carried out, and how many more there are.

    Args:
        result: what has them.
        links: address of a page by the key of its row.
        most: how many are listed.
    """
    columns = (
        Column("order"),
        Column("method", "name"),
        Column("of", "name"),
        Column("why", "text"),
        Column("plan", "name"),
    )
    rows = []
    for f in result.failures[:most]:
        words = [_CIRCUMSTANCES[name](getattr(f, name)) for name in ("constraints", "setting", "items")]
        shown = Cell("look at it", links[f.key]) if f.key in links else Cell(DASH)
        texts = (number(f.index), method_name(f.method), " · ".join(filter(None, words)), plain(f.why))
        rows.append((*map(Cell, texts), shown))
    more = len(result.failures) - len(rows)
    title = f"{count(len(result.failures), 'failure')}{f', the first {most} of them' if more else ''}"
    return Table(title, columns, (Group("", tuple(rows)),))
