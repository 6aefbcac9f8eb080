"""Robot files and cell files: one reader for both (docs/cell.md lists every key)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from packenv.errors import InputError, closest_match
from packenv.json_table import Table
from packenv.json_text import read_json
from packenv.robot.cell import CellSetup, Place
from packenv.robot.opw import OpwArm
from packenv.robot.records import gripper_from, robot_from
from packenv.shipped import assets_dir

DEFAULT = "tx90"
"""The robot of a cell that names none."""
_FARTHEST = 100.0
_CELL_KEYS = "base container pick gripper friction release_height_m rim_clearance_m"


def load_robot(source: str | Path) -> OpwArm:
    """A robot by its name (``tx90``) or its file.

    Raises:
        InputError: there is none, or the file is wrong.
    """
    path = _path(source)
    return robot_from(read_json(path), str(path))


def load_cell(source: str | Path | Mapping[str, object] | CellSetup) -> CellSetup:
    """A cell, of a cell file, of a robot file or a robot's name (with all else as usual), or of what such a file holds.

    Args:
        source: a path, a name, or the mapping that the file would hold.

    Raises:
        InputError: a file cannot be read, a key is unknown or missing, or a value is wrong.
    """
    if isinstance(source, CellSetup):
        return source
    if isinstance(source, Mapping):
        return cell_from(source, "the cell")
    path = _path(source)
    return cell_from(read_json(path), str(path), path.parent)


def cell_from(record: object, where: str, folder: Path = Path()) -> CellSetup:
    """A cell of a cell's or a robot's record.

    Args:
        record: what JSON gave.
        where: the file, for messages.
        folder: from which a robot's file is named.

    Raises:
        InputError: a key is unknown or missing, or a value is wrong.
    """
    if isinstance(record, Mapping) and not {"lengths_m", "joints", "links"}.isdisjoint(record):
        return CellSetup(robot_from(record, where))
    table = Table(record, where, "robot", _CELL_KEYS)
    robot = _robot(table, folder)
    if "gripper" in table:
        robot = robot.with_gripper(gripper_from(table.value("gripper"), table.place("gripper")))
    given = [key for key in ("friction", "release_height_m", "rim_clearance_m") if key in table]
    numbers = {key.removesuffix("_m"): table.number(key, 0.0) for key in given}
    try:
        return CellSetup(
            robot=robot,
            base=_place(table, "base") or Place(),
            container=_place(table, "container"),
            pick=_place(table, "pick"),
            **numbers,
        )
    except InputError as problem:
        raise InputError(f"{where}: {problem}") from None


@lru_cache(maxsize=1)
def default_cell() -> CellSetup:
    """The cell where none is given: the TX90, the container in front of it."""
    return load_cell(DEFAULT)


def cell_files(source: str | Path | None) -> list[Path]:
    """The files that :func:`load_cell` reads for a name or a path; none for None.

    Raises:
        InputError: a file cannot be read.
    """
    if source is None:
        return []
    path = _path(source)
    record = read_json(path)
    robot = record.get("robot") if isinstance(record, Mapping) else None
    return [path, path.parent / robot] if isinstance(robot, str) else [path]


def robot_names() -> list[str]:
    """The robots that RobotPack brings along."""
    return sorted(path.stem for path in (assets_dir() / "robots").glob("*.json"))


def _robot(table: Table, folder: Path) -> OpwArm:
    value = table.value("robot")
    if isinstance(value, Mapping):
        return robot_from(value, table.place("robot"))
    if not isinstance(value, str):
        raise table.wrong("robot", "a robot's name, the path of its file, or its record")
    return load_robot(value if value in robot_names() else folder / value)


def _place(table: Table, key: str) -> Place | None:
    if key not in table:
        return None
    place = Table(table.value(key), table.place(key), "position_m", "yaw_deg")
    yaw = place.number("yaw_deg", -360.0, 360.0) if "yaw_deg" in place else 0.0
    return Place(place.vector("position_m", -_FARTHEST, _FARTHEST), yaw)


def _path(source: str | Path) -> Path:
    names = robot_names()
    if str(source) in names:
        return assets_dir() / "robots" / f"{source}.json"
    path = Path(source)
    if not path.is_file():
        hint = closest_match(path.name, names)
        raise InputError(
            f"{path}: is no file, give a cell file, a robot file or one of {', '.join(names)}{hint}"
        )
    return path
