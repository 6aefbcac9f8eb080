"""The robot as URDF, from the same figures and primitives that the planner checks.

``python -m packenv.robot.urdf`` prints it; ``assets/robot/tx90.urdf`` holds what it prints.
A capsule becomes a cylinder and two spheres, which every reader of URDF knows.
"""

from __future__ import annotations

import sys
from math import acos, atan2, pi

import numpy as np

from packenv.robot import gripper, tx90_data
from packenv.robot.shapes import GRIPPER, PRIMITIVES, Primitive
from packenv.types import FloatArray

_AXES = {"y": "0 1 0", "z": "0 0 1"}
_COLOURS = {"arm": "0.93 0.68 0.10 1", "wrist": "0.65 0.66 0.68 1", "gripper": "0.15 0.15 0.17 1"}


def urdf_text() -> str:
    """The whole URDF: links ``base_link``, ``link_1`` to ``link_6``, ``gripper``, ``tool``.

    Joints ``joint_1`` to ``joint_6`` have the zero positions, limits, speeds and torques of ``tx90_data``;
    ``link_6`` is the flange frame, ``tool`` the cup's lip. Masses are the published ones; centres of mass and
    inertia are those of the primitives at uniform density.
    """
    lines = [
        '<?xml version="1.0"?>',
        "<!-- Staubli TX90 with a vacuum gripper. Generated: python -m packenv.robot.urdf -->",
        '<robot name="tx90_vacuum">',
    ]
    for name, rgba in _COLOURS.items():
        lines.append(f'  <material name="{name}"><color rgba="{rgba}"/></material>')
    for index, name in enumerate(tx90_data.LINK_NAMES):
        parts = [p for p in PRIMITIVES[:GRIPPER] if p.link == index]
        colour = "wrist" if index >= 5 else "arm"
        lines += _link(name, parts, tx90_data.LINK_MASSES[index], colour)
    lines += _link("gripper", [PRIMITIVES[GRIPPER]], gripper.MASS, "gripper")
    # A frame without mass would be given 1 kg by PyBullet.
    lines += [
        '  <link name="tool">',
        '    <inertial><mass value="0.000001"/>',
        '      <inertia ixx="1e-9" ixy="0" ixz="0" iyy="1e-9" iyz="0" izz="1e-9"/></inertial>',
        "  </link>",
    ]
    for index, (origin, axis) in enumerate(
        zip(tx90_data.JOINT_ORIGINS, tx90_data.JOINT_AXES, strict=True), start=1
    ):
        j = index - 1
        lines += [
            f'  <joint name="joint_{index}" type="revolute">',
            f'    <parent link="{tx90_data.LINK_NAMES[j]}"/><child link="{tx90_data.LINK_NAMES[index]}"/>',
            f'    <origin xyz="{_numbers(origin)}" rpy="0 0 0"/><axis xyz="{_AXES[axis]}"/>',
            f'    <limit lower="{tx90_data.LOWER[j]:.9f}" upper="{tx90_data.UPPER[j]:.9f}" '
            f'velocity="{tx90_data.VELOCITY[j]:.6f}" effort="{tx90_data.EFFORT[j]:g}"/>',
            "  </joint>",
        ]
    lines += _fixed("flange_gripper", "link_6", "gripper", 0.0)
    lines += _fixed("gripper_tool", "gripper", "tool", gripper.LENGTH)
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


def _numbers(values: FloatArray | tuple[float, ...], digits: int = 6) -> str:
    return " ".join(_number(v, digits) for v in values)


if __name__ == "__main__":
    sys.stdout.write(urdf_text())
