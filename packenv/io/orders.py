"""Orders: lists of items to pack, as CSV or JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from pathlib import Path

from packenv.errors import InputError, OrderError, closest_item, closest_match
from packenv.io.limit_cells import ALIASES, LIMIT_COLUMNS, limits_of
from packenv.io.tables import Columns, read_table, read_text
from packenv.json_text import parse_json
from packenv.limits import ItemLimits
from packenv.types import Order, OrderLine, normal_name

MAX_PIECES = 10_000
"""Pieces that an order may have."""

COLUMNS = Columns(required=("item",), optional=("qty", *LIMIT_COLUMNS), aliases=ALIASES)
"""Columns of an order; the keys of its items as JSON."""

_INTEGER = re.compile(r"[+-]?[0-9]{1,12}")


def read_order(path: Path, catalogue_names: Collection[str]) -> Order:
    """Read an order.

    As CSV it has a header and the column ``item``, and may have ``qty`` (without it every line is one
    piece) and columns of limits, which hold beside those of the catalogue. As JSON it is ``{"items": [...]}``
    or a list, of item names and of ``{"item": ..., "qty": ...}``, with limits as further keys.
    An item may stand in several lines; their sequence is kept.

    Args:
        path: a .json file; anything else is read as CSV.
        catalogue_names: names of the items that there are.

    Returns:
        The order, at least one piece.

    Raises:
        OrderError: the file cannot be read, an item is not in the catalogue, a quantity is not a whole
            number above 0, or there are no items or too many.
    """
    path = Path(path)
    text = read_text(path, OrderError, "an order")
    lines = _from_json(path, text) if path.suffix.lower() == ".json" else _from_csv(path, text)
    if not lines:
        raise OrderError(f"{path}: the order is empty, it needs at least one item")
    names = frozenset(map(normal_name, catalogue_names))
    for where, line in lines:
        if line.item not in names:
            hint = closest_item(line.item, catalogue_names)
            raise OrderError(f"{where}: no item {line.item!r} in the catalogue{hint}")
    pieces = sum(line.qty for _, line in lines)
    if pieces > MAX_PIECES:
        raise OrderError(f"{path}: {pieces:,} pieces, the limit is {MAX_PIECES:,}; split the order")
    return Order(tuple(line for _, line in lines), source=path)


def _from_csv(path: Path, text: str) -> list[tuple[str, OrderLine]]:
    lines = []
    for row in read_table(path, text, COLUMNS, OrderError):
        quantity = _quantity(row.where, row.text("qty")) if "qty" in row.cells else 1
        lines.append((row.where, OrderLine(row.text("item"), quantity, limits_of(row))))
    return lines


def _from_json(path: Path, text: str) -> list[tuple[str, OrderLine]]:
    document = parse_json(text, str(path), "an order", OrderError)
    items = document.get("items") if isinstance(document, dict) else document
    if not isinstance(items, list):
        raise OrderError(f'{path}: no list of items; an order is {{"items": [{{"item": "mug", "qty": 2}}]}}')
    return [
        (where := f"{path}, item {k}", _json_line(where, entry)) for k, entry in enumerate(items, start=1)
    ]


def _json_line(where: str, entry: object) -> OrderLine:
    if isinstance(entry, str):
        entry = {"item": entry}
    if not isinstance(entry, dict) or not isinstance(entry.get("item"), str) or not entry["item"].strip():
        raise OrderError(f'{where}: needs the item\'s name, as in "mug" or {{"item": "mug", "qty": 2}}')
    entry = {ALIASES.get(key, key): value for key, value in entry.items()}
    for key in entry:
        if key not in COLUMNS.read:
            hint = closest_match(key, COLUMNS.read, f"; the keys are {', '.join(COLUMNS.read)}")
            raise OrderError(f"{where}: unknown key {key!r:.60}{hint}")
    quantity = entry.get("qty", 1)
    if not isinstance(quantity, int) or isinstance(quantity, bool):
        raise OrderError(f"{where}: qty is {json.dumps(quantity)[:40]}, give a whole number above 0")
    try:
        limits = ItemLimits.from_mapping({key: entry[key] for key in LIMIT_COLUMNS if key in entry})
    except InputError as problem:
        raise OrderError(f"{where}: {problem}") from None
    return OrderLine(entry["item"].strip(), _positive(where, quantity), limits)


def _quantity(where: str, text: str) -> int:
    if not _INTEGER.fullmatch(text):
        raise OrderError(f"{where}: qty is {text[:40]!r}, give a whole number above 0")
    return _positive(where, int(text))


def _positive(where: str, quantity: int) -> int:
    if quantity < 1:
        raise OrderError(f"{where}: qty is {quantity}, give a whole number above 0")
    return quantity
