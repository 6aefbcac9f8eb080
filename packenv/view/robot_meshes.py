"""The robot's primitives as surfaces, for pictures."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from packenv.robot.shapes import LinkShapes, Primitive
from packenv.types import FloatArray, IntArray

_AROUND = 28
_CAP_RINGS = 6


@dataclass(frozen=True, eq=False)
class LinkMesh:
    """A surface that moves with a link.

    Attributes:
        link: 0 base, 1 to 6 the links.
        kind: ``arm``, ``wrist`` or ``gripper``.
        vertices: (n, 3) in the link's frame, m.
        faces: (m, 3), counter-clockwise seen from outside.
    """

    link: int
    kind: str
    vertices: FloatArray
    faces: IntArray


def robot_meshes(shapes: LinkShapes) -> tuple[LinkMesh, ...]:
    """One surface for each primitive of the arm and the gripper."""
    last = shapes.gripper
    return tuple(_mesh(part, index == last) for index, part in enumerate(shapes.primitives))


def _mesh(primitive: Primitive, gripper: bool) -> LinkMesh:
    start, end = np.array(primitive.start), np.array(primitive.end)
    length = float(np.linalg.norm(end - start))
    z = (end - start) / length
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    vertices, faces = _turned(_profile(primitive.radius, length, primitive.capsule))
    kind = "gripper" if gripper else "wrist" if primitive.link >= 5 else "arm"
    return LinkMesh(primitive.link, kind, vertices @ np.stack([x, np.cross(z, x), z]) + start, faces)


def _profile(radius: float, length: float, capsule: bool) -> list[tuple[float, float]]:
    """(distance from the axis, height) from the lower pole to the upper one."""
    if not capsule:
        return [(0.0, 0.0), (radius, 0.0), (radius, length), (0.0, length)]
    rises = [math.pi / 2 * k / _CAP_RINGS for k in range(_CAP_RINGS + 1)]
    lower = [(radius * math.sin(a), -radius * math.cos(a)) for a in rises]
    upper = [(radius * math.cos(a), length + radius * math.sin(a)) for a in rises]
    return lower + upper


def _turned(profile: list[tuple[float, float]]) -> tuple[FloatArray, IntArray]:
    """The closed surface that a profile sweeps about the z axis; both its ends lie on the axis."""
    turns = 2 * math.pi * np.arange(_AROUND) / _AROUND
    rings = [
        np.column_stack([r * np.cos(turns), r * np.sin(turns), np.full(_AROUND, h)]) for r, h in profile[1:-1]
    ]
    poles = np.array([[0.0, 0.0, profile[0][1]], [0.0, 0.0, profile[-1][1]]])
    vertices = np.concatenate([*rings, poles])
    low, high = len(vertices) - 2, len(vertices) - 1
    here = np.arange(_AROUND)
    there = (here + 1) % _AROUND
    faces = [np.column_stack([np.full(_AROUND, low), there, here])]
    for k in range(len(rings) - 1):
        a, b = k * _AROUND + here, k * _AROUND + there
        c, d = b + _AROUND, a + _AROUND
        faces += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    last = (len(rings) - 1) * _AROUND
    faces.append(np.column_stack([np.full(_AROUND, high), last + here, last + there]))
    return vertices, np.concatenate(faces).astype(np.int64)
