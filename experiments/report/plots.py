"""Plots of results: success, time, routes, and how far items move when they are let go."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from packenv.types import FloatArray

from ..experiment import Row
from ..planning_tables import PAPER_FALLBACK, search_named
from ..results import Line, Result
from .document import Plot
from .drawing import (
    COLOURS,
    DASHES,
    MARKERS,
    STYLE,
    Panel,
    colours_of,
    empty_plot,
    label_of,
    legend,
    mark_paper,
    panels_of,
    svg_of,
)
from .tables import PAPER, circumstances
from .words import count, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    _Drawn: TypeAlias = tuple[str, str, Figure]
    """Name, caption and picture."""

_Behind: TypeAlias = tuple[Line, Sequence[Row]]
"""A line, and the rows of its method and circumstances."""


_STEPS = 400
"""Steps of a curve at most: more are not seen, and make a page of 10,000 orders slow."""


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


def _drawn(result: Result, rows: Sequence[Row]) -> Iterator[_Drawn]:
    behind = _rows_by_line(result, rows)
    if result.experiment == "fallback":  # its success and times are those of the heuristics
        yield from _routes(behind, as_paper=result.spec.as_paper)
        return
    for panel in panels_of(result.lines):
        yield _success(panel)
    if any(line.world for line in result.lines):
        for name in ("drop", "shift"):
            for panel in panels_of(result.lines):
                yield from _moves(panel, behind, name)
    else:
        yield from _times(behind)


def _rows_by_line(result: Result, rows: Sequence[Row]) -> list[_Behind]:
    found: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        if "error" not in row:
            method, setting = row["method"], row["setting"]
            if result.experiment == "search5d":
                method, setting = search_named(setting)
            found.setdefault((method, row["constraints"], setting, row["items"]), []).append(row)
    keys = [(line.method, line.constraints, line.setting, line.items) for line in result.lines]
    return [(line, found.get(key, [])) for line, key in zip(result.lines, keys, strict=True)]


def _success(panel: Panel) -> _Drawn:
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
        shares = [100.0 * share for _, share in told]
        mark_paper(axes, shares, [float(np.mean(heights)) for heights in told.values()])
    least = 100.0 * min(line.ci95[0] for line in lines)
    least = min([least, *(100.0 * share for _, share in told)])
    axes.set_xlim(max(-2.0, least - 0.06 * (100.0 - least) - 0.3), 100.0 + 0.04 * (100.0 - least) + 0.2)
    legend(figure, axes)
    orders = {line.n for line in lines}
    each = f"{count(orders.pop(), 'order')} each" if len(orders) == 1 else "orders as in the table"
    what = ", ".join(filter(None, ("Success with 95 % intervals", panel.title)))
    return "success", f"{what}; {each}.{' Diamonds: what the paper reports.' if told else ''}", figure


def _times(behind: Sequence[_Behind]) -> Iterator[_Drawn]:
    """How CPU time is distributed, a plot for each group of the table, and the paper's means."""
    groups: dict[str, list[tuple[Line, FloatArray]]] = {}
    for line, rows in behind:
        told = [row["cpu_s"] for row in rows if isinstance(row.get("cpu_s"), int | float)]
        if told:
            seconds = np.sort(np.maximum(told, 1e-6))
            groups.setdefault(circumstances(line), []).append((line, seconds))
    for title, shown in groups.items():
        figure, axes = empty_plot(2.9, xlabel="CPU-seconds a plan", ylabel="share of plans, %", xscale="log")
        colours = colours_of([line.method for line, _ in shown])
        for k, (line, seconds) in enumerate(shown):
            share = np.linspace(0.0, 1.0, min(len(seconds), _STEPS) + 1)
            steps = np.quantile(seconds, share[1:], method="inverted_cdf")
            look: Any = {"color": colours[line.method], "ls": DASHES[k % len(DASHES)]}
            axes.step(
                [seconds[0], *steps], 100.0 * share, where="post", lw=1.6, label=label_of(line.method), **look
            )
            if line.paper_s is not None:
                axes.axvline(line.paper_s, lw=1.2, **look)
        axes.set_ylim(0.0, 102.0)
        axes.grid()
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        told = [(line.paper_s, label_of(line.method)) for line, _ in shown if line.paper_s is not None]
        if told:
            place: Any = {"xytext": (-4, 0), "textcoords": "offset points", "ha": "right", "va": "center"}
            axes.annotate("paper's means", (min(told)[0], 50.0), rotation=90, fontsize=8.5, **place)
        legend(figure, axes)
        plans = sorted({len(seconds) for _, seconds in shown})
        each = " to ".join(f"{n:,}" for n in dict.fromkeys((plans[0], plans[-1])))
        paper = ", ".join(f"{name} {number(s)} s" for s, name in told)
        caption = f"Share of plans that took no longer, {title}; {each} of each method."
        yield "time", caption + (f" Upright lines: the paper's means ({paper})." if told else ""), figure


def _routes(behind: Sequence[_Behind], *, as_paper: bool) -> Iterator[_Drawn]:
    """Which way items found their places that found none in the first pass."""
    shares: dict[str, tuple[float, float]] = {}
    totals: set[int] = set()
    for line, rows in behind:
        found: Counter[str] = Counter()
        for row in rows:
            if row["complete"]:
                found.update(row["routes"])
        if found:
            name = f"{label_of(line.method)}, {circumstances(line, ('setting', 'items'))}"
            shares[name] = 100.0 * found["later"] / found.total(), 100.0 * found["5d"] / found.total()
            totals.add(found.total())
    if not shares:
        return
    if as_paper:
        late, later, tilted = PAPER_FALLBACK.values()
        shares["paper"] = late * later / 100.0, late * tilted / 100.0
    figure, axes = empty_plot(1.2 + 0.42 * len(shares), xlabel="items placed by the fallback, % of all items")
    heights = [-k for k in range(len(shares))]
    axes.set_yticks(heights, list(shares))
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x")
    lefts, rights = np.array(list(shares.values())).T
    axes.barh(heights, lefts, 0.55, color="#56B4E9", label="later in the sequence")
    axes.barh(heights, rights, 0.55, lefts, color="#0b3d66", label="5D search")
    legend(figure, axes)
    of_all = " and ".join(f"{total:,}" for total in sorted(totals))
    caption = f"Items that found no place in the first pass, by the way they found one; of {of_all} items."
    yield "routes", caption, figure


def _moves(panel: Panel, behind: Sequence[_Behind], name: str) -> Iterator[_Drawn]:
    """How far items fall or slide, by method and world."""
    lengths = [(line, _released(line, rows, f"{name}_m")) for line, rows in behind if line in panel.lines]
    lengths = [(line, some) for line, some in lengths if len(some)]
    if not lengths:
        return
    word = {"drop": "drop", "shift": "horizontal shift"}[name]
    figure, axes = empty_plot(panel.height, xlabel=f"{word}, cm")
    panel.name_rows(axes)
    labelled: set[str] = set()
    for line, some in lengths:
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
    told = [
        (paper, panel.place(line))
        for line, _ in lengths
        if isinstance(paper := line.figures.get(f"{PAPER}{name}, cm"), int | float)
    ]
    if told:
        mark_paper(axes, [paper for paper, _ in told], [at for _, at in told])
    legend(figure, axes)
    what = ", ".join(filter(None, (f"{word.capitalize()} of all released items", panel.title)))
    means = " Diamonds: the paper's means." if told else ""
    yield name, f"{what}: mean (marker), median, middle half (bar), 5 to 95 % (line).{means}", figure


def _released(line: Line, rows: Sequence[Row], name: str) -> FloatArray:
    """Of all items released in the executions behind a line, cm."""
    worlds = [row[line.world] for row in rows if isinstance(row.get(line.world), Mapping)]
    return 100.0 * np.array([length for world in worlds for length in world.get(name, ())])
