"""Putting the meshes of a scene (GLB, 3MF) together into one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from packenv.geometry.readers.raw import RawMesh, check_counts
from packenv.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class ScenePart:
    """One mesh of a scene.

    Attributes:
        vertices: (n, 3) in the mesh's own frame.
        faces: (m, 3).
        transform: (4, 4) own frame to scene, affine.
    """

    vertices: FloatArray
    faces: IntArray
    transform: FloatArray


def joined(path: Path, parts: Sequence[ScenePart], *, metres: float, notes: tuple[str, ...] = ()) -> RawMesh:
    """Move every part to its place and put all into one mesh.

    Args:
        path: the file, named in messages.
        parts: the scene's meshes.
        metres: length of the scene's unit, m.
        notes: handed on.

    Returns:
        One mesh; where a transform mirrors a part, its faces are turned so that outside stays outside.

    Raises:
        MeshError: all parts together exceed the limits.
    """
    check_counts(path, vertices=sum(len(p.vertices) for p in parts), faces=sum(len(p.faces) for p in parts))
    vertices: list[FloatArray] = [np.empty((0, 3))]
    faces: list[IntArray] = [np.empty((0, 3), np.int64)]
    base = 0
    for part in parts:
        linear = part.transform[:3, :3]
        vertices.append(part.vertices @ linear.T + part.transform[:3, 3])
        mirrored = np.linalg.det(linear) < 0
        faces.append((part.faces[:, ::-1] if mirrored else part.faces) + base)
        base += len(part.vertices)
    return RawMesh(np.concatenate(vertices), np.concatenate(faces), split=True, metres=metres, notes=notes)
