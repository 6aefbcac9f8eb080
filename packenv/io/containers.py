"""Containers: the boxes of ``boxes.csv``, and sizes that the user types."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from packenv.errors import ContainerError
from packenv.geometry.meshes import UNITS
from packenv.io.tables import Columns, read_table, read_text
from packenv.shipped import assets_dir
from packenv.types import Container, normal_name

_SIZES = ("length_m", "width_m", "height_m")
COLUMNS = Columns(required=("box_id", *_SIZES), optional=("max_kg",), remarks=("source", "notes"))
"""Columns of a table of boxes."""

_LENGTH = r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*(mm|cm|m|in)?\s*"
_SIZE = re.compile(rf"{_LENGTH}([x×*,;]){_LENGTH}\3{_LENGTH}", re.IGNORECASE)


def boxes_file() -> Path:
    """The table of boxes that RobotPack brings along."""
    return assets_dir() / "boxes.csv"


def read_boxes(path: Path | None = None) -> tuple[Container, ...]:
    """Read a table of boxes.

    Args:
        path: CSV with the columns ``box_id,length_m,width_m,height_m`` (inner sizes); :data:`COLUMNS` has
            all of them. None takes the boxes that RobotPack brings along.

    Returns:
        The boxes in the table's sequence.

    Raises:
        ContainerError: the table cannot be read, a size is wrong, or an id is there twice.
    """
    path = boxes_file() if path is None else Path(path)
    text = read_text(path, ContainerError, "a table of boxes")
    boxes: dict[str, Container] = {}
    for row in read_table(path, text, COLUMNS, ContainerError):
        name = row.name("box_id")
        if name.lower() in boxes:
            raise ContainerError(f"{row.where}: box {name!r} is there twice, give each box an id of its own")
        length, width, height = (row.positive(column, "metres") for column in _SIZES)
        most = row.positive("max_kg", "kilograms") if row.cells.get("max_kg") else None
        try:
            boxes[name.lower()] = Container(length, width, height, name, most)
        except ContainerError as problem:
            raise ContainerError(f"{row.where}: {problem}") from None
    if not boxes:
        raise ContainerError(f"{path}: lists no boxes, add a row for each")
    return tuple(boxes.values())


def parse_container(text: str, boxes: Sequence[Container], unit: str | None = None) -> Container:
    """Understand a container as the user types it.

    Args:
        text: inner length x width x height, as ``0.32x0.32x0.30``, ``320x320x300mm`` or ``320,320,300 mm``, in
            metres where no unit is written; or the id of a box, in upper or lower case.
        boxes: the boxes that there are.
        unit: which unit the user's meshes are in: a size without one that can be no metres is in it, too.

    Returns:
        The container.

    Raises:
        ContainerError: neither a size nor a known box, a size outside 1 cm to 2 m, or one that may be in either of two
            units.
    """
    wanted = normal_name(text.strip())
    for box in boxes:
        if box.name is not None and box.name.lower() == wanted.lower():
            return box
    size = _SIZE.fullmatch(wanted)
    if size is not None:
        return _sized(wanted, size, unit)
    known = ", ".join(box.name for box in boxes if box.name is not None) or "none"
    hint = ""
    point = wanted.replace(",", ".")
    if point != wanted and _SIZE.fullmatch(point):
        hint = f"; decimals take a point: {point}"
    raise ContainerError(
        f"container {text[:60]!r}: neither a size in metres, as in 0.32x0.32x0.30, "
        f"nor a known box ({known}){hint}"
    )


def _sized(text: str, size: re.Match[str], unit: str | None) -> Container:
    """The container of a size that the user wrote, perhaps with a unit."""
    numbers = [float(size[k]) for k in (1, 4, 6)]
    written = {size[k].lower() for k in (2, 5, 7) if size[k]}
    if len(written) > 1 or (written and not size[7]):
        raise ContainerError(f"container {text[:60]!r}: give all sides in one unit, as in 320x320x300mm")
    can_be = [name for name in UNITS if all(0.01 <= n * UNITS[name] <= 2.0 for n in numbers)]
    if not written:
        likely = [name for name in ("m", unit) if name in can_be]
        if len(set(likely)) > 1:
            raise ContainerError(f"container {text}: is it {text}m or {text}{unit}? write the unit")
        if not likely and "m" not in can_be and can_be:
            ways = " or ".join(f"{text}{name}" for name in can_be)
            raise ContainerError(
                f"container {text}: {max(numbers):g} m is more than 2 m; in another unit write {ways}"
            )
        written = set(likely) or {"m"}
    # Rounded to what the decimal fraction means: 320 * 0.001 is more than 0.32.
    length, width, height = (
        n if name == "m" else round(n * UNITS[name], 12) for name in written for n in numbers
    )
    return Container(length, width, height)
