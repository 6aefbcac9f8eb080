"""An arm as URDF, from the same figures and primitives that the planner checks.

``python -m packenv.robot.urdf tx90`` prints that of a robot, given by its name or file. A capsule becomes a
cylinder and two spheres, which every reader of URDF knows.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from math import acos, atan2, pi
from typing import TYPE_CHECKING

import numpy as np

from packenv.robot.shapes import Primitive
from packenv.types import FloatArray

if TYPE_CHECKING:
    from packenv.robot.opw import OpwArm

_AXES = "zyyzyz"
"""Which axis of its frame each joint turns about."""
_COLOURS = {"arm": "0.93 0.68 0.10 1", "wrist": "0.65 0.66 0.68 1", "gripper": "0.15 0.15 0.17 1"}


def urdf_text(robot: OpwArm) -> str:
    """The whole URDF: the robot's links and joints under their names, then ``gripper`` and ``tool``.

    Joints have the robot's own zero positions, limits, speeds and torques; the last link is the flange frame,
    ``tool`` the cup's lip. Masses are those of the record; centres of mass and inertia are those of the
    primitives at uniform density.
    """
    title = robot.title.replace("--", "- -")  # which would end the comment
    lines = [
        '<?xml version="1.0"?>',
        f"<!-- {title} with a vacuum gripper. Generated: python -m packenv.robot.urdf -->",
        f'<robot name="{robot.name}_vacuum">',
    ]
    for name, rgba in _COLOURS.items():
        lines.append(f'  <material name="{name}"><color rgba="{rgba}"/></material>')
    for index, (name, mass) in enumerate(zip(robot.link_names, robot.link_masses, strict=True)):
        parts = [p for p in robot.primitives if p.link == index]
        lines += _link(name, parts, mass, "wrist" if index >= 5 else "arm")
    tube = robot.shapes.primitives[robot.shapes.gripper]
    lines += _link("gripper", [tube], robot.gripper.mass, "gripper")
    # A frame without mass would be given 1 kg by PyBullet.
    lines += [
        '  <link name="tool">',
        '    <inertial><mass value="0.000001"/>',
        '      <inertia ixx="1e-9" ixy="0" ixz="0" iyy="1e-9" iyz="0" izz="1e-9"/></inertial>',
        "  </link>",
    ]
    a = robot.lengths
    origins = ((0, 0, a.c1), (a.a1, 0, 0), (0, a.b, a.c2), (a.a2, 0, 0), (0, 0, a.c3), (0, 0, a.c4))
    for j, (joint, origin, axis) in enumerate(zip(robot.joints, origins, _AXES, strict=True)):
        turn = [0.0 if letter != axis else -joint.offset for letter in "xyz"]
        along = " ".join(str(joint.sign) if letter == axis else "0" for letter in "xyz")
        lines += [
            f'  <joint name="{joint.name}" type="revolute">',
            f'    <parent link="{robot.link_names[j]}"/><child link="{robot.link_names[j + 1]}"/>',
            f'    <origin xyz="{_numbers(origin)}" rpy="{_numbers(turn, 9)}"/><axis xyz="{along}"/>',
            f'    <limit lower="{joint.lower:.9f}" upper="{joint.upper:.9f}" '
            f'velocity="{joint.velocity:.6f}" effort="{joint.effort:g}"/>',
            "  </joint>",
        ]
    lines += _fixed("flange_gripper", robot.link_names[6], "gripper", 0.0)
    lines += _fixed("gripper_tool", "gripper", "tool", robot.gripper.length)
    lines.append("</robot>")
    return "\n".join(lines) + "\n"


def mass_properties(parts: list[Primitive], mass: float) -> tuple[FloatArray, FloatArray]:
    """Centre of mass and inertia of some primitives of one density; where they overlap, both count.

    Args:
        parts: primitives of one link.
        mass: of the link, kg.

    Returns:
        (3,) centre in the link's frame, m, and (3, 3) inertia about it in the link's axes, kg m².
    """
    volumes, centres, own = [], [], []
    for part in parts:
        start, end, r = np.array(part.start), np.array(part.end), part.radius
        length = float(np.linalg.norm(end - start))
        axis = (end - start) / length
        tube, ball = pi * r * r * length, 4.0 / 3.0 * pi * r**3 if part.capsule else 0.0
        along = tube * r * r / 2.0 + ball * 0.4 * r * r
        # Both half balls: about the capsule's middle, by their centroids 3/8 r beyond the tube's ends.
        across = tube * (r * r / 4.0 + length**2 / 12.0)
        across += ball * (0.4 * r * r + length**2 / 4.0 + 3.0 / 8.0 * length * r)
        volumes.append(tube + ball)
        centres.append((start + end) / 2.0)
        own.append(across * np.eye(3) + (along - across) * np.outer(axis, axis))
    total = sum(volumes)
    com: FloatArray = np.sum([v * c for v, c in zip(volumes, centres, strict=True)], axis=0) / total
    inertia = np.zeros((3, 3))
    for v, c, i in zip(volumes, centres, own, strict=True):
        d = c - com
        inertia += i + v * (d @ d * np.eye(3) - np.outer(d, d))
    return com, inertia * (mass / total)


def _link(name: str, parts: list[Primitive], mass: float, colour: str) -> list[str]:
    com, inertia = mass_properties(parts, mass)
    entries = [
        f'i{a}{b}="{_number(inertia[i, j], 8)}"'
        for i, a in enumerate("xyz")
        for j, b in enumerate("xyz")
        if j >= i
    ]
    lines = [
        f'  <link name="{name}">',
        f'    <inertial><origin xyz="{_numbers(com)}" rpy="0 0 0"/><mass value="{_number(mass)}"/>',
        f"      <inertia {' '.join(entries)}/></inertial>",
    ]
    for origin, geometry in (found for part in parts for found in _shapes(part)):
        shape = f"{origin}<geometry>{geometry}</geometry>"
        lines.append(f'    <visual>{shape}<material name="{colour}"/></visual>')
        lines.append(f"    <collision>{shape}</collision>")
    lines.append("  </link>")
    return lines


def _shapes(part: Primitive) -> list[tuple[str, str]]:
    """Origin and geometry elements of one primitive."""
    start, end = np.array(part.start), np.array(part.end)
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    turn = (0.0, acos(max(-1.0, min(1.0, float(axis[2])))), atan2(float(axis[1]), float(axis[0])))
    shapes = [
        (
            f'<origin xyz="{_numbers((start + end) / 2.0)}" rpy="{_numbers(turn, 9)}"/>',
            f'<cylinder radius="{part.radius:g}" length="{_number(length)}"/>',
        )
    ]
    if part.capsule:
        shapes += [
            (f'<origin xyz="{_numbers(p)}" rpy="0 0 0"/>', f'<sphere radius="{part.radius:g}"/>')
            for p in (part.start, part.end)
        ]
    return shapes


def _fixed(name: str, parent: str, child: str, z: float) -> list[str]:
    return [
        f'  <joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {z:g}" rpy="0 0 0"/></joint>'
    ]


def _number(value: float, digits: int = 6) -> str:
    """Short decimal text; rounding noise and negative zero become 0."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}".rstrip("0").rstrip(".")


def _numbers(values: FloatArray | Sequence[float], digits: int = 6) -> str:
    return " ".join(_number(v, digits) for v in values)


if __name__ == "__main__":
    from packenv.robot.files import load_robot

    sys.stdout.write(load_robot(sys.argv[1] if len(sys.argv) > 1 else "tx90").urdf())
