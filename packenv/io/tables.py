"""Reading small tables strictly: a header, one record a line, no cell too many or too few.

Cells are separated by commas, semicolons or tabs, text is in UTF-8 or UTF-16, as spreadsheet programs write it.
"""

from __future__ import annotations

import codecs
import csv
import io
import math
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from packenv.errors import InputError, closest_match
from packenv.types import normal_name

MAX_BYTES = 32 * 2**20
"""Size of a table or order that is still read."""

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+")


_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
"""One and a bit, or one thousand and more: where commas are decimal cannot be told from this."""

_OWN = "_"
"""A column whose name begins so is the user's, and not read."""

_SAVE = "save it as 'CSV UTF-8' and give that file"


@dataclass(frozen=True)
class Columns:
    """The columns of a kind of table.

    Attributes:
        required: must be there.
        optional: may be there.
        remarks: may be there, for people; nothing reads them.
        aliases: other names of columns, each with the one that it stands for.
    """

    required: tuple[str, ...]
    optional: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    aliases: Mapping[str, str] = field(default_factory=dict)

    @property
    def read(self) -> tuple[str, ...]:
        """Those that mean something."""
        return (*self.required, *self.optional)

    def check(self, path: Path, header: Sequence[str], error: type[InputError]) -> None:
        """Refuse a header.

        Raises:
            InputError: a column is missing, unknown, without a name or there twice.
        """
        first, wanted = ",".join(header)[:80], ",".join(self.read)
        hints = {
            column: closest_match(
                column,
                (*self.read, *self.remarks),
                f"; the columns are {wanted}; your own begin with {_OWN!r}",
            )
            for column in header
            if column and column not in (*self.read, *self.remarks) and not column.startswith(_OWN)
        }
        meant = "".join(hints.values())
        for column in self.required:
            if column not in header and f"mean {column!r}" not in meant:
                raise error(
                    f"{path}: no column {column!r} in its first line ({first}); "
                    f"the first line must name the columns: {wanted}"
                )
        for column, hint in hints.items():
            raise error(f"{path}: unknown column {column[:40]!r}{hint}")
        for number, column in enumerate(header, start=1):
            if not column:
                raise error(
                    f"{path}: column {number} has no name in the first line ({first}), name it or delete it"
                )
            if header.count(column) > 1:
                raise error(f"{path}: column {column!r} is there twice, keep one")


@dataclass(frozen=True)
class Row:
    """One record of a table.

    Attributes:
        where: file and line, for messages.
        cells: text by column name, stripped.
        error: class of the errors raised about this row.
        separator: between its cells; where it is no comma, decimals may take one.
    """

    where: str
    cells: dict[str, str]
    error: type[InputError]
    separator: str = ","

    def text(self, column: str) -> str:
        """A cell that must not be empty.

        Raises:
            InputError: it is empty (in the row's class of errors).
        """
        value = self.cells.get(column, "")
        if not value:
            raise self.error(f"{self.where}: column {column!r} is empty, every row needs one")
        return value

    def name(self, column: str) -> str:
        """A cell that names a thing, as names are compared.

        Raises:
            InputError: it is empty (in the row's class of errors).
        """
        return normal_name(self.text(column))

    def number(self, column: str) -> float:
        """A cell that must hold a finite number.

        Raises:
            InputError: it holds something else (in the row's class of errors).
        """
        text = self.text(column)
        try:
            value = float(text.replace(",", ".") if self._decimal_comma(text) else text)
        except ValueError:
            hint = ""
            if _DECIMAL_COMMA.fullmatch(text):
                hint = f", decimals take a point: {text.replace(',', '.')}"
            raise self.error(f"{self.where}: {column} is {text!r}, which is not a number{hint}") from None
        if not math.isfinite(value):
            raise self.error(f"{self.where}: {column} is {text}, give a finite number")
        return value

    def positive(self, column: str, unit: str) -> float:
        """A cell that must hold a finite number above 0.

        Raises:
            InputError: it holds something else (in the row's class of errors).
        """
        value = self.number(column)
        if not value > 0:
            raise self.error(f"{self.where}: {column} is {self.text(column)}, give {unit} above 0")
        return value

    def _decimal_comma(self, text: str) -> bool:
        """Whether a number's comma is a decimal one: with semicolons always, with tabs where it is no thousands'."""
        thousands = self.separator == "\t" and _THOUSANDS.fullmatch(text) is not None
        return self.separator != "," and _DECIMAL_COMMA.fullmatch(text) is not None and not thousands


def read_text(path: Path, error: type[InputError], what: str) -> str:
    """Text of a small file in UTF-8, with or without a byte order mark, or in UTF-16 with one.

    Args:
        path: the file.
        error: class of the errors.
        what: what the file is, for messages: "an order".

    Raises:
        InputError: no such file, too large, empty, or not such text.
    """
    try:
        if not path.exists():
            raise error(f"{path}: no such file, give {what}")
        if not path.is_file():
            raise error(f"{path}: is not a file, give {what}")
        if path.stat().st_size > MAX_BYTES:
            raise error(f"{path}: more than {MAX_BYTES >> 20} MiB, too large for {what}")
        content = path.read_bytes()
        if (kind := _binary_kind(path, content)) is not None:
            raise error(f"{path}: is {kind}, which is not read; {_SAVE}")
        wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror})") from None
    except UnicodeDecodeError:
        raise error(f"{path}: is not text in UTF-8; save {what} as UTF-8") from None
    if "\0" in text:
        raise error(f"{path}: is not text, it holds zero bytes; give {what}")
    if not text.strip():
        raise error(f"{path}: the file is empty, give {what}")
    return text


def _binary_kind(path: Path, content: bytes) -> str | None:
    """What a spreadsheet program's own file is called; None for anything else."""
    if content.startswith(b"\xd0\xcf\x11\xe0"):
        return "an Excel workbook (xls)"
    if not content.startswith(b"PK\x03\x04"):
        return None
    try:
        names = zipfile.ZipFile(io.BytesIO(content)).namelist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError):
        names = []
    if any(name.startswith("xl/") for name in names) or path.suffix.lower() in (".xlsx", ".xlsm", ".xlsb"):
        return "an Excel workbook (xlsx)"
    if "content.xml" in names:
        return "an OpenDocument spreadsheet (ods)"
    return "a spreadsheet (Numbers)" if "Index/Document.iwa" in names else "a zip archive"


def read_table(path: Path, text: str, columns: Columns, error: type[InputError]) -> list[Row]:
    """Rows of a table.

    Args:
        path: the file, for messages.
        text: its content.
        columns: those that it must and may have.
        error: class of the errors.

    Returns:
        The rows in sequence; blank lines, and empty cells beyond the last column, are left out.

    Raises:
        InputError: a column is missing, unknown or there twice, or a row has another number of cells.
    """
    separator, text = _separator(text, columns)
    reader = csv.reader(io.StringIO(text), delimiter=separator, strict=True, skipinitialspace=True)
    header: list[str] | None = None
    rows: list[Row] = []
    try:
        for record in reader:
            cells = [cell.strip() for cell in record]
            if not any(cells):
                continue
            where = f"{path}, line {reader.line_num}"
            if header is None:
                header = [columns.aliases.get(name, name) for name in map(normal_name, _cut(cells, 0))]
                columns.check(path, header, error)
                continue
            cells = _cut(cells, len(header))
            if len(cells) != len(header):
                comma = separator == "," and len(cells) > len(header)
                hint = "; decimals take a point, text with a comma takes quotes" if comma else ""
                raise error(
                    f"{where}: {len(cells)} cells where the header has {len(header)} "
                    f"({','.join(header)[:80]}){hint}"
                )
            rows.append(Row(where, dict(zip(header, cells, strict=True)), error, separator))
    except csv.Error as problem:
        raise error(f"{path}, line {reader.line_num}: not a CSV table ({problem})") from None
    return rows


def _cut(cells: list[str], least: int) -> list[str]:
    """Cells without the empty ones at the end beyond the first ``least``."""
    count = len(cells)
    while count > least and not cells[count - 1]:
        count -= 1
    return cells[:count]


def _separator(text: str, columns: Columns) -> tuple[str, str]:
    """What stands between the cells, and the text without a line ``sep=;`` that says so to Excel.

    Else it is what makes most of the required columns of the first line that is not blank; a comma where that is
    none.
    """
    lines = text.splitlines()
    first = next((line for line in lines if line.strip()), "")
    if (said := re.fullmatch(r"\s*sep=([,;\t])[,;\t]*", first)) is not None:
        return said[1], text.replace(first, "", 1)

    def found(separator: str) -> int:
        cells = {cell.strip().strip('"').strip().lower() for cell in first.split(separator)}
        return len(cells.intersection(columns.read))

    return max((",", ";", "\t"), key=found), text
