"""Plots of results: success, time, routes, and how far items move when they are let go."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..experiment import Row
from ..results import Line, Result
from .document import Plot
from .drawing import (
    COLOURS,
    DASHES,
    MARKERS,
    PAPER,
    STYLE,
    Panel,
    colours_of,
    empty_plot,
    label_of,
    legend,
    panels_of,
    svg_of,
)
from .tables import circumstances
from .words import constraints_name, count, number, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    Drawn: TypeAlias = tuple[str, str, Figure]
    """Name, caption and picture."""


_LINE = ("method", "constraints", "setting", "items")
"""What rows and their line have in common."""


def plots_of(result: Result, rows: Sequence[Row]) -> tuple[Plot, ...]:
    """All plots of an experiment; those for which there is nothing to show are left out."""
    import matplotlib as mpl

    names: Counter[str] = Counter()
    plots = []
    with mpl.rc_context(STYLE):
        for name, caption, figure in _drawn(result, rows):
            names[name] += 1
            file = re.sub(r"[^A-Za-z0-9.-]+", "-", result.experiment)[:60]
            plots.append(Plot(f"{file}-{name}-{names[name]}", caption, svg_of(figure)))
    return tuple(plots)


def _drawn(result: Result, rows: Sequence[Row]) -> Iterator[Drawn]:
    for panel in panels_of(result.lines):
        yield _success(panel)
    if any(line.world for line in result.lines):
        for name, word in (("drop_m", "drop"), ("shift_m", "horizontal shift")):
            for panel in panels_of(result.lines):
                yield from _moves(panel, rows, name, word)
    else:
        yield from _times(result, rows)
    if result.experiment == "fallback":
        yield from _routes(rows)


def _success(panel: Panel) -> Drawn:
    """Success by method with intervals, and what the paper reports."""
    lines = panel.lines
    figure, axes = empty_plot(panel.height, xlabel="success, %")
    panel.name_rows(axes)
    for v, value in enumerate(panel.values):
        some = [line for line in lines if panel.value(line) == value]
        ours = np.array([100.0 * line.success for line in some])
        ends = 100.0 * np.array([line.ci95 for line in some]).T
        axes.errorbar(
            ours,
            [panel.place(line) for line in some],
            xerr=np.maximum([ours - ends[0], ends[1] - ours], 0.0),
            fmt=MARKERS[v % len(MARKERS)],
            color=COLOURS[v % len(COLOURS)],
            markersize=5.5,
            capsize=2.5,
            elinewidth=1.4,
            label=value or "RobotPack",
        )
    told: dict[tuple[str, float], list[float]] = {}
    for line in lines:
        if line.paper_success is not None:
            told.setdefault((line.method, line.paper_success), []).append(panel.place(line))
    if told:
        axes.plot(
            [100.0 * share for _, share in told],
            [float(np.mean(heights)) for heights in told.values()],
            "D",
            color=PAPER,
            markerfacecolor="none",
            markersize=8,
            markeredgewidth=1.2,
            label="paper",
        )
    least = min(100.0 * min(line.ci95[0], *(share for _, share in told), line.success) for line in lines)
    axes.set_xlim(max(-2.0, least - 0.06 * (100.0 - least) - 0.3), 100.0 + 0.04 * (100.0 - least) + 0.2)
    legend(figure, axes)
    orders = {line.n for line in lines}
    each = f"{count(orders.pop(), 'order')} each" if len(orders) == 1 else "orders as in the table"
    what = ", ".join(filter(None, ("Success with 95 % intervals", panel.title)))
    return "success", f"{what}; {each}.{' Diamonds: what the paper reports.' if told else ''}", figure


def _times(result: Result, rows: Sequence[Row]) -> Iterator[Drawn]:
    """How CPU time is distributed, a plot for each group of the table, and the paper's means."""
    for title, shown in _seconds(result, rows).items():
        figure, axes = empty_plot(2.9, xlabel="CPU-seconds a plan", ylabel="share of plans, %", xscale="log")
        colours = colours_of([line.method for line, _ in shown])
        for k, (line, found) in enumerate(shown):
            seconds = np.sort(np.maximum(found, 1e-6))
            share = 100.0 * np.arange(len(seconds) + 1) / len(seconds)
            look: Any = {"color": colours[line.method], "ls": DASHES[k % len(DASHES)]}
            axes.step(
                [seconds[0], *seconds], share, where="post", lw=1.6, label=label_of(line.method), **look
            )
            if line.paper_s is not None:
                axes.axvline(line.paper_s, lw=1.2, **look)
        axes.set_ylim(0.0, 102.0)
        axes.grid()
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        told = [(line.paper_s, label_of(line.method)) for line, _ in shown if line.paper_s is not None]
        if told:
            axes.annotate(
                "paper's means",
                (min(told)[0], 50.0),
                (-4, 0),
                textcoords="offset points",
                ha="right",
                va="center",
                rotation=90,
                fontsize=8.5,
            )
        legend(figure, axes)
        plans = sorted({len(found) for _, found in shown})
        each = " to ".join(f"{n:,}" for n in dict.fromkeys((plans[0], plans[-1])))
        paper = ", ".join(f"{name} {number(s)} s" for s, name in told)
        caption = f"Share of plans that took no longer, {title}; {each} plans a method."
        yield "time", caption + (f" Upright lines: the paper's means ({paper})." if told else ""), figure


def _seconds(result: Result, rows: Sequence[Row]) -> dict[str, list[tuple[Line, list[float]]]]:
    """CPU-seconds of each plan behind each line, by the title of the line's group."""
    by_line: dict[tuple[str, ...], list[float]] = {}
    for row in rows:
        if isinstance(row.get("cpu_s"), int | float):
            by_line.setdefault(tuple(row[name] for name in _LINE), []).append(float(row["cpu_s"]))
    found: dict[str, list[tuple[Line, list[float]]]] = {}
    for line in result.lines:
        if seconds := by_line.get(tuple(getattr(line, name) for name in _LINE)):
            found.setdefault(circumstances(line), []).append((line, seconds))
    return found


def _routes(rows: Sequence[Row]) -> Iterator[Drawn]:
    """Which way items found their places, of orders that were packed whole."""
    counts: dict[str, Counter[str]] = {}
    for row in rows:
        if row.get("complete"):
            name = (
                f"{label_of(row['method'])}, {constraints_name(row['constraints'])}, {plain(row['setting'])}"
            )
            counts.setdefault(name, Counter()).update(row["routes"])
    if not counts:
        return
    figure, axes = empty_plot(
        1.2 + 0.42 * len(counts), xlabel="items that the fallback placed, % of all items"
    )
    axes.set_yticks([-k for k in range(len(counts))], list(counts))
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x")
    for k, found in enumerate(counts.values()):
        left = 0.0
        for route, label, colour in (
            ("later", "later in the sequence", "#56B4E9"),
            ("5d", "5D search", "#0b3d66"),
        ):
            share = 100.0 * found[route] / found.total()
            axes.barh(-k, share, 0.55, left, color=colour, label=label if k == 0 else None)
            left += share
    legend(figure, axes)
    of_all = " and ".join(sorted({f"{found.total():,}" for found in counts.values()}))
    caption = f"Items that found no place in the first pass, by the way they found one; of {of_all} items."
    yield "routes", caption, figure


def _moves(panel: Panel, rows: Sequence[Row], name: str, word: str) -> Iterator[Drawn]:
    """How far items fall or slide, by method and world."""
    lengths = [(line, 100.0 * np.array(_released(rows, line, name))) for line in panel.lines]
    if not any(len(some) for _, some in lengths):
        return
    figure, axes = empty_plot(panel.height, xlabel=f"{word}, cm")
    panel.name_rows(axes)
    labelled: set[str] = set()
    for line, some in lengths:
        if not len(some):
            continue
        value, at = panel.value(line), panel.place(line)
        v = panel.values.index(value)
        colour = COLOURS[v % len(COLOURS)]
        low, first, median, third, high = np.percentile(some, [5, 25, 50, 75, 95])
        axes.plot([low, high], [at, at], color=colour, lw=1.2)
        axes.barh(at, third - first, 0.6 * panel.step, first, color=colour, alpha=0.5)
        axes.plot([median, median], [at - 0.3 * panel.step, at + 0.3 * panel.step], color=colour, lw=2.0)
        label = None if value in labelled else value or "RobotPack"
        mark = MARKERS[v % len(MARKERS)]
        axes.plot(some.mean(), at, mark, color=colour, markersize=5.5, markeredgecolor="white", label=label)
        labelled.add(value)
    legend(figure, axes)
    what = ", ".join(filter(None, (f"{word.capitalize()} of all released items", panel.title)))
    caption = f"{what}: mean (marker), median, middle half (bar), 5 to 95 % (line)."
    yield name.removesuffix("_m"), caption, figure


def _released(rows: Sequence[Row], line: Line, name: str) -> list[float]:
    """Of all items released in the executions behind a line, m."""
    found: list[float] = []
    for row in rows:
        same = all(
            row[field] == getattr(line, field) for field in ("method", "constraints", "setting", "items")
        )
        world: Mapping[str, Any] | None = row.get(line.world) if same else None
        if isinstance(world, Mapping):
            found += world.get(name) or []
    return found
