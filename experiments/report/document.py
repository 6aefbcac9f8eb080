"""What a report holds, before anyone decides how it looks: HTML and Markdown lay the same document out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from .tables import Table


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Points:
    """A list of sentences."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Command:
    """What to type into a terminal, a line each."""

    lines: tuple[str, ...]


@dataclass(frozen=True)
class Heading:
    """A heading inside a section."""

    text: str


@dataclass(frozen=True)
class Plot:
    """A plot.

    Attributes:
        name: of its file, without the ending.
        caption: what it shows and how to read it.
        svg: the picture, a file by itself.
    """

    name: str
    caption: str
    svg: str


@dataclass(frozen=True)
class Plots:
    """Plots beside each other where there is room."""

    plots: tuple[Plot, ...]


@dataclass(frozen=True)
class Shot:
    """A picture of a packed box.

    Attributes:
        name: of its file, without the ending.
        caption: what it shows.
        png: the picture.
    """

    name: str
    caption: str
    png: bytes


@dataclass(frozen=True)
class Gallery:
    """Pictures beside each other where there is room.

    Attributes:
        shots: the pictures.
        large: each as wide as the page.
    """

    shots: tuple[Shot, ...]
    large: bool = False


Block: TypeAlias = Text | Points | Command | Heading | Table | Plots | Gallery


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Attributes:
        anchor: its name in an address.
        title: its heading.
        blocks: from the top.
    """

    anchor: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Document:
    """A report."""

    title: str
    sections: tuple[Section, ...]


PLOTS, PICTURES, PAGES = "report/plots", "report/pictures", "report/pages"
"""Folders beside the report's files, of what Markdown shows and what both link to."""
