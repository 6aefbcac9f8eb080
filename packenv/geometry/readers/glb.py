"""Binary glTF 2.0 (GLB): the triangles of the scene, placed by its nodes. Its unit is the metre."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packenv.errors import MeshError
from packenv.geometry.readers.raw import RawMesh, brief, check_counts, check_indices
from packenv.geometry.readers.scene import ScenePart, joined
from packenv.types import FloatArray, IntArray

_JSON, _BIN = 0x4E4F534A, 0x004E4942
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_")
_MAX_DEPTH = 64
_MAX_NODES = 10_000


def read_glb(path: Path, data: bytes) -> RawMesh:
    """Read a GLB file.

    Args:
        path: named in messages.
        data: the file's bytes.

    Returns:
        Every triangle mesh of the default scene in one, transforms applied.

    Raises:
        MeshError: truncated, data outside the file, compressed by an extension, or damaged.
    """
    document, binary = _chunks(path, data)
    try:
        return _Reader(path, document, binary).read()
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as problem:
        raise MeshError(
            f"{path}: damaged GLB file ({type(problem).__name__}: {brief(problem)}); export it again"
        ) from None


def _chunks(path: Path, data: bytes) -> tuple[dict[str, Any], bytes]:
    if len(data) < 20 or data[:4] != b"glTF":
        raise MeshError(f"{path}: not a GLB file, or truncated: it does not begin with a glTF header")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise MeshError(f"{path}: glTF version {version}, only version 2 is read; export it again")
    if length > len(data):
        raise MeshError(f"{path}: truncated, its header announces {length:,} bytes and it has {len(data):,}")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise MeshError(f"{path}: truncated or damaged, a chunk of its data is longer than the file")
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    try:
        document = json.loads(chunks[_JSON])
    except (KeyError, ValueError, RecursionError):
        raise MeshError(f"{path}: damaged GLB file, its scene description cannot be read") from None
    if not isinstance(document, dict):
        raise MeshError(f"{path}: damaged GLB file, its scene description is no object")
    return document, chunks.get(_BIN, b"")


class _Reader:
    def __init__(self, path: Path, document: dict[str, Any], binary: bytes) -> None:
        self.path = path
        self.document = document
        self.binary = binary
        self.skipped = 0
        self.visited = 0

    def read(self) -> RawMesh:
        self._check_supported()
        document = self.document
        scenes = document.get("scenes", [])
        nodes = document.get("nodes", [])
        roots = scenes[_natural(document.get("scene", 0))].get("nodes", []) if scenes else range(len(nodes))
        parts: list[ScenePart] = []
        for root in roots:
            self._visit(root, np.eye(4), parts, 0)
        notes = (f"{self.skipped} sets of points or lines were ignored",) if self.skipped else ()
        return joined(self.path, parts, metres=1.0, notes=notes)

    def _check_supported(self) -> None:
        for name in self.document.get("extensionsRequired", []):
            if not str(name).startswith(_HARMLESS):
                raise MeshError(
                    f"{self.path}: needs the glTF extension {brief(name)}; export it without compression"
                )
        if any("uri" in buffer for buffer in self.document.get("buffers", [])):
            raise MeshError(f"{self.path}: keeps its data in another file; export one self-contained GLB")

    def _visit(self, index: int, parent: FloatArray, parts: list[ScenePart], depth: int) -> None:
        self.visited += 1
        if depth > _MAX_DEPTH or self.visited > _MAX_NODES:
            raise MeshError(
                f"{self.path}: damaged GLB file, its nodes are more than {_MAX_NODES:,} or nested in a circle"
            )
        node = self.document["nodes"][_natural(index)]
        transform = parent @ _local(node)
        if "mesh" in node:
            for primitive in self.document["meshes"][_natural(node["mesh"])]["primitives"]:
                part = self._part(primitive, transform)
                if part is None:
                    self.skipped += 1
                else:
                    parts.append(part)
                    check_counts(self.path, faces=sum(len(p.faces) for p in parts))
        for child in node.get("children", []):
            self._visit(child, transform, parts, depth + 1)

    def _part(self, primitive: dict[str, Any], transform: FloatArray) -> ScenePart | None:
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            return None
        vertices = self._accessor(primitive["attributes"]["POSITION"]).astype(np.float64)
        if vertices.ndim != 2:
            raise ValueError("positions that are not VEC3")
        if "indices" in primitive:
            corners = self._accessor(primitive["indices"]).astype(np.int64)
        else:
            corners = np.arange(len(vertices))
        check_indices(self.path, corners, len(vertices))
        return ScenePart(vertices, _triangles(corners, mode), transform)

    def _accessor(self, index: int) -> NDArray[np.generic]:
        accessor = self.document["accessors"][_natural(index)]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise MeshError(f"{self.path}: sparse glTF data are not read; export it without them")
        width = _WIDTHS[accessor["type"]]
        dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
        count = _natural(accessor["count"])
        check_counts(self.path, vertices=count if width == 3 else 0, faces=count // 3 if width == 1 else 0)
        view = self.document["bufferViews"][_natural(accessor["bufferView"])]
        stride = _natural(view.get("byteStride", 0)) or width * dtype.itemsize
        start = _natural(view.get("byteOffset", 0)) + _natural(accessor.get("byteOffset", 0))
        if count and start + stride * (count - 1) + width * dtype.itemsize > len(self.binary):
            raise MeshError(
                f"{self.path}: truncated or damaged, {count:,} values lie beyond the end of its data"
            )
        rows: NDArray[np.generic] = np.ndarray(
            (count, width),
            dtype,
            buffer=self.binary,
            offset=start if count else 0,
            strides=(stride, dtype.itemsize),
        )
        return rows[:, 0] if width == 1 else rows


def _natural(value: Any) -> int:
    """A count or index of the description: Python's negative indices must not slip through."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{value!r} where a natural number belongs")
    return value


def _triangles(corners: IntArray, mode: int) -> IntArray:
    if mode == _TRIANGLES:
        if len(corners) % 3:
            raise ValueError(f"{len(corners)} indices are not whole triangles")
        return corners.reshape(-1, 3)
    if mode == _FAN:
        return np.stack(
            [np.broadcast_to(corners[:1], max(len(corners) - 2, 0)), corners[1:-1], corners[2:]], axis=1
        )
    strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    strip[1::2] = strip[1::2, ::-1]
    return strip


def _local(node: dict[str, Any]) -> FloatArray:
    """(4, 4) transform of a node, from its matrix or its translation, rotation (xyzw) and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    transform = np.eye(4)
    transform[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    transform[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    transform[:3, 3] = node.get("translation", (0, 0, 0))
    return transform
