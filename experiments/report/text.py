"""The table of a result for a terminal."""

from __future__ import annotations

import textwrap
import unicodedata
from collections.abc import Iterable, Sequence

from ..results import Result
from .sentences import broken_words, verdict
from .tables import Column, Table, results_table
from .words import plain

_WIDE = 119


def text_table(result: Result) -> str:
    """The lines of a result under their groups, aligned, and what is to be said of them."""
    parts = [plain(result.title), *_table_lines(results_table(result))]
    said = [*verdict(result), *map(plain, result.remarks), *broken_words(result)]
    parts += [line for text in said for line in textwrap.wrap(text, _WIDE, subsequent_indent="  ")]
    return "\n".join(parts)


def _table_lines(table: Table) -> list[str]:
    if not any(group.rows for group in table.groups):
        return ["  no orders to tell of"]
    rows = [tuple(cell.text for cell in row) for group in table.groups for row in group.rows]
    heads = [
        _heading(column.title, texts)
        for column, texts in zip(table.columns, zip(*rows, strict=True), strict=True)
    ]
    height = max(map(len, heads))
    above = list(zip(*([""] * (height - len(head)) + head for head in heads), strict=True))
    widths = [max(map(_cells, column)) for column in zip(*above, *rows, strict=True)]
    lines = [_line(texts, widths, table.columns) for texts in above]
    for group in table.groups:
        lines += [f"[{group.title}]"] * bool(group.title)
        lines += [_line([cell.text for cell in row], widths, table.columns) for row in group.rows]
    return lines


def _heading(title: str, texts: Iterable[str]) -> list[str]:
    """A column's heading in lines no longer than its figures or its longest word, the unit in a line of its own."""
    name, _, unit = title.partition(", ")
    width = max(map(_cells, [*texts, *title.split()]))
    return [
        *textwrap.wrap(name, width, break_long_words=False),
        *textwrap.wrap(unit, width, break_long_words=False),
    ]


def _line(texts: Sequence[str], widths: Sequence[int], columns: Sequence[Column]) -> str:
    """Names to the left, figures to the right."""
    padded = []
    for text, width, column in zip(texts, widths, columns, strict=True):
        space = " " * (width - _cells(text))
        padded.append(text + space if column.mark == "name" else space + text)
    return "  ".join(padded).rstrip()


def _cells(text: str) -> int:
    """Columns of a terminal that a text takes: two for a wide character, none for one that combines."""
    wide = sum(2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)
    return wide - sum(unicodedata.combining(c) != 0 for c in text)
