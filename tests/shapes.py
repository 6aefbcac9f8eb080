"""Items made of simple solids, for tests."""

from __future__ import annotations

import hashlib

import numpy as np
import trimesh

from packenv.types import Item


def as_item(mesh: trimesh.Trimesh, name: str = "thing", density: float = 500.0) -> Item:
    """Wrap a watertight mesh as an item of uniform density."""
    assert mesh.is_watertight
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    volume = float(mesh.volume)
    return Item(
        name=name,
        vertices=vertices,
        faces=faces,
        volume=volume,
        mass=density * volume,
        mass_estimated=False,
        com=np.array(mesh.center_mass),
        inertia=np.array(mesh.moment_inertia) * density,
        sha256=hashlib.sha256(vertices.tobytes() + faces.tobytes()).hexdigest(),
        file=f"{name}.ply",
    )


def box(x: float, y: float, z: float, name: str = "box") -> Item:
    """A box with its smallest corner at the origin."""
    mesh = trimesh.creation.box(extents=(x, y, z))
    mesh.apply_translation((x / 2, y / 2, z / 2))
    return as_item(mesh, name)


def ball(radius: float, name: str = "ball", subdivisions: int = 3) -> Item:
    """A ball about the origin."""
    return as_item(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius), name)


def cylinder(radius: float, height: float, name: str = "can", sections: int = 64) -> Item:
    """A standing cylinder about the origin."""
    return as_item(trimesh.creation.cylinder(radius=radius, height=height, sections=sections), name)


def cup(radius: float, height: float, wall: float = 0.003, name: str = "cup", taper: float = 0.8) -> Item:
    """An open, tapered cup that stands on z = 0."""
    profile = [
        (0.0, 0.0),
        (radius * taper, 0.0),
        (radius, height),
        (radius - wall, height),
        (radius * taper - wall, wall),
        (0.0, wall),
    ]
    return as_item(trimesh.creation.revolve(np.array(profile), sections=48), name)
