"""Reading small CSV tables strictly: a header, one record a line, no cell too many or too few."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from packenv.errors import InputError

MAX_BYTES = 32 * 2**20
"""Size of a table or order that is still read."""

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+")


@dataclass(frozen=True)
class Row:
    """One record of a table.

    Attributes:
        where: file and line, for messages.
        cells: text by column name, stripped.
        error: class of the errors raised about this row.
    """

    where: str
    cells: dict[str, str]
    error: type[InputError]

    def text(self, column: str) -> str:
        """A cell that must not be empty.

        Raises:
            InputError: it is empty (in the row's class of errors).
        """
        value = self.cells.get(column, "")
        if not value:
            raise self.error(f"{self.where}: column {column!r} is empty, every row needs one")
        return value

    def positive(self, column: str, unit: str) -> float:
        """A cell that must hold a finite number above 0.

        Raises:
            InputError: it holds something else (in the row's class of errors).
        """
        text = self.text(column)
        try:
            value = float(text)
        except ValueError:
            hint = ""
            if _DECIMAL_COMMA.fullmatch(text):
                hint = f", decimals take a point: {text.replace(',', '.')}"
            raise self.error(f"{self.where}: {column} is {text!r}, which is not a number{hint}") from None
        if not (math.isfinite(value) and value > 0):
            raise self.error(f"{self.where}: {column} is {text}, give {unit} above 0")
        return value


def read_text(path: Path, error: type[InputError], what: str) -> str:
    """Text of a small file in UTF-8, with or without a byte order mark.

    Args:
        path: the file.
        error: class of the errors.
        what: what the file is, for messages: "an order".

    Raises:
        InputError: no such file, too large, empty, or not UTF-8 text.
    """
    try:
        if not path.exists():
            raise error(f"{path}: no such file, give {what}")
        if not path.is_file():
            raise error(f"{path}: is not a file, give {what}")
        if path.stat().st_size > MAX_BYTES:
            raise error(f"{path}: more than {MAX_BYTES >> 20} MiB, too large for {what}")
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror})") from None
    except UnicodeDecodeError:
        raise error(f"{path}: is not text in UTF-8; save {what} as UTF-8") from None
    if "\0" in text:
        raise error(f"{path}: is not text, it holds zero bytes; give {what}")
    if not text.strip():
        raise error(f"{path}: the file is empty, give {what}")
    return text


def read_table(
    path: Path,
    text: str,
    required: Sequence[str],
    error: type[InputError],
    known: Sequence[str] | None = None,
) -> list[Row]:
    """Rows of a CSV table.

    Args:
        path: the file, for messages.
        text: its content.
        required: columns that must be there.
        error: class of the errors.
        known: the only columns that may be there; None allows any.

    Returns:
        The rows in sequence; blank lines are left out.

    Raises:
        InputError: a column is missing, unknown or there twice, or a row has another number of cells.
    """
    reader = csv.reader(io.StringIO(text), strict=True, skipinitialspace=True)
    header: list[str] | None = None
    rows: list[Row] = []
    wanted = ",".join(known or required)
    try:
        for record in reader:
            cells = [cell.strip() for cell in record]
            if not any(cells):
                continue
            where = f"{path}, line {reader.line_num}"
            if header is None:
                header = cells
                _check_header(path, header, required, wanted, error, known)
            elif len(cells) != len(header):
                hint = (
                    "; decimals take a point, text with a comma takes quotes"
                    if len(cells) > len(header)
                    else ""
                )
                raise error(
                    f"{where}: {len(cells)} cells where the header has {len(header)} "
                    f"({','.join(header)[:80]}){hint}"
                )
            else:
                rows.append(Row(where, dict(zip(header, cells, strict=True)), error))
    except csv.Error as problem:
        raise error(f"{path}, line {reader.line_num}: not a CSV table ({problem})") from None
    return rows


def _check_header(
    path: Path,
    header: list[str],
    required: Sequence[str],
    wanted: str,
    error: type[InputError],
    known: Sequence[str] | None,
) -> None:
    if len(header) == 1 and ";" in header[0]:
        raise error(f"{path}: its cells are separated by semicolons; separate them by commas: {wanted}")
    for column in required:
        if column not in header:
            raise error(
                f"{path}: no column {column!r} in its first line ({','.join(header)[:80]}); "
                f"the first line must name the columns: {wanted}"
            )
    for column in header:
        if header.count(column) > 1:
            raise error(f"{path}: column {column!r} is there twice, keep one")
        if known is not None and column not in known:
            raise error(f"{path}: unknown column {column!r}; the columns are {wanted}")
