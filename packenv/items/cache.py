"""The user's cache of prepared items, one file for each mesh hash and discretization."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from packenv.config import HEIGHT_QUANTUM, GridConfig
from packenv.geometry.ball_fit import Ball
from packenv.geometry.convex_parts import FORMAT as PARTS_FORMAT, ConvexParts, convex_parts, envelope
from packenv.geometry.distance_grids import FORMAT as FIELD_FORMAT, SurfaceField
from packenv.geometry.meshes import mesh_hash
from packenv.geometry.prepare import PreparedItem, prepare_item
from packenv.items.cache_files import default_folder, read_arrays, write_arrays
from packenv.types import Item, OrientedItem, StablePose

_FORMAT = 2
"""Raise this when poses or heightmaps change: files of another format are never read."""


class ItemCache:
    """Prepared items on disk. A missing, torn or foreign file is made anew, never trusted."""

    def __init__(self, folder: Path | None = None) -> None:
        """Use ``folder``, or the user's own cache folder."""
        self.folder = folder or default_folder()

    def path(self, item: Item, grid: GridConfig) -> Path:
        """Where the prepared item of this mesh and this discretization is kept."""
        recipe = f"{_FORMAT}|{item.sha256}|{grid.cell_size!r}|{grid.n_poses}|{grid.n_yaws}|{HEIGHT_QUANTUM!r}"
        return self.folder / "prepared" / f"{hashlib.sha256(recipe.encode()).hexdigest()[:40]}.npz"

    def field_path(self, item: Item) -> Path:
        """Where the surface field of this mesh is kept."""
        return self.folder / "fields" / f"{FIELD_FORMAT}-{item.sha256[:40]}.npz"

    def parts_path(self, item: Item) -> Path:
        """Where the convex parts of this mesh are kept."""
        return self.folder / "parts" / f"{PARTS_FORMAT}-{item.sha256[:40]}.npz"

    def get(self, item: Item, grid: GridConfig) -> PreparedItem | None:
        """Read a prepared item; None where there is none that can be used."""
        return read_arrays(
            self.path(item, grid), lambda a: _unpack(item, grid, a["poses"], a["orientations"], a["maps"])
        )

    def put(self, item: Item, grid: GridConfig, prepared: PreparedItem) -> None:
        """Write a prepared item, whole or not at all.

        Raises:
            InputError: the cache folder cannot be written.
        """
        poses, orientations, maps = _pack(prepared)
        write_arrays(
            self.folder, self.path(item, grid), {"poses": poses, "orientations": orientations, "maps": maps}
        )

    def surface_field(self, item: Item) -> SurfaceField:
        """Read an item's surface field, or make and keep it.

        Raises:
            InputError: the cache folder cannot be written.
        """
        path = self.field_path(item)
        field = read_arrays(path, SurfaceField.from_arrays)
        if field is None:
            field = SurfaceField.of_item(item)
            write_arrays(self.folder, path, field.to_arrays())
        return field

    def parts(self, item: Item) -> ConvexParts:
        """Read an item's convex parts, or make and keep them: seconds for a scan.

        Raises:
            InputError: the cache folder cannot be written.
        """
        path = self.parts_path(item)
        parts = read_arrays(path, _unpack_parts)
        if parts is None:
            parts = convex_parts(item)
            write_arrays(self.folder, path, _pack_parts(parts))
        return parts

    def envelope(self, item: Item, parts: ConvexParts) -> Item:
        """Read an item's envelope, or make and keep it.

        Raises:
            InputError: the cache folder cannot be written.
            MeshError: mesh and parts cannot be united.
        """
        recipe = hashlib.sha256(f"{PARTS_FORMAT}|{item.sha256}".encode())
        for part in parts.parts:
            recipe.update(np.ascontiguousarray(part).tobytes())
        path = self.folder / "envelopes" / f"{recipe.hexdigest()[:40]}.npz"
        known = read_arrays(path, lambda a: (a["vertices"], a["faces"]))
        if known is None:
            united = envelope(item, parts)
            write_arrays(self.folder, path, {"vertices": united.vertices, "faces": united.faces})
            known = united.vertices, united.faces
        vertices, faces = known
        return replace(item, vertices=vertices, faces=faces, sha256=mesh_hash(vertices, faces))

    def prepare(self, item: Item, grid: GridConfig) -> PreparedItem:
        """Read a prepared item, or make and keep it."""
        prepared = self.get(item, grid)
        if prepared is None:
            prepared = prepare_item(item, grid)
            self.put(item, grid, prepared)
        return prepared


def _pack_parts(parts: ConvexParts) -> dict[str, np.ndarray]:
    ball = [] if parts.ball is None else [*parts.ball.centre, parts.ball.radius]
    return {
        "vertices": np.concatenate(parts.parts),
        "sizes": np.array([len(p) for p in parts.parts]),
        "ball": np.array(ball, dtype=np.float64),
        "reach": np.array([parts.bulge, parts.dent]),
    }


def _unpack_parts(arrays: Mapping[str, np.ndarray]) -> ConvexParts:
    vertices, sizes, ball = arrays["vertices"], arrays["sizes"], arrays["ball"]
    bulge, dent = (float(x) for x in arrays["reach"])
    if vertices.shape != (sizes.sum(), 3) or not len(sizes) or sizes.min() < 4 or len(ball) not in (0, 4):
        raise ValueError("arrays of convex parts do not fit together")
    parts = tuple(np.ascontiguousarray(p) for p in np.split(vertices, np.cumsum(sizes)[:-1]))
    return ConvexParts(parts, Ball(ball[:3], float(ball[3])) if len(ball) else None, bulge, dent)


def _pack(prepared: PreparedItem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    poses = np.array([[*p.rotation.ravel(), p.probability, p.com_height, p.members] for p in prepared.poses])
    rows = [
        [o.pose_index, o.yaw, *o.top.shape, *o.rotation.ravel(), *o.offset, *o.extents, *o.com]
        for o in prepared.orientations
    ]
    maps = np.concatenate([m.ravel() for o in prepared.orientations for m in (o.top, o.bottom)])
    return poses, np.array(rows), maps


def _unpack(
    item: Item, grid: GridConfig, poses: np.ndarray, rows: np.ndarray, maps: np.ndarray
) -> PreparedItem:
    kept = tuple(StablePose(p[:9].reshape(3, 3), float(p[9]), float(p[10]), int(p[11])) for p in poses)
    oriented = []
    start = 0
    for row in rows:
        w, h = int(row[2]), int(row[3])
        top, bottom = maps[start : start + 2 * w * h].reshape(2, w, h)
        start += 2 * w * h
        oriented.append(
            OrientedItem(
                item=item.name,
                pose_index=int(row[0]),
                yaw=float(row[1]),
                rotation=row[4:13].reshape(3, 3),
                offset=row[13:16],
                extents=row[16:19],
                com=row[19:22],
                top=top,
                bottom=bottom,
                cell_size=grid.cell_size,
            )
        )
    return PreparedItem(item.name, item.sha256, item.volume, kept, tuple(oriented))
