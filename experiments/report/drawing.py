"""What all plots share: style, colours, and which lines of a table stand in one plot.

Colours are those of Okabe and Ito, which the colour-blind tell apart; a method has the same one in all plots, and
what a colour says, a marker or a dash says as well.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..results import Line
from .tables import Sorting, circumstances
from .words import method_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#1c2733", "#B07D00", "#56B4E9")
DASHES = ("-", (0, (6, 1.5)), (0, (4, 1.2, 1, 1.2)), (0, (2, 1)), (0, (8, 1.5, 1, 1.5, 1, 1.5)), (0, (1, 1)))
MARKERS = ("o", "s", "^", "v")
STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "robotpack",
    "text.parse_math": False,
    "font.size": 9.5,
    "axes.edgecolor": "#5a6776",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": "#e3e7ec",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
}
_METHODS = ("hm", "dblf", "mta", "minz", "auto", "gls")
_WIDTH = 5.0
"""Inches: so narrow that letters stay legible on a telephone."""
_LONGEST_NAME, _LONGEST_LEGEND = 26, 36


def empty_plot(height: float, **words: Any) -> tuple[Figure, Axes]:
    """A figure of some height, inches, and its axes."""
    from matplotlib.figure import Figure  # no window, so no backend that needs a display

    figure = Figure(figsize=(_WIDTH, height), layout="constrained")
    axes: Axes = figure.add_subplot(**words)
    return figure, axes


def svg_of(figure: Figure) -> str:
    """The figure as SVG; the same figure gives the same text."""
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None})
    return re.sub(r"\s*<metadata>.*?</metadata>", "", stream.getvalue(), flags=re.DOTALL)


def legend(figure: Figure, axes: Axes) -> None:
    """Below the plot, where it covers nothing."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        letters = sum(len(label) + 6 for label in labels)
        columns = (
            len(labels) if letters <= 1.7 * _LONGEST_LEGEND else 3 if letters <= 3 * _LONGEST_LEGEND else 2
        )
        figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def mark_paper(axes: Axes, values: Sequence[float], heights: Sequence[float]) -> None:
    """Mark what the paper reports, as nothing of ours is marked."""
    look: Any = {"markersize": 8, "markeredgewidth": 1.2, "markerfacecolor": "none"}
    axes.plot(values, heights, "D", color="#1c2733", label="paper", **look)


def label_of(method: str) -> str:
    """Name of a method, cut where it would fill the plot."""
    name = method_name(method)
    return name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 1]}…"


def colours_of(methods: Sequence[str]) -> dict[str, str]:
    """A colour for each method, the same in all plots for those that the paper or RobotPack names."""
    known = dict(zip(_METHODS, COLOURS, strict=False))
    taken = {known.get(method) for method in methods}
    free = [colour for colour in COLOURS if colour not in taken] or list(COLOURS)
    others = [method for method in methods if method not in known]
    return {**known, **{method: free[k % len(free)] for k, method in enumerate(others)}}


@dataclass(frozen=True)
class Panel:
    """Lines of a table that stand in one plot.

    Attributes:
        title: what they have in common.
        series: name of the attribute that tells them apart beside the method; empty where none does.
        lines: in the table's sequence.
    """

    title: str
    series: str
    lines: tuple[Line, ...]

    @property
    def methods(self) -> list[str]:
        """Names of its methods."""
        return list(dict.fromkeys(line.method for line in self.lines))

    @property
    def values(self) -> list[str]:
        """What tells its lines apart."""
        return list(dict.fromkeys(self.value(line) for line in self.lines))

    @property
    def height(self) -> float:
        """Of a plot with a row for each method, inches."""
        return 1.1 + len(self.methods) * (0.27 + 0.15 * len(self.values))

    def value(self, line: Line) -> str:
        """What tells a line apart beside its method."""
        return circumstances(line, [self.series]) if self.series else ""

    def place(self, line: Line) -> float:
        """Height of a line in the plot: methods from the top, what differs within one beside each other."""
        middle = (len(self.values) - 1) / 2
        return (middle - self.values.index(self.value(line))) * self.step - self.methods.index(line.method)

    @property
    def step(self) -> float:
        """Between lines of one method."""
        return 0.5 / max(len(self.values), 1)

    def name_rows(self, axes: Axes) -> None:
        """Write methods' names at the left, and shade every second row."""
        axes.set_yticks([-m for m in range(len(self.methods))], [label_of(method) for method in self.methods])
        axes.set_ylim(-len(self.methods) + 0.5, 0.5)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="x")
        for m in range(1, len(self.methods), 2):
            axes.axhspan(-m - 0.5, -m + 0.5, color="#f4f6f8", lw=0, zorder=0)


def panels_of(lines: Sequence[Line]) -> list[Panel]:
    """One for each heading of the table, but for worlds or settings, which stand in one plot."""
    headings = Sorting.of(lines).headings
    varied = [name for name in headings if len({getattr(line, name) for line in lines}) > 1]
    series = next((name for name in ("world", "setting") if name in varied), "")
    groups: dict[str, list[Line]] = {}
    for line in lines:
        title = circumstances(line, [name for name in headings if name != series])
        groups.setdefault(title, []).append(line)
    return [Panel(title, series, tuple(some)) for title, some in groups.items()]
