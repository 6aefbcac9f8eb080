"""Binary glTF 2.0 (GLB): the triangles of the scene, placed by its nodes, by trimesh. Its unit is the metre.

trimesh leaves out parts that hang on a camera or on lines, or whose transform holds NaN, takes sparse and
missing data for zeros and negative numbers for others, and passes over fans and instancing. So what counts
in the scene's description is checked, the rest taken out, and what the nodes announce is held against what
trimesh finds.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.by_trimesh import by_trimesh
from packenv.geometry.readers.raw import RawMesh, brief, check_counts, check_indices
from packenv.geometry.readers.scene import ScenePart, joined

_JSON, _BIN = 0x4E4F534A, 0x004E4942
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_")
_MAX_DEPTH = 32
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
        n_vertices, n_faces, skipped = _checked(path, document)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as problem:
        raise MeshError(
            f"{path}: damaged GLB file ({type(problem).__name__}: {brief(problem)}); export it again"
        ) from None
    parts: list[ScenePart] = []
    if n_faces:
        scene = by_trimesh(path, "glb", _packed(document, binary), skip_materials=True)
        for node in scene.graph.nodes_geometry:
            transform, name = scene.graph[node]
            mesh = scene.geometry[name]
            check_indices(path, mesh.faces, len(mesh.vertices))
            parts.append(ScenePart(np.asarray(mesh.vertices), np.asarray(mesh.faces), transform))
    notes = (f"{skipped} sets of points or lines were ignored",) if skipped else ()
    raw = joined(path, parts, metres=1.0, notes=notes)
    if n_faces and (len(raw.vertices), len(raw.faces)) != (n_vertices, n_faces):
        raise MeshError(
            f"{path}: damaged GLB file, it announces {n_faces:,} faces and {len(raw.faces):,} are there; "
            "export it again"
        )
    return raw


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


def _packed(document: dict[str, Any], binary: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(binary), len(text), _JSON)
    return head + text + struct.pack("<II", len(binary), _BIN) + binary


def _checked(path: Path, document: dict[str, Any]) -> tuple[int, int, int]:
    """Vertices, faces and sets of points or lines that the scene announces, counted before it is expanded.

    What trimesh would trip over, and what plays no part, is taken out of the description.

    Raises:
        MeshError: something that trimesh would not read, or read wrongly.
    """
    for name in document.get("extensionsRequired", []):
        if not str(name).startswith(_HARMLESS):
            raise MeshError(f"{path}: needs the glTF extension {brief(name)}; export it without compression")
    if any("uri" in buffer for buffer in document.get("buffers", [])):
        raise MeshError(f"{path}: keeps its data in another file; export one self-contained GLB")
    for row in [*document.get("accessors", []), *document.get("bufferViews", [])]:
        for key in ("count", "bufferView", "byteOffset", "byteLength", "byteStride", "buffer"):
            _natural(row.get(key, 0))
        check_counts(path, vertices=row.get("count", 0))
    sizes = [_mesh(path, document["accessors"], mesh) for mesh in document.get("meshes", [])]
    nodes = document.get("nodes", [])
    below = {child for node in nodes for child in node.get("children", [])}
    scenes = document.setdefault("scenes", [{"nodes": [k for k in range(len(nodes)) if k not in below]}])
    pending = [(k, 0) for k in scenes[_natural(document.get("scene", 0))].get("nodes", [])]
    seen: set[int] = set()
    total = np.zeros(3, dtype=np.int64)
    while pending:
        k, depth = pending.pop()
        # trimesh takes a time that grows with the cube of the depth.
        if k in seen or depth > _MAX_DEPTH or len(seen) == _MAX_NODES:
            raise MeshError(
                f"{path}: damaged GLB file, its nodes are more than {_MAX_NODES:,}, deeper than {_MAX_DEPTH}, "
                "placed twice or nested in a circle"
            )
        seen.add(k)
        node = nodes[_natural(k)]
        pending += [(child, depth + 1) for child in node.get("children", [])]
        node.pop("camera", None)
        if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            raise MeshError(
                f"{path}: needs the glTF extension EXT_mesh_gpu_instancing; export copies as nodes"
            )
        if "skin" in node:
            raise MeshError(f"{path}: a skeleton poses it (glTF skin); export it with the pose applied")
        for key in ("matrix", "translation", "rotation", "scale"):
            if not np.isfinite(np.array(node.get(key, 0), dtype=np.float64)).all():
                raise MeshError(f"{path}: the {key} of a node must hold finite numbers; export it again")
        if "mesh" in node:
            size = sizes[_natural(node["mesh"])]
            if not size[1]:
                del node["mesh"]
            total += size
            check_counts(path, vertices=int(total[0]), faces=int(total[1]))
    return int(total[0]), int(total[1]), int(total[2])


def _mesh(path: Path, accessors: list[dict[str, Any]], mesh: dict[str, Any]) -> tuple[int, int, int]:
    """As for the scene; only the triangles of the mesh are left in it."""
    kept: list[dict[str, Any]] = []
    vertices = faces = 0
    for primitive in mesh["primitives"]:
        mode = primitive.get("mode", _TRIANGLES)
        if mode == _FAN:
            raise MeshError(f"{path}: triangle fans are not read; export it as plain triangles")
        if mode not in (_TRIANGLES, _STRIP):
            continue
        new = {"attributes": {"POSITION": primitive["attributes"]["POSITION"]}, "mode": mode}
        used = [accessors[_natural(new["attributes"]["POSITION"])]]
        if "indices" in primitive:
            new["indices"] = primitive["indices"]
            used.append(accessors[_natural(new["indices"])])
        if any("sparse" in accessor or "bufferView" not in accessor for accessor in used):
            raise MeshError(f"{path}: sparse glTF data are not read; export it without them")
        if [accessor["type"] for accessor in used] != ["VEC3", "SCALAR"][: len(used)]:
            raise ValueError("positions that are not VEC3, or indices that are not SCALAR")
        corners = used[-1]["count"]
        vertices += used[0]["count"]
        faces += corners // 3 if mode == _TRIANGLES else max(corners - 2, 0)
        kept.append(new)
    skipped = len(mesh["primitives"]) - len(kept)
    mesh["primitives"] = kept
    return vertices, faces, skipped


def _natural(value: Any) -> int:
    """A count or index of the description: Python's negative indices must not slip through."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{value!r} where a natural number belongs")
    return value
