"""The table of a result for a terminal."""

from __future__ import annotations

import textwrap
import unicodedata

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
        return ["  no orders yet"]
    # A heading has two lines, the second for the unit, so that a column is no wider than its figures ask for.
    above, _, below = zip(*(column.title.partition(", ") for column in table.columns), strict=True)
    rows = [tuple(cell.text for cell in row) for group in table.groups for row in group.rows]
    widths = [max(map(_cells, column)) for column in zip(above, below, *rows, strict=True)]
    lines = [_line(above, widths, table.columns), _line(below, widths, table.columns)]
    for group in table.groups:
        lines += [f"[{group.title}]"] * bool(group.title)
        lines += [_line([cell.text for cell in row], widths, table.columns) for row in group.rows]
    return lines


def _line(texts: tuple[str, ...] | list[str], widths: list[int], columns: tuple[Column, ...]) -> str:
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
