"""Containers: the boxes of ``boxes.csv``, and sizes that the user types."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from packenv.errors import ContainerError
from packenv.io.tables import Columns, read_table, read_text
from packenv.shipped import assets_dir
from packenv.types import Container, normal_name

_SIZES = ("length_m", "width_m", "height_m")
COLUMNS = Columns(required=("box_id", *_SIZES), remarks=("source", "notes"))
"""Columns of a table of boxes."""

_NUMBER = r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*"
_SIZE = re.compile(rf"{_NUMBER}[x×*]{_NUMBER}[x×*]{_NUMBER}(?:m\s*)?", re.IGNORECASE)


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
        try:
            boxes[name.lower()] = Container(length, width, height, name=name)
        except ContainerError as problem:
            raise ContainerError(f"{row.where}: {problem}") from None
    if not boxes:
        raise ContainerError(f"{path}: lists no boxes, add a row for each")
    return tuple(boxes.values())


def parse_container(text: str, boxes: Sequence[Container]) -> Container:
    """Understand a container as the user types it.

    Args:
        text: inner length x width x height in metres, as ``0.32x0.32x0.30``, or the id of a box, in
            upper or lower case.
        boxes: the boxes that there are.

    Returns:
        The container.

    Raises:
        ContainerError: neither a size nor a known box, or a size outside 1 cm to 2 m.
    """
    wanted = normal_name(text.strip())
    for box in boxes:
        if box.name is not None and box.name.lower() == wanted.lower():
            return box
    size = _SIZE.fullmatch(wanted)
    if size is not None:
        length, width, height = (float(part) for part in size.groups())
        return Container(length, width, height)
    known = ", ".join(box.name for box in boxes if box.name is not None) or "none"
    hint = ""
    point = wanted.replace(",", ".")
    if point != wanted and _SIZE.fullmatch(point):
        hint = f"; decimals take a point: {point}"
    raise ContainerError(
        f"container {text[:60]!r}: neither a size in metres, as in 0.32x0.32x0.30, "
        f"nor a known box ({known}){hint}"
    )
