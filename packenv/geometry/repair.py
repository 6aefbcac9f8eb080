"""From the triangles of a file to the surface of a solid, with as little change as possible.

What is mended is always said; what would need an invented surface is an error. A sound mesh comes out
with the very numbers that went in. One fault is not mended: a single body that runs through
itself; its volume counts the part inside twice, its heightmaps stay right. Where its mass properties are those
of no solid, it is refused (:func:`packenv.geometry.mass.impossible`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.bodies import THIN, settle_bodies
from packenv.geometry.holes import fill_small_holes
from packenv.geometry.mass import area, signed_volume
from packenv.geometry.topology import (
    body_labels,
    compact,
    crowded_edge,
    faces_to_turn,
    is_solid,
    merge_close,
    merge_equal,
    open_edges,
    without_repeats,
)
from packenv.types import FloatArray, IntArray

CLOSE = 1e-6
"""Vertices of an open surface are merged within this share of the item's diagonal."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle surface on its way to a solid.

    Attributes:
        vertices: (n, 3), m.
        faces: (m, 3).
        repairs: what was mended so far.
        notes: what a user should know.
    """

    vertices: FloatArray
    faces: IntArray
    repairs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def used_part(vertices: FloatArray, faces: IntArray, *, split: bool) -> Surface:
    """Leave out what is not part of the surface; no point of it moves.

    Args:
        vertices: (n, 3).
        faces: (m, 3).
        split: merge equal vertices, because the format gives faces vertices of their own.

    Returns:
        The surface without unused vertices and without faces that name a vertex twice.
    """
    notes: tuple[str, ...] = ()
    faces = without_repeats(faces)
    used_vertices, used_faces = compact(vertices, faces)
    if split:
        used_vertices, used_faces, _ = merge_equal(used_vertices, used_faces)
    elif len(used_vertices) < len(vertices):
        notes = (f"{len(vertices) - len(used_vertices)} vertices without a face ignored",)
    return Surface(used_vertices, used_faces, (), notes)


def mend(path: Path, surface: Surface) -> Surface:
    """Make a surface the boundary of a solid.

    Args:
        path: the mesh file, named in messages.
        surface: not flat, all numbers finite.

    Returns:
        A closed surface, wound outward, that encloses a volume, with its repairs and notes added.

    Raises:
        MeshError: a large hole, edges with three faces, a one-sided surface, no volume, or bodies that
            cannot be made one solid.
    """
    solid, crowded = is_solid(surface.faces)
    if crowded or not solid:
        surface = _closed(path, surface)
    labels = body_labels(surface.faces)
    repairs, notes = list(surface.repairs), list(surface.notes)
    vertices, faces = surface.vertices, surface.faces
    if labels.max() > 0:
        vertices, faces, more_repairs, more_notes = settle_bodies(path, vertices, faces, labels)
        repairs += more_repairs
        notes += more_notes
    volume = signed_volume(vertices, faces)
    if volume < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
        repairs.append("turned inside out (the faces pointed inward)")
    if abs(volume) <= THIN * float(np.linalg.norm(np.ptp(vertices, axis=0))) * area(vertices, faces):
        raise MeshError(f"{path}: encloses no volume, an item needs a thickness")
    return Surface(vertices, faces, tuple(repairs), tuple(notes))


def _closed(path: Path, surface: Surface) -> Surface:
    """Close a surface that is open, wound two ways, or has faces twice."""
    vertices, faces = surface.vertices, surface.faces
    repairs = list(surface.repairs)
    if open_edges(faces):
        vertices, faces = _merged(vertices, faces, repairs)
    was_closed = open_edges(faces) == 0
    faces = _without_duplicate_faces(faces, repairs)
    if was_closed and open_edges(faces):
        raise MeshError(
            f"{path}: encloses no volume, it is a sheet with two sides; an item needs a thickness"
        )
    vertices, faces = compact(vertices, faces)
    if is_solid(faces)[0]:
        return Surface(vertices, faces, tuple(repairs), surface.notes)

    crowded = crowded_edge(faces)
    if crowded is not None:
        x, y, z = vertices[crowded[0]]
        raise MeshError(
            f"{path}: more than two faces meet at an edge at ({x:.4g}, {y:.4g}, {z:.4g}) m, "
            "so there is no inside; remove inner walls in a modelling program"
        )
    turn = faces_to_turn(faces)
    if turn is None:
        raise MeshError(f"{path}: a one-sided surface (as a Möbius strip has) encloses no solid")
    if turn.any():
        faces = np.where(turn[:, None], faces[:, ::-1], faces)
        repairs.append(f"{int(turn.sum())} faces turned (their winding was mixed)")
    if open_edges(faces):
        faces, filled = fill_small_holes(path, vertices, faces)
        repairs += filled
    if not is_solid(faces)[0]:
        raise MeshError(
            f"{path}: its faces do not bound a solid: bodies touch in edges that four faces share; "
            "separate or unite them in a modelling program"
        )
    return Surface(vertices, faces, tuple(repairs), surface.notes)


def _merged(vertices: FloatArray, faces: IntArray, repairs: list[str]) -> tuple[FloatArray, IntArray]:
    """Merge equal vertices, then near ones, each only where it closes the surface further."""
    before = open_edges(faces)
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    equal_vertices, equal_faces, gone = merge_equal(vertices, faces)
    if gone and len(equal_faces) and open_edges(equal_faces) < before:
        vertices, faces, before = equal_vertices, equal_faces, open_edges(equal_faces)
        repairs.append(f"{gone} duplicate vertices merged")
    if before:
        near_vertices, near_faces, gone = merge_close(vertices, faces, CLOSE * diagonal)
        if gone and len(near_faces) and open_edges(near_faces) < before:
            vertices, faces = near_vertices, near_faces
            repairs.append(f"{gone} vertices merged with others within {CLOSE * diagonal * 1e6:.2g} µm")
    return vertices, faces


def _without_duplicate_faces(faces: IntArray, repairs: list[str]) -> IntArray:
    """Drop faces that are there twice.

    One of each is kept, unless only leaving out both closes the surface: then they are the wall
    between two bodies that were put together face to face, or a fin without thickness.
    """
    corners = np.sort(faces, axis=1)
    _, first, inverse, counts = np.unique(
        corners, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    if len(first) == len(faces):
        return faces
    once: IntArray = faces[np.sort(first)]
    if open_edges(once):
        single: IntArray = faces[counts[inverse.reshape(-1)] % 2 == 1]
        if len(single) and open_edges(single) < open_edges(once):
            repairs.append(
                f"{len(faces) - len(single)} faces without thickness dropped (inner walls or fins)"
            )
            return single
    repairs.append(
        "duplicate shell dropped"
        if len(faces) >= 2 * len(once)
        else f"{len(faces) - len(once)} duplicate faces dropped"
    )
    return once
