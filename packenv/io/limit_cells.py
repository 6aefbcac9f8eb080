"""Limits of items in tables and orders: the columns that say them, and what their cells mean."""

from __future__ import annotations

from collections.abc import Mapping

from packenv.errors import InputError
from packenv.io.tables import Row
from packenv.limits import ItemLimits

LIMIT_COLUMNS = ("upright", "max_tilt_deg", "max_load_kg", "fragile", "no_stack", "keep_apart")
"""Columns, and keys in JSON, that set limits; all may be empty."""

ALIASES: Mapping[str, str] = {"this_side_up": "upright"}
"""Other names of these columns."""

_YES_NO = {
    "yes": True,
    "true": True,
    "y": True,
    "1": True,
    "no": False,
    "false": False,
    "n": False,
    "0": False,
}
_NUMBERS = ("max_tilt_deg", "max_load_kg")


def limits_of(row: Row) -> ItemLimits:
    """The limits that a row of a table sets; an empty cell sets none.

    Raises:
        InputError: a cell holds no such limit (in the row's class of errors).
    """
    given: dict[str, object] = {}
    for column in LIMIT_COLUMNS:
        text = row.cells.get(column, "")
        if not text:
            continue
        if column in _NUMBERS:
            given[column] = row.number(column)
        elif column == "keep_apart":
            given[column] = row.name(column)
        else:
            given[column] = _YES_NO.get(text.lower(), text.lower().removeprefix("+"))
    try:
        return ItemLimits.from_mapping(given)
    except InputError as problem:
        raise row.error(f"{row.where}: {problem}") from None
