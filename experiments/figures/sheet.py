"""Pictures beside each other with their words, and the files of a figure."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from packenv.io.files import write_whole
from packenv.types import Plan
from packenv.view.colours import hex_colour, item_colour
from packenv.view.painter import Image
from packenv.view.words import piece_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 100
"""Pixels an inch."""
TEXT, FAINT, WASTE = "#28303c", "#5b6675", "#c8324f"
"""Colours of words, of less important ones, and of what is wasted or wrong."""

_GAP = 14
_TITLE, _LINE = 24, 17
_WIDE = 7.0
"""Width of a letter of the words below a picture, px."""


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture and its words.

    Attributes:
        picture: (height, width, 3) sRGB; of the same size in all panels of a sheet.
        title: above it.
        items: below it, the colour of each item and its name.
        notes: below these, a sentence or two each.
    """

    picture: Image
    title: str
    items: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()


def legend(plan: Plan) -> tuple[tuple[str, str], ...]:
    """Colours and names of a plan's items in packing sequence."""
    names = piece_names(plan.placements)
    return tuple((hex_colour(item_colour(k)), name) for k, name in enumerate(names))


def sheet(panels: Sequence[Panel], columns: int) -> Figure:
    """Panels in rows, each picture pixel by pixel.

    Args:
        panels: at least one.
        columns: how many are beside each other.
    """
    from matplotlib.figure import Figure

    high, wide = panels[0].picture.shape[:2]
    rows = [panels[k : k + columns] for k in range(0, len(panels), columns)]
    lines = [[_words(panel, wide) for panel in row] for row in rows]
    below = [max(len(words) for words in row) * _LINE for row in lines]
    width = columns * (wide + _GAP) + _GAP
    height = sum(_TITLE + high + words + _GAP for words in below) + _GAP
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")
    top = height - _GAP // 2
    for row, words, depth in zip(rows, lines, below, strict=True):
        for column, (panel, written) in enumerate(zip(row, words, strict=True)):
            left = _GAP + column * (wide + _GAP)
            _say(figure, left, top - _TITLE / 2, panel.title, size=10.5, weight="bold")
            base = top - _TITLE - high
            axes = figure.add_axes((left / width, base / height, wide / width, high / height))
            show_picture(axes, panel.picture)
            for number, line in enumerate(written):
                for offset, colour, text in line:
                    at = left + offset * wide, base - (number + 0.6) * _LINE
                    shift = 0
                    if colour:
                        _say(figure, *at, "■", size=11, color=colour)
                        shift = 15
                    _say(figure, at[0] + shift, at[1], text, size=8.5, color=TEXT if colour else FAINT)
        top -= _TITLE + high + depth + _GAP
    return figure


def _words(panel: Panel, wide: int) -> list[list[tuple[float, str, str]]]:
    """Lines below a picture: of each its words, with their place as a share of the width and a colour."""
    columns = 2 if len(panel.items) > 3 else 1
    per = -(-len(panel.items) // columns)
    longest = int((wide / columns - 18) / _WIDE)
    lines: list[list[tuple[float, str, str]]] = [[] for _ in range(per)]
    for number, (colour, name) in enumerate(panel.items):
        shown = name if len(name) <= longest else name[: longest - 1] + "…"
        lines[number % per].append((number // per / columns, colour, shown))
    for note in panel.notes:
        lines += [[(0.0, "", text)] for text in textwrap.wrap(note, int(wide / _WIDE))]
    return lines


def _say(figure: Figure, x: float, y: float, text: str, **how: Any) -> None:
    """Write words at a place in px from the lower left corner."""
    width, height = figure.get_size_inches() * DPI
    how = {"color": TEXT, **how}
    figure.text(x / width, y / height, text, ha="left", va="center", parse_math=False, **how)


def show_picture(axes: Axes, picture: Image) -> None:
    """Fill axes with a picture."""
    axes.imshow(picture, interpolation="none", aspect="auto")
    axes.set_axis_off()


def drawn(figure: Figure) -> Image:
    """A figure as a picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    picture: Image = np.asarray(canvas.buffer_rgba())[:, :, :3].copy()  # type: ignore[no-untyped-call]
    return picture


def save(figure: Figure, out: Path, name: str, *, vector: bool = False) -> tuple[Path, ...]:
    """Write a figure, the same bytes every time.

    Args:
        figure: to write.
        out: folder.
        name: of the files, without their ending.
        vector: write an SVG beside the PNG.

    Raises:
        InputError: a file cannot be written.
    """
    import matplotlib as mpl
    from PIL import Image as Pillow

    files = [out / f"{name}.png"]
    stream = io.BytesIO()
    # Without a palette: 256 colours are too few for ten items, and small ones lose theirs.
    Pillow.fromarray(drawn(figure)).save(stream, format="PNG", optimize=True)
    write_whole(files[0], stream.getvalue())
    if vector:
        files.append(out / f"{name}.svg")
        stream = io.BytesIO()
        with mpl.rc_context({"svg.hashsalt": "robotpack", "svg.fonttype": "none"}):
            figure.savefig(stream, format="svg", dpi=DPI, metadata={"Date": None})
        write_whole(files[1], stream.getvalue())
    return tuple(files)
