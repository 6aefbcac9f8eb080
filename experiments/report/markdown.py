"""A document as Markdown, as GitHub shows it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from .document import PICTURES, PLOTS, Block, Command, Document, Gallery, Heading, Plots, Points, Text
from .tables import Cell, Column, Table
from .words import plain

_SPECIAL = re.compile(r"([\\`*_\[\]<>#|~$])")


def markdown_text(document: Document) -> str:
    """The document as text of its own; plots and pictures are files beside it."""
    parts = [f"# {escaped(document.title)}"]
    for section in document.sections:
        parts.append(f"## {escaped(section.title)}")
        parts += [part for block in section.blocks for part in _block(block)]
    return "\n\n".join(parts) + "\n"


def escaped(text: str) -> str:
    """Some text that Markdown shows as it is."""
    return _SPECIAL.sub(r"\\\1", plain(text)).replace("&", "&amp;").replace("://", ":&#47;&#47;")


def _block(block: Block) -> list[str]:
    match block:
        case Text():
            return [escaped(block.text)]
        case Heading():
            return [f"### {escaped(block.text)}"]
        case Points():
            return ["\n".join(f"- {escaped(item)}" for item in block.items)]
        case Command():
            # Indented code has no end that a line could write.
            return ["\n".join(f"    {line}" for line in block.lines)]
        case Plots():
            return [_picture(f"{PLOTS}/{plot.name}.svg", plot.caption) for plot in block.plots]
        case Gallery():
            return [_picture(f"{PICTURES}/{shot.name}.png", shot.caption) for shot in block.shots]
        case Table():
            return _table(block)


def _picture(address: str, caption: str) -> str:
    return f"![{escaped(caption)}]({address})\n\n*{escaped(caption)}*"


def _table(table: Table) -> list[str]:
    parts = [escaped(table.title)] if table.title else []
    for group in table.groups:
        parts += [f"**{escaped(group.title)}**"] * bool(group.title)
        head = _row(escaped(column.title) for column in table.columns)
        sides = _row(":--" if column.mark in ("name", "text") else "--:" for column in table.columns)
        parts.append("\n".join([head, sides, *(_row(_cells(row, table.columns)) for row in group.rows)]))
    return parts


def _cells(row: Sequence[Cell], columns: Sequence[Column]) -> Iterable[str]:
    for cell, column in zip(row, columns, strict=True):
        text = escaped(cell.text)
        if cell.link:
            yield f"[{text}]({cell.link})"
        else:
            yield f"*{text}*" if column.mark == "paper" else text


def _row(texts: Iterable[str]) -> str:
    return f"| {' | '.join(texts)} |"
