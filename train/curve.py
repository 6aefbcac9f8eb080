"""The learning curve as an SVG picture: return on the held-out episodes over the steps of training."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = {"learned": "#0b62a4", "random": "#777777", "hm": "#c05020"}
_OTHER = "#557755"


def curve_svg(rows: Sequence[Mapping[str, Any]], baselines: Mapping[str, Mapping[str, Any]]) -> str:
    """The picture of :func:`curve_figure`; the same rows give the same text."""
    import matplotlib as mpl

    stream = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "robotpack"}):
        curve_figure(rows, baselines).savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()


def curve_figure(rows: Sequence[Mapping[str, Any]], baselines: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Draw the curve.

    Args:
        rows: at least one, by rising ``timesteps``, each with ``return``, ``return_ci95`` and ``episodes``.
        baselines: the same of other agents on the same episodes, by name; drawn as level lines.
    """
    from matplotlib.figure import Figure  # no window, so no backend that needs a display

    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.add_subplot(
        title=f"Mean return on {rows[-1]['episodes']} held-out episodes, 95 % interval",
        xlabel="steps of training",
    )
    steps = [row["timesteps"] for row in rows]
    ends = {name: (row["return"], _COLOURS.get(name, _OTHER)) for name, row in baselines.items()}
    for name, row in baselines.items():
        middle, half, colour = row["return"], row["return_ci95"], ends[name][1]
        axes.axhspan(middle - half, middle + half, color=colour, alpha=0.12, lw=0)
        axes.axhline(middle, color=colour, ls="--", label=name)
    means = [row["return"] for row in rows]
    low, high = ([row["return"] + sign * row["return_ci95"] for row in rows] for sign in (-1, 1))
    axes.fill_between(steps, low, high, color=_COLOURS["learned"], alpha=0.15, lw=0)
    axes.plot(steps, means, ".-", color=_COLOURS["learned"], label="learned")
    for name, (height, colour) in {**ends, "learned": (means[-1], _COLOURS["learned"])}.items():
        at = (1.0, height)  # at the right edge, at the height of the value
        axes.annotate(
            name, at, (6, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
            va="center", color=colour, annotation_clip=False, parse_math=False,
        )  # fmt: skip
    axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.grid(axis="y", color="#e4e4e4")
    axes.spines[["top", "right"]].set_visible(False)
    return figure
