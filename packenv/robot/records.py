"""A robot's record: what a robot file holds, checked to the last key (docs/cell.md)."""

from __future__ import annotations

from math import hypot, pi
from typing import Any

from packenv.errors import InputError
from packenv.json_table import Table
from packenv.robot.gripper import ATMOSPHERE, Gripper
from packenv.robot.opw import Joint, Lengths, OpwArm
from packenv.robot.shapes import Primitive

_REACH = 10.0
"""No arm here is longer, m."""
_SAFEST = 100.0
"""No safety factor is larger."""


def robot_from(record: object, where: str) -> OpwArm:
    """Make an arm of its record.

    Args:
        record: what JSON gave.
        where: the file, for messages.

    Raises:
        InputError: a key is unknown or missing, or a value is wrong.
    """
    table = Table(record, where, "name title source lengths_m joints links gripper near_edge_m", "payload_kg")
    lengths = _lengths(Table(table.value("lengths_m"), table.place("lengths_m"), "a1 a2 b c1 c2 c3 c4"))
    joints = tuple(_joint(row, table.place(f"joints[{k}]")) for k, row in enumerate(table.rows("joints", 6)))
    links = [
        Table(row, table.place(f"links[{k}]"), "name mass_kg shapes")
        for k, row in enumerate(table.rows("links", 7))
    ]
    names = [link.word("name") for link in links]
    for kind, given in (("joints", [j.name for j in joints]), ("links", [*names, "gripper", "tool"])):
        for name in given:
            if given.count(name) > 1:
                raise InputError(f"{table.place(kind)}: the name {name!r} is there twice, give each its own")
    robot = OpwArm(
        name=table.word("name"),
        title=table.text("title"),
        source=table.text("source"),
        lengths=lengths,
        joints=joints,
        link_names=tuple(names),
        link_masses=tuple(link.number("mass_kg", 0.0, above=True) for link in links),
        primitives=tuple(
            _primitive(k, row, f"{link.where}: shapes[{n}]")
            for k, link in enumerate(links)
            for n, row in enumerate(link.rows("shapes"))
        ),
        gripper=gripper_from(table.value("gripper"), table.place("gripper")),
        near_edge=table.number("near_edge_m", 0.0, _REACH),
        payload=table.optional_number("payload_kg", 0.0),
    )
    column = robot.shapes.column_radius
    if robot.near_edge < column:
        raise table.wrong("near_edge_m", f"at least {column:.3f}: so far do base and link 1 reach")
    return robot


def gripper_from(record: object, where: str) -> Gripper:
    """Make a gripper of its record.

    Raises:
        InputError: a key is unknown or missing, or a value is wrong.
    """
    table = Table(record, where, "length_m radius_m mass_kg", "payload_kg vacuum_kpa safety_factor")
    given = {}
    if "vacuum_kpa" in table:
        given["vacuum"] = 1000.0 * table.number("vacuum_kpa", 0.0, ATMOSPHERE / 1000.0, above=True)
    if "safety_factor" in table:
        given["safety"] = table.number("safety_factor", 1.0, _SAFEST)
    return Gripper(
        length=table.number("length_m", 0.0, 2.0, above=True),
        radius=table.number("radius_m", 0.0, 0.5, above=True),
        mass=table.number("mass_kg", 0.0, 1000.0, above=True),
        payload=table.optional_number("payload_kg", 0.0),
        **given,
    )


def _lengths(table: Table) -> Lengths:
    values = {key: table.number(key, -_REACH, _REACH) for key in ("a1", "a2", "b", "c1", "c3", "c4")}
    lengths = Lengths(c2=table.number("c2", 0.0, _REACH, above=True), **values)
    if hypot(lengths.a2, lengths.c3) == 0.0:
        raise table.wrong("c3", "a forearm: a2 and c3 are both 0")
    return lengths


def _joint(row: object, where: str) -> Joint:
    table = Table(row, where, "name lower_rad upper_rad velocity_rad_s", "effort_nm sign offset_rad")
    lower = table.number("lower_rad", -4.0 * pi, 4.0 * pi)
    upper = table.number("upper_rad", -4.0 * pi, 4.0 * pi)
    if not lower < upper:
        raise table.wrong("upper_rad", f"more than lower_rad, {lower:g}")
    if "sign" in table and (not isinstance(table.value("sign"), int) or abs(table.value("sign")) != 1):
        raise table.wrong("sign", "1 or -1")
    return Joint(
        name=table.word("name"),
        lower=lower,
        upper=upper,
        velocity=table.number("velocity_rad_s", 0.0, above=True),
        effort=table.optional_number("effort_nm", 0.0) or 0.0,
        sign=int(table.value("sign")) if "sign" in table else 1,
        offset=table.optional_number("offset_rad", -2.0 * pi, 2.0 * pi) or 0.0,
    )


def _primitive(link: int, row: Any, where: str) -> Primitive:
    table = Table(row, where, "start_m end_m radius_m", "round")
    start, end = (table.vector(key, -_REACH, _REACH) for key in ("start_m", "end_m"))
    if start == end:
        raise table.wrong("end_m", "another point than start_m: the two are the ends of an axis")
    return Primitive(
        link,
        start,
        end,
        table.number("radius_m", 0.0, _REACH, above=True),
        capsule="round" in table and table.flag("round"),
    )
