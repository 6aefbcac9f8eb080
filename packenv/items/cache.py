"""The user's cache of prepared items, one file for each mesh hash and discretization."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from packenv.config import HEIGHT_QUANTUM, GridConfig
from packenv.geometry.ball_fit import Ball
from packenv.geometry.convex_parts import FORMAT as PARTS_FORMAT, ConvexParts, convex_parts, envelope
from packenv.geometry.distance_grids import FORMAT as FIELD_FORMAT, SurfaceField
from packenv.geometry.meshes import mesh_hash
from packenv.geometry.prepare import PreparedItem, prepare_item
from packenv.items.cache_files import CacheFile, default_folder
from packenv.types import Item, OrientedItem, StablePose

_FORMAT = 3
"""Raise this when poses or heightmaps change: files of another format are never read."""


class ItemCache:
    """Prepared items on disk. A missing, damaged or foreign file is made anew, never believed."""

    def __init__(self, folder: Path | None = None) -> None:
        """Use ``folder``, or the user's own cache folder."""
        self.folder = folder or default_folder()

    def prepared_file(self, item: Item, grid: GridConfig) -> CacheFile:
        """Where the prepared item of this mesh, centre of mass and discretization is kept."""
        made_of = (_FORMAT, item.sha256, item.com.tolist(), grid.cell_size, grid.n_poses, grid.n_yaws)
        stance = item.limits.stance or ()
        return CacheFile(self.folder, "prepared", repr((*made_of, HEIGHT_QUANTUM, *stance)))

    def parts_file(self, item: Item) -> CacheFile:
        """Where the convex parts of this mesh are kept."""
        return CacheFile(self.folder, "parts", repr((PARTS_FORMAT, item.sha256)))

    def get(self, item: Item, grid: GridConfig) -> PreparedItem | None:
        """Read a prepared item; None where there is none that can be used."""
        arrays = self.prepared_file(item, grid).read()
        return None if arrays is None else _unpack(item, grid, arrays)

    def prepare(self, item: Item, grid: GridConfig) -> PreparedItem:
        """Read a prepared item, or make and keep it.

        Raises:
            InputError: the cache folder cannot be written.
        """
        file = self.prepared_file(item, grid)
        return file.kept(lambda: prepare_item(item, grid), _pack, partial(_unpack, item, grid))

    def surface_field(self, item: Item) -> SurfaceField:
        """Read an item's surface field, or make and keep it.

        Raises:
            InputError: the cache folder cannot be written.
        """
        file = CacheFile(self.folder, "fields", repr((FIELD_FORMAT, item.sha256)))
        return file.kept(lambda: SurfaceField.of_item(item), SurfaceField.to_arrays, SurfaceField.from_arrays)

    def parts(self, item: Item) -> ConvexParts:
        """Read an item's convex parts, or make and keep them: seconds for a scan.

        Raises:
            InputError: the cache folder cannot be written.
        """
        return self.parts_file(item).kept(lambda: convex_parts(item), _pack_parts, _unpack_parts)

    def envelope(self, item: Item, parts: ConvexParts) -> Item:
        """Read an item's envelope, or make and keep it.

        Raises:
            InputError: the cache folder cannot be written.
            MeshError: mesh and parts cannot be united.
        """
        digest = hashlib.sha256()
        for part in parts.parts:
            digest.update(np.ascontiguousarray(part).tobytes())
        file = CacheFile(self.folder, "envelopes", repr((PARTS_FORMAT, item.sha256, digest.hexdigest())))
        return file.kept(
            lambda: envelope(item, parts),
            lambda united: {"vertices": united.vertices, "faces": united.faces},
            lambda arrays: _with_surface(item, arrays["vertices"], arrays["faces"]),
        )


def _with_surface(item: Item, vertices: np.ndarray, faces: np.ndarray) -> Item:
    return replace(item, vertices=vertices, faces=faces, sha256=mesh_hash(vertices, faces))


def _pack_parts(parts: ConvexParts) -> dict[str, np.ndarray]:
    ball = [] if parts.ball is None else [*parts.ball.centre, parts.ball.radius]
    return {
        "vertices": np.concatenate(parts.parts),
        "sizes": np.array([len(p) for p in parts.parts]),
        "ball": np.array(ball, dtype=np.float64),
        "reach": np.array([parts.bulge, parts.dent]),
    }


def _unpack_parts(arrays: Mapping[str, np.ndarray]) -> ConvexParts:
    ball, (bulge, dent) = arrays["ball"], arrays["reach"].tolist()
    parts = np.split(arrays["vertices"], np.cumsum(arrays["sizes"])[:-1])
    fitted = Ball(ball[:3], float(ball[3])) if len(ball) else None
    return ConvexParts(tuple(np.ascontiguousarray(p) for p in parts), fitted, bulge, dent)


def _pack(prepared: PreparedItem) -> dict[str, np.ndarray]:
    poses = np.array([[*p.rotation.ravel(), p.probability, p.com_height, p.members] for p in prepared.poses])
    rows = [
        [o.pose_index, o.yaw, *o.top.shape, *o.rotation.ravel(), *o.offset, *o.extents, *o.com]
        for o in prepared.orientations
    ]
    maps = np.concatenate([m.ravel() for o in prepared.orientations for m in (o.top, o.bottom)])
    return {"poses": poses, "orientations": np.array(rows), "maps": maps}


def _unpack(item: Item, grid: GridConfig, arrays: Mapping[str, np.ndarray]) -> PreparedItem:
    poses, maps = arrays["poses"], arrays["maps"]
    kept = tuple(StablePose(p[:9].reshape(3, 3), float(p[9]), float(p[10]), int(p[11])) for p in poses)
    oriented = []
    start = 0
    for row in arrays["orientations"]:
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
    return PreparedItem(item.name, item.sha256, item.volume, kept, tuple(oriented), item.limits)
