"""What pictures are made of: surfaces with a colour, of items, of the box, and of what else there is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
import trimesh

from packenv.types import Container, FloatArray, IntArray, Item, Pose
from packenv.view.camera import in_axes

_CREASE = math.radians(38.0)
"""Faces that meet at a larger angle are not shaded as one smooth part."""
_BOX_COLOUR = (226, 230, 236)
# The box shows only a share of its shade: its walls are there to be glanced past.
_WALL_SHADE, _FLOOR_SHADE = 0.4, 0.75
_ITEMS: WeakKeyDictionary[Item, Surface] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Surface:
    """Something to draw.

    Attributes:
        vertices: (n, 3) m.
        normals: (n, 3) unit.
        faces: (m, 3) int64, counter-clockwise seen from outside.
        parts: (m,) int64; a line is drawn between faces of two parts, for there they meet in an edge.
        colour: (red, green, blue), sRGB, 0 to 255.
        shade: share of its shade that is seen; below 1 it has no lines either.
        shadow: whether it throws one.
    """

    vertices: FloatArray
    normals: FloatArray
    faces: IntArray
    parts: IntArray
    colour: tuple[int, int, int] = (255, 255, 255)
    shade: float = 1.0
    shadow: bool = True

    def at(self, pose: Pose, colour: tuple[int, int, int] | None = None) -> Surface:
        """The surface elsewhere, perhaps in another colour."""
        rotation, position = pose
        vertices, normals = in_axes(self.vertices, rotation) + position, in_axes(self.normals, rotation)
        return replace(self, vertices=vertices, normals=normals, colour=colour or self.colour)


def surface_of(mesh: trimesh.Trimesh, colour: tuple[int, int, int] = (255, 255, 255)) -> Surface:
    """A mesh, smooth but for its sharp edges."""
    smooth = trimesh.graph.smooth_shade(mesh, angle=_CREASE, facet_minarea=None)
    groups = smooth.metadata.get("original_components")
    if groups is None:
        # Every edge is sharp: trimesh gives back the mesh as it was.
        smooth.unmerge_vertices()
        groups = np.arange(len(smooth.faces))[:, None]
    parts = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    return Surface(
        np.array(smooth.vertices, dtype=np.float64),
        np.array(smooth.vertex_normals, dtype=np.float64),
        np.array(smooth.faces, dtype=np.int64),
        parts.astype(np.int64),
        colour,
    )


def item_surface(item: Item) -> Surface:
    """An item's surface in its mesh frame; it is kept for as long as the item is."""
    found = _ITEMS.get(item)
    if found is None:
        found = _ITEMS[item] = surface_of(trimesh.Trimesh(item.vertices, item.faces, process=False))
    return found


def box_corners(container: Container) -> FloatArray:
    """(8, 3) corners of a container's inside, m."""
    corners: FloatArray = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)]) * container.size
    return corners


@lru_cache(maxsize=16)
def box_surfaces(container: Container) -> tuple[Surface, Surface]:
    """Floor and walls of a container, seen from inside alone; its top is open."""
    box = trimesh.creation.box(bounds=np.array([np.zeros(3), container.size]))
    box.invert()
    z = box.triangles_center[:, 2] / container.height
    floor, walls = (box.submesh([faces], append=True) for faces in (z < 0.1, (z > 0.1) & (z < 0.9)))
    return (
        replace(surface_of(floor, _BOX_COLOUR), shade=_FLOOR_SHADE, shadow=False),
        replace(surface_of(walls, _BOX_COLOUR), shade=_WALL_SHADE, shadow=False),
    )
