"""Binary glTF 2.0 (GLB): the triangles of the scene, placed by its nodes. Its unit is the metre.

trimesh leaves out parts that hang on a camera or on lines, or whose transform holds NaN, takes sparse and
missing data for zeros and negative numbers for others, and passes over fans, instancing and poses.
"""

from __future__ import annotations

import dataclasses
import struct
from typing import Any

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.raw import MAX_FILE_BYTES, RawMesh, brief, check_counts, read_mesh
from packenv.json_text import parse_json

_TRIANGLES, _STRIP = 4, 5
_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_FLOAT, _INDICES = 5126, [("SCALAR", unsigned) for unsigned in (5121, 5123, 5125)]
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_")
_INSTANCING = b"EXT_mesh_gpu_instancing"
_MAX_DEPTH, _MAX_NODES = 32, 10_000


def read_glb(data: bytes) -> RawMesh:
    """Read a GLB file: every triangle mesh of the default scene in one, transforms applied.

    Raises:
        MeshError: truncated, too much, damaged, or something that trimesh would not read or read wrongly.
    """
    if len(data) < 20 or data[:4] != b"glTF":
        raise MeshError("not a GLB file, or truncated: it does not begin with a glTF header")
    version, length, size = struct.unpack_from("<3I", data, 4)
    if version != 2:
        raise MeshError(f"glTF version {version}, only version 2 is read; export it again")
    if length > len(data):
        raise MeshError(f"truncated, its header announces {length:,} bytes and it has {len(data):,}")
    text = data[20 : 20 + size]
    if _INSTANCING in text:
        raise MeshError("needs the glTF extension EXT_mesh_gpu_instancing; export copies as nodes")
    document = parse_json(text, "its glTF description", "a file that is exported again", MeshError)
    _refuse_special(document)
    raw = read_mesh("glb", data, *_announced(document), skip_materials=True)
    return dataclasses.replace(raw, split=True, metres=1.0)


def _refuse_special(document: dict[str, Any]) -> None:
    for name in document.get("extensionsRequired", []):
        if not name.startswith(_HARMLESS):
            raise MeshError(f"needs the glTF extension {brief(name)}; export it without compression")
    if any("uri" in buffer for buffer in document.get("buffers", [])):
        raise MeshError("keeps its data in another file; export one self-contained GLB")
    nodes = document.get("nodes", [])
    if any("skin" in row or any(row.get("weights", [])) for row in [*nodes, *document.get("meshes", [])]):
        raise MeshError("a skeleton or morph poses it (glTF skin); export it with the pose applied")
    if any("camera" in node and ("mesh" in node or node.get("children")) for node in nodes):
        raise MeshError("parts hang on a camera; export it without cameras")
    for node in nodes:
        for key in ("matrix", "translation", "rotation", "scale"):
            if not np.isfinite(np.array(node.get(key, 0), dtype=np.float64)).all():
                raise MeshError(f"the {key} of a node must hold finite numbers; export it again")


def _announced(document: dict[str, Any]) -> tuple[int, int]:
    """Vertices and faces of the scene, counted before any of it is expanded."""
    accessors, views = document.get("accessors", []), document.get("bufferViews", [])
    for row in [*accessors, *views]:
        for key in ("count", "bufferView", "byteOffset", "byteLength", "byteStride", "buffer"):
            _natural(row.get(key, 0))
        check_counts(vertices=row.get("count", 0))
    unpacked = sum(view["byteLength"] for view in views)
    unpacked += sum(a["count"] * _BYTES[a["componentType"]] * _NUMBERS[a["type"]] for a in accessors)
    if unpacked > 2 * MAX_FILE_BYTES:
        limit = MAX_FILE_BYTES >> 19
        raise MeshError(f"unpacks to {unpacked >> 20:,} MiB, the limit is {limit}; decimate the mesh")
    sizes = [_size(accessors, mesh["primitives"]) for mesh in document.get("meshes", [])]
    check_counts(vertices=sum(v for v, _ in sizes), faces=sum(f for _, f in sizes))
    nodes = document.get("nodes", [])
    seen: set[int] = set()
    vertices = faces = 0
    pending = [(k, 0) for k in document["scenes"][_natural(document.get("scene", 0))].get("nodes", [])]
    while pending:
        k, depth = pending.pop()
        # trimesh takes a time that grows with the cube of the depth.
        if k in seen or depth > _MAX_DEPTH or len(seen) == _MAX_NODES:
            raise MeshError(
                f"damaged GLB file, its nodes are more than {_MAX_NODES:,}, deeper than {_MAX_DEPTH}, "
                "placed twice or nested in a circle"
            )
        seen.add(k)
        node = nodes[_natural(k)]
        pending += [(child, depth + 1) for child in node.get("children", [])]
        if "mesh" in node:
            more = sizes[_natural(node["mesh"])]
            vertices, faces = vertices + more[0], faces + more[1]
            check_counts(vertices=vertices, faces=faces)
    return vertices, faces


def _size(accessors: list[dict[str, Any]], primitives: list[dict[str, Any]]) -> tuple[int, int]:
    vertices = faces = 0
    for primitive in primitives:
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP):
            raise MeshError("points, lines or triangle fans are not read; export it as plain triangles")
        used = [accessors[_natural(primitive["attributes"]["POSITION"])]]
        if "indices" in primitive:
            used.append(accessors[_natural(primitive["indices"])])
        if any("sparse" in accessor or "bufferView" not in accessor for accessor in used):
            raise MeshError("sparse glTF data are not read; export it without them")
        kinds = [(accessor["type"], accessor["componentType"]) for accessor in used]
        if kinds[0] != ("VEC3", _FLOAT) or any(kind not in _INDICES for kind in kinds[1:]):
            raise ValueError("positions that are no float VEC3, or indices that are no unsigned SCALAR")
        corners = used[-1]["count"]
        vertices += used[0]["count"]
        faces += corners // 3 if mode == _TRIANGLES else max(corners - 2, 0)
    return vertices, faces


def _natural(value: Any) -> int:
    """A count or index of the description: Python's negative indices must not slip through."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{value!r} where a natural number belongs")
    return value
