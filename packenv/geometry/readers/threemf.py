"""3MF: the objects that its build plate holds, components and transforms applied, in the unit it states."""

from __future__ import annotations

import io
import zipfile
import zlib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.raw import (
    MAX_FACES,
    MAX_FILE_BYTES,
    MAX_VERTICES,
    RawMesh,
    brief,
    check_counts,
    check_indices,
)
from packenv.geometry.readers.scene import ScenePart, joined
from packenv.types import FloatArray, IntArray

ROOT_MODEL = "3d/3dmodel.model"
"""Name, in lower case, that the main model usually has inside the archive."""

_METRES = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "inch": 0.0254,
    "foot": 0.3048,
    "meter": 1.0,
}
_MAX_DEPTH = 32
_MAX_PARTS = 10_000
_MAX_TAGS = MAX_FACES + MAX_VERTICES + 100_000
_RELATIONS = "_rels/.rels"


def read_threemf(path: Path, data: bytes) -> RawMesh:
    """Read a 3MF file (core specification, and the production extension's objects in other model files).

    Args:
        path: named in messages.
        data: the file's bytes.

    Returns:
        Everything on the build plate in one mesh.

    Raises:
        MeshError: a damaged archive or model, nothing on the build plate, or more than the limits.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return _Package(path, archive).read()
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as problem:
        raise MeshError(
            f"{path}: truncated or damaged 3MF file ({brief(problem)}); export it again"
        ) from None
    except (ElementTree.ParseError, LookupError, ValueError, OverflowError) as problem:
        raise MeshError(
            f"{path}: damaged 3MF file, its model cannot be read ({brief(problem)}); export it again"
        ) from None


class _Package:
    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        self.path = path
        self.archive = archive
        self.models: dict[str, ElementTree.Element] = {}
        self.names = {name.lower().lstrip("/"): name for name in archive.namelist()}
        self.tags = 0
        self.objects: dict[str, dict[str | None, ElementTree.Element]] = {}
        self.meshes: dict[tuple[str, str], tuple[FloatArray, IntArray]] = {}
        self.parts: list[ScenePart] = []
        self.visited = 0
        self.counts = [0, 0]

    def read(self) -> RawMesh:
        # An archive says how long its members are; a lie is caught by the length that is read.
        if sum(info.file_size for info in self.archive.infolist()) > MAX_FILE_BYTES:
            raise MeshError(
                f"{self.path}: unpacks to more than {MAX_FILE_BYTES >> 20} MiB; decimate the mesh"
            )
        name = self._root()
        root = self._model(name)
        unit = root.get("unit", "millimeter")
        if unit not in _METRES:
            raise MeshError(f"{self.path}: its unit is {brief(unit)!r}, 3MF knows {', '.join(_METRES)}")
        for item in root.findall("{*}build/{*}item"):
            self._place(_model_of(item) or name, item.attrib["objectid"], _transform(item), 0)
        return joined(self.path, self.parts, metres=_METRES[unit])

    def _root(self) -> str:
        """Name of the main model: the one that the package's relations name, else the usual one."""
        if ROOT_MODEL not in self.names and _RELATIONS in self.names:
            for relation in self._model(_RELATIONS):
                if relation.get("Type", "").endswith("/3dmodel"):
                    return relation.attrib["Target"].lstrip("/").lower()
        return ROOT_MODEL

    def _model(self, name: str) -> ElementTree.Element:
        if name not in self.models:
            if name not in self.names:
                raise MeshError(f"{self.path}: not a 3MF file, or damaged: it holds no {brief(name)}")
            text = self.archive.read(self.names[name])
            if b"\0" in text:
                raise MeshError(f"{self.path}: {brief(name)} is not in UTF-8; export it again")
            if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
                raise MeshError(f"{self.path}: its model declares XML entities, which 3MF does not allow")
            check_counts(self.path, vertices=text.count(b"<vertex "), faces=text.count(b"<triangle "))
            # A few hundred packed kilobytes can hold 100 million tags, each an object in memory.
            self.tags += text.count(b"<")
            if self.tags > _MAX_TAGS:
                raise MeshError(f"{self.path}: over {_MAX_TAGS:,} XML tags in its models; decimate the mesh")
            self.models[name] = ElementTree.fromstring(text)
        return self.models[name]

    def _place(self, model: str, object_id: str, transform: FloatArray, depth: int) -> None:
        self.visited += 1
        if depth > _MAX_DEPTH or self.visited > _MAX_PARTS:
            raise MeshError(
                f"{self.path}: damaged 3MF file, its components are nested in a circle or too many"
            )
        if model not in self.objects:
            found = self._model(model).findall("{*}resources/{*}object")
            self.objects[model] = {thing.get("id"): thing for thing in reversed(found)}
        thing = self.objects[model].get(object_id)
        if thing is None:
            raise MeshError(
                f"{self.path}: damaged 3MF file, object {brief(object_id)} is placed but not there"
            )
        mesh = thing.find("{*}mesh")
        if mesh is not None:
            if (model, object_id) not in self.meshes:
                self.meshes[model, object_id] = self._arrays(mesh)
            part = ScenePart(*self.meshes[model, object_id], transform)
            # Counted before it is moved to its place: a small file can place a large mesh very often.
            self.counts = [self.counts[0] + len(part.vertices), self.counts[1] + len(part.faces)]
            check_counts(self.path, vertices=self.counts[0], faces=self.counts[1])
            self.parts.append(part)
        for component in thing.findall("{*}components/{*}component"):
            nested = transform @ _transform(component)
            self._place(_model_of(component) or model, component.attrib["objectid"], nested, depth + 1)

    def _arrays(self, mesh: ElementTree.Element) -> tuple[FloatArray, IntArray]:
        points = [[v.attrib[a] for a in "xyz"] for v in mesh.iterfind("{*}vertices/{*}vertex")]
        corners = [
            [int(t.attrib[a]) for a in ("v1", "v2", "v3")] for t in mesh.iterfind("{*}triangles/{*}triangle")
        ]
        vertices = np.array(points, dtype=np.float64).reshape(-1, 3)
        faces = np.array(corners, dtype=np.int64).reshape(-1, 3)
        check_indices(self.path, faces, len(vertices))
        return vertices, faces


def _model_of(element: ElementTree.Element) -> str | None:
    """The other model file that a production-extension reference names, or None."""
    for key, value in element.attrib.items():
        if key.endswith("}path"):
            return value.lstrip("/").lower()
    return None


def _transform(element: ElementTree.Element) -> FloatArray:
    """(4, 4) from the 12 numbers of the attribute: 3MF multiplies rows from the left."""
    transform = np.eye(4)
    text = element.get("transform")
    if text:
        transform[:3, :] = np.array(text.split(), dtype=np.float64).reshape(4, 3).T
    return transform
