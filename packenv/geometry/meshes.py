"""Meshes as the rest of the package uses them: metres, closed, outward, with mass properties."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from packenv.errors import MeshError, UnitError, is_number
from packenv.geometry.mass import (
    SolidProperties,
    beyond_hull,
    estimated_mass,
    hull_volume,
    impossible,
    solid_properties,
)
from packenv.geometry.readers.raw import RawMesh, check_counts, check_indices
from packenv.geometry.repair import mend, used_part
from packenv.limits import NO_LIMITS, ItemLimits
from packenv.types import FloatArray, IntArray, Item

FORMAT = 3
"""Raise this when reading or mending changes: meshes that are kept in another format are read anew."""

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
"""Units that a mesh may be in, as metres."""

MAX_COORDINATE = 1e12
"""Distance from the origin, in any unit, that is still read."""

SMALLEST, LARGEST = 0.002, 2.0
"""The longest side of an item is within these, m. Outside them the unit is wrong."""

FLAT = 1e-7
"""A surface whose spread across its own plane is below this share of its size is flat."""

LONG = 1.0
"""An item longer than this, m, is suspicious where nobody said that its numbers are metres."""

COARSE = 1e-3
"""Single precision has lost a shape where its steps are this share of the item's size."""

HEAVIEST = 22_600.0
"""kg/m³ of osmium: a mass above it was hardly given in kilograms."""


@dataclass(frozen=True, eq=False)
class LoadedMesh:
    """The surface of a solid, ready for use.

    Attributes:
        vertices: (n, 3) float64, m; every one is a corner of some face.
        faces: (m, 3) int64, closed, counter-clockwise seen from outside.
        solid: what it encloses.
        repairs: what was repaired on loading, one phrase each; empty for a sound file.
        notes: what a user should know but need not mend.
    """

    vertices: FloatArray
    faces: IntArray
    solid: SolidProperties
    repairs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def check_unit(unit: str | None) -> None:
    """Refuse a unit that is none of :data:`UNITS`; None is fine.

    Raises:
        UnitError: it is unknown.
    """
    if unit is not None and unit not in UNITS:
        raise UnitError(f"unit {unit!r:.60} is not known, give one of {', '.join(UNITS)}")


def solid_mesh(path: Path, raw: RawMesh, unit: str | None) -> LoadedMesh:
    """Check a mesh, whatever it came from, and mend what can be mended without inventing a surface.

    Args:
        path: the file, or what a mesh in memory is called in messages.
        raw: its content.
        unit: one of :data:`UNITS`; None takes the unit that the content states, else metres.

    Returns:
        The closed surface. A sound mesh keeps its exact coordinates; equal vertices are made one where
        the format gives every face its own (STL, GLB, 3MF).

    Raises:
        UnitError: an item larger than 2 m or smaller than 2 mm.
        MeshError: everything else that is wrong with it, one line that names it.
    """
    if not len(raw.faces):
        content = f"{len(raw.vertices)} points but no faces" if len(raw.vertices) else "no faces"
        raise MeshError(
            f"{path}: has {content}, an item needs a closed surface; export it as a triangle mesh"
        )
    _check_points(path, raw.vertices)
    scale = UNITS[unit] if unit is not None else (raw.metres or 1.0)
    surface = used_part(raw.vertices, raw.faces, split=raw.split)
    if not len(surface.faces):
        raise MeshError(f"{path}: no face has three different corners, so it has no surface")
    _check_size(path, surface.vertices, scale, unit, raw.metres)
    said = (_coarse(surface.vertices, scale), _long(surface.vertices, unit, raw.metres))
    notes = (*raw.notes, *surface.notes, *filter(None, said))
    vertices = surface.vertices if scale == 1.0 else surface.vertices * scale
    try:
        _check_not_flat(path, vertices)
        result = mend(path, replace(surface, vertices=vertices, notes=notes))
    except MeshError as problem:
        # The holes and crossings of a shape that was lost are not what has to be mended.
        raise MeshError("; ".join(filter(None, (str(problem), said[0])))) from None
    vertices, faces = np.ascontiguousarray(result.vertices), np.ascontiguousarray(result.faces)
    solid = solid_properties(vertices, faces)
    wrong = impossible(vertices, solid)
    if wrong:
        raise MeshError(
            f"{path}: its surface runs through itself so far that {wrong}; make it one clean surface in a "
            "modelling program (Blender: modifier Remesh), or export its parts as closed bodies"
        )
    return LoadedMesh(vertices, faces, solid, result.repairs, result.notes)


def make_item(
    name: str,
    mesh: LoadedMesh,
    *,
    file: str,
    mass: float | None,
    limits: ItemLimits = NO_LIMITS,
    com: Sequence[float] | None = None,
    friction: float | None = None,
) -> Item:
    """Give a mesh its name, mass and mass properties under uniform density.

    Args:
        name: name in the catalogue.
        mesh: from :func:`solid_mesh`.
        file: the mesh file's name inside its catalogue folder.
        mass: kg; None estimates it by :func:`packenv.geometry.mass.estimated_mass`.
        limits: what may not be done with the item.
        com: (3,) centre of mass, mesh frame, m; None is that of uniform density.
        friction: coefficient of its surface; None takes that of the options.

    Returns:
        The item.

    Raises:
        MeshError: the mass or the friction is not a positive number, or the centre of mass is outside the hull.
    """
    properties = mesh.solid
    if friction is not None and not (is_number(friction) and friction > 0):
        raise MeshError(f"item {name}: its friction is {friction!r:.60}, give a number above 0")
    if mass is not None and not (np.isfinite(mass) and mass > 0):
        raise MeshError(f"item {name}: its mass is {mass:g}, give kilograms above 0")
    kilograms = mass if mass is not None else estimated_mass(properties.volume, hull_volume(mesh.vertices))
    density = kilograms / properties.volume
    notes = mesh.notes
    if density > HEAVIEST:
        notes = (*notes, f"{kilograms:g} kg is {density:,.0f} kg/m³, denser than any metal: is it in grams?")
    return Item(
        name=name,
        vertices=mesh.vertices,
        faces=mesh.faces,
        volume=properties.volume,
        mass=float(kilograms),
        mass_estimated=mass is None,
        com=properties.com if com is None else _com_inside(name, mesh.vertices, com),
        inertia=properties.inertia * density,
        sha256=mesh_hash(mesh.vertices, mesh.faces),
        file=file,
        repairs=mesh.repairs,
        notes=notes,
        limits=limits,
        friction=friction,
    )


def _com_inside(name: str, vertices: FloatArray, com: Sequence[float]) -> FloatArray:
    """A centre of mass that the user gives, (3,), m.

    Raises:
        MeshError: it is none, or outside the hull, where no mass inside the item puts it.
    """
    if len(com) != 3 or not all(map(is_number, com)):
        raise MeshError(f"item {name}: its centre of mass is {com!r:.60}, give three finite numbers, m")
    centre = np.array(com, dtype=np.float64)
    outside = beyond_hull(vertices, centre)
    if outside > 0.0:
        place = ", ".join(f"{c:g}" for c in centre)
        raise MeshError(
            f"item {name}: its centre of mass ({place}) m is {outside * 1000:.3g} mm outside the item's hull; give "
            "it in the mesh's own frame, in metres"
        )
    return centre


def item_of(
    mesh: Any,
    name: str,
    *,
    unit: str | None = None,
    mass: float | None = None,
    limits: ItemLimits = NO_LIMITS,
    com: Sequence[float] | None = None,
    friction: float | None = None,
) -> Item:
    """Make an item of a mesh in memory, checked and mended as a mesh file is; see :meth:`Item.from_trimesh`.

    Raises:
        UnitError: an unknown unit, or an item larger than 2 m or smaller than 2 mm.
        MeshError: everything else that is wrong with the mesh or the mass.
    """
    check_unit(unit)
    where = Path(f"mesh {name!r}")
    if not (hasattr(mesh, "vertices") and hasattr(mesh, "faces")):
        kind = type(mesh).__name__
        raise MeshError(
            f"{where}: is of type {kind}, give one with vertices and faces, such as trimesh.Trimesh"
        )
    try:
        vertices = np.array(mesh.vertices, dtype=np.float64)
        faces = np.array(mesh.faces, dtype=np.int64)
    except (TypeError, ValueError):
        raise MeshError(f"{where}: its vertices or faces are no numbers") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(
            f"{where}: vertices of shape {vertices.shape} and faces of {faces.shape}, give (n, 3) and (m, 3)"
        )
    try:
        check_counts(vertices=len(vertices), faces=len(faces))
        check_indices(faces, len(vertices))
    except MeshError as problem:
        raise MeshError(f"{where}: {problem}") from None
    raw = RawMesh(vertices, faces, split=True, metres=_metres(getattr(mesh, "units", None)))
    loaded = solid_mesh(where, raw, unit)
    return make_item(name, loaded, file=name, mass=mass, limits=limits, com=com, friction=friction)


def _metres(stated: object) -> float | None:
    """Length of the unit that a mesh states, in metres, or None where it states none that is known."""
    if not isinstance(stated, str):
        return None
    from trimesh.units import unit_conversion

    try:
        return round(float(unit_conversion(stated, "meters")), 12)
    except ValueError:
        return None


def mesh_hash(vertices: FloatArray, faces: IntArray) -> str:
    """Hex SHA-256 of a mesh as used: shapes, then little-endian float64 and int64 in C order.

    Args:
        vertices: (n, 3), m.
        faces: (m, 3).
    """
    digest = hashlib.sha256(f"mesh <f8 {vertices.shape} <i8 {faces.shape}\n".encode())
    digest.update(np.ascontiguousarray(vertices, dtype="<f8").tobytes())
    digest.update(np.ascontiguousarray(faces, dtype="<i8").tobytes())
    return digest.hexdigest()


def _check_points(path: Path, vertices: FloatArray) -> None:
    """Refuse coordinates that are no numbers, or so large that products of three overflow."""
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        k = int(np.argmin(finite))
        raise MeshError(
            f"{path}: vertex {k + 1} is ({', '.join(f'{x:g}' for x in vertices[k])}), "
            "coordinates must be finite numbers; export it again"
        )
    largest = float(np.abs(vertices).max(initial=0.0))
    if largest > MAX_COORDINATE:
        raise UnitError(
            f"{path}: a coordinate of {largest:.3g}, items are 2 mm to 2 m; "
            "no --unit makes it so, it is damaged or needs scaling"
        )


def _check_size(path: Path, vertices: FloatArray, scale: float, unit: str | None, own: float | None) -> None:
    raw_size = float(np.ptp(vertices, axis=0).max())
    size = raw_size * scale
    if size == 0:
        raise MeshError(f"{path}: all vertices are at one point, so it has no surface")
    if SMALLEST <= size <= LARGEST:
        return
    found = f"{path}: {size:.3g} m {'large' if size > LARGEST else 'small'}"
    if unit is not None:
        found += f" with --unit {unit}"
    elif own is None:
        found += " if its numbers are metres"
    fits = _other_units(raw_size, unit)
    hint = f"give its unit: --unit {fits}" if fits else "no --unit makes it so; scale it when exporting"
    raise UnitError(f"{found}, items are {SMALLEST * 1000:g} mm to {LARGEST:g} m; {hint}", size)


def _other_units(raw_size: float, unit: str | None) -> str:
    """What an item would measure in the units that fit, as words; empty where none fits."""
    sizes = {u: raw_size * factor for u, factor in UNITS.items() if u != unit}
    fits = [f"{u} makes it {size:.3g} m" for u, size in sizes.items() if SMALLEST <= size <= LARGEST]
    # Millimetres are by far the most usual of the units that are not metres.
    usual = [text for text in fits if text.startswith("mm ")]
    return (usual or [", ".join(fits)])[0]


def _long(vertices: FloatArray, unit: str | None, own: float | None) -> str | None:
    """What to say of an item that is long if its numbers are metres, which nobody said."""
    size = float(np.ptp(vertices, axis=0).max())
    if size <= LONG or unit is not None or own is not None:
        return None
    others = _other_units(size, "m")
    return f"suspicious: {size:.3g} m if its numbers are metres" + (f"; --unit {others}" if others else "")


def _coarse(vertices: FloatArray, scale: float) -> str | None:
    """What to say of coordinates in single precision that are too far off for the item's size."""
    size, far = float(np.ptp(vertices, axis=0).max()), np.abs(vertices).max()
    step = float(np.spacing(np.float32(far)))
    if step < COARSE * size or not np.array_equal(vertices, vertices.astype(np.float32)):
        return None
    return (
        f"it lies {far * scale:.3g} m from the origin, where single precision is {step * scale * 1000:.2g} mm "
        f"coarse: its shape is rounded; move it to the origin before exporting"
    )


def _check_not_flat(path: Path, vertices: FloatArray) -> None:
    centred = vertices - vertices.mean(axis=0)
    size = float(np.ptp(vertices, axis=0).max())
    # Along each axis of the point cloud; the smallest is its spread across the best plane.
    _, axes = np.linalg.eigh(centred.T @ centred)
    across = float(np.ptp(centred @ axes[:, 0]))
    if across <= FLAT * size:
        raise MeshError(f"{path}: flat, all its vertices lie in one plane; an item needs a thickness")
