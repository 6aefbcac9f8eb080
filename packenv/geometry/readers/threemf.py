"""3MF: what its build plate holds, as the slicers that write it mean it, in the unit that it states.

Read here and not by trimesh, which leaves out what other model files hold, takes helper volumes for solid
ones, runs in circles of components, and multiplies references out before it counts.

Sources: 3MF core specification 1.3 and its production extension; the configurations that PrusaSlicer
(``Slic3r_PE_model.config``: triangles from ``firstid`` to ``lastid``) and Bambu Studio and OrcaSlicer
(``model_settings.config``: components) put beside the model; the metadata of Cura.
"""

from __future__ import annotations

import io
import zipfile
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.raw import MAX_FILE_BYTES, RawMesh, brief, check_counts, check_indices
from packenv.geometry.topology import merge_equal
from packenv.types import FloatArray, IntArray

_ROOT_MODEL = "3d/3dmodel.model"  # as it is usually named; names are compared in lower case
_PRUSA, _BAMBU = "metadata/slic3r_pe_model.config", "metadata/model_settings.config"
_METRES = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "inch": 0.0254,
    "foot": 0.3048,
    "meter": 1.0,
}
_MAX_DEPTH, _MAX_PARTS, _MAX_TAGS = 32, 2_000, 2_000_000
_TOO_OFTEN = f"its parts are placed too often, or nested, over {_MAX_PARTS:,} in all; export fewer, flat"
_MAX_TAG_BYTES = 2**20
_MAX_RATIO, _SMALL = 200, 2**24  # text of a model shrinks to a fifth or a fifteenth, never that far

_SOLID, _LEFT_OUT, _NEGATIVE = 1, 0, -1
_OBJECT_TYPES = {"model": _SOLID, "support": _LEFT_OUT, "solidsupport": _LEFT_OUT, "other": _LEFT_OUT}
_VOLUME_TYPES = {
    "modelpart": _SOLID,
    "normalpart": _SOLID,
    "negativevolume": _NEGATIVE,
    "negativepart": _NEGATIVE,
    "parametermodifier": _LEFT_OUT,
    "modifierpart": _LEFT_OUT,
    "supportenforcer": _LEFT_OUT,
    "supportblocker": _LEFT_OUT,
}
_CURA_HELPERS = tuple(f"cura:{kind}_mesh" for kind in ("infill", "cutting", "support", "anti_overhang"))
_OTHER_SHAPES = ("beamlattice", "booleanshape", "displacementmesh", "volumetricstack", "levelset")

Key = tuple[str, str]
"""An object: its model file in lower case, and its id."""


class _Reference(NamedTuple):
    """A component or build item: which object, and where; row vectors times a (4, 4) matrix, or None."""

    key: Key
    matrix: FloatArray | None


@dataclass(eq=False)
class _Object:
    role: int
    points: array[float] = field(default_factory=lambda: array("d"))
    corners: array[int] = field(default_factory=lambda: array("q"))
    held: list[_Reference] = field(default_factory=list)


def read_threemf(data: bytes) -> RawMesh:
    """Read a 3MF file: all that is printed of its build plate in one mesh.

    Negative volumes are subtracted from the object that they belong to; modifiers, supports and items that
    are not printed are left out. Notes say so.

    Raises:
        MeshError: a damaged archive or model, more than the limits, or a shape that is not read.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        # An archive says how long its members are; no more than that is read of any.
        unpacked = sum(info.file_size for info in archive.infolist())
        if unpacked > min(MAX_FILE_BYTES, max(_SMALL, _MAX_RATIO * len(data))):
            raise MeshError(
                f"{len(data) / 2**20:.3g} MiB that unpack to {unpacked / 2**20:,.0f} MiB; decimate the mesh"
            )
        if any(
            info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for info in archive.filelist
        ):
            raise MeshError("not packed by deflate, which 3MF demands; export it again")
        model = _Model(archive)
    solids, notes = model.built()
    sizes = np.cumsum([0, *(len(points) for points, _ in solids)])
    return RawMesh(
        np.concatenate([np.empty((0, 3)), *(points for points, _ in solids)]),
        np.concatenate(
            [np.empty((0, 3), np.int64), *(f + n for (_, f), n in zip(solids, sizes, strict=False))]
        ),
        split=True,
        metres=_METRES[model.unit],
        notes=notes,
    )


class _Model:
    """The objects and the build plate of all model files that the root names, numbers not yet expanded."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self.unit = "millimeter"
        self.objects: dict[Key, _Object] = {}
        self.build: list[_Reference] = []
        self.unprinted = 0
        # Slicers' words: the role of a part in an object, and of triangles from first to last.
        self.parts: dict[tuple[str, str], int] = {}
        self.ranges: dict[str, list[list[int]]] = {}
        self.totals: dict[Key, tuple[int, ...]] = {}
        self._roles: dict[Key, IntArray] = {}
        self._archive = archive
        self._names = {name.lower().lstrip("/"): name for name in archive.namelist()}
        self._tags = self._references = 0
        self._file = self._id = ""
        self.root = _ROOT_MODEL
        if "_rels/.rels" in self._names:
            self._parse("_rels/.rels", self._relation)
        pending, seen = [self.root], {self.root}
        while pending:
            self._file = pending.pop()
            self._parse(self._file, self._start)
            here = {r.key[0] for o in self.objects.values() for r in o.held} | {r.key[0] for r in self.build}
            pending += sorted(here - seen)
            seen |= here
        for config in (_PRUSA, _BAMBU):
            if config in self._names:
                self._parse(config, self._configured)
        if self.unit not in _METRES:
            raise MeshError(f"its unit is {brief(self.unit)!r}, 3MF knows {', '.join(_METRES)}")

    def built(self) -> tuple[list[tuple[FloatArray, IntArray]], tuple[str, ...]]:
        """The solids on the build plate, (points (n, 3), corners (m, 3)) each, and what to say of them."""
        # Counted before any of it is expanded.
        counts = [self._counted(item.key) for item in self.build]
        vertices, faces, _ = map(sum, zip((0, 0, 0), *counts, strict=True))
        check_counts(vertices=vertices, faces=faces)
        if sum(references for *_, references in counts) > _MAX_PARTS:
            raise MeshError(_TOO_OFTEN)
        solids: list[tuple[FloatArray, IntArray]] = []
        left_out = subtracted = 0
        for item in self.build:
            placed = list(self._placed(item, None))
            pieces = {role: [(p, f) for r, p, f in placed if r == role and len(f)] for role in (1, 0, -1)}
            left_out += len(pieces[_LEFT_OUT])
            subtracted += len(pieces[_NEGATIVE])
            if pieces[_NEGATIVE] and pieces[_SOLID]:
                solids.append(_difference(pieces[_SOLID], pieces[_NEGATIVE]))
            else:
                solids += pieces[_SOLID]
        said = (
            (
                len(self.build) > 1,
                f"{len(self.build)} items on its build plate: save each alone to pack it alone",
            ),
            (self.unprinted, f"{self.unprinted} on its build plate left out (not printable)"),
            (left_out, f"{left_out} modifier or support volumes left out"),
            (subtracted, f"{subtracted} negative volumes subtracted"),
        )
        notes = tuple(text for true, text in said if true)
        if not solids and (notes or not self.build):
            raise MeshError("; ".join(("nothing solid is on its build plate", *notes)))
        return solids, notes

    def _parse(self, name: str, start: Callable[[str, dict[str, str]], None]) -> None:
        if name not in self._names:
            raise MeshError(f"not a 3MF file, or damaged: it holds no {brief(name)}")

        with self._archive.open(self._names[name]) as stream:
            # A few packed kilobytes can hold millions of tags.
            self._tags += sum(chunk.count(b"<") for chunk in iter(lambda: stream.read(2**20), b""))
        if self._tags > _MAX_TAGS:
            raise MeshError(f"over {_MAX_TAGS:,} XML tags in it; decimate the mesh")
        self._parser = parser = expat.ParserCreate()
        parser.StartElementHandler = start
        parser.StartDoctypeDeclHandler = _refuse_entities
        read = 0
        with self._archive.open(self._names[name]) as stream:
            while chunk := stream.read(2**16):
                read += len(chunk)
                parser.Parse(chunk, False)
                if read - parser.CurrentByteIndex > _MAX_TAG_BYTES:
                    raise MeshError("an XML tag or comment of over 1 MiB in it; export it again")
        parser.Parse(b"", True)

    def _relation(self, tag: str, attributes: dict[str, str]) -> None:
        if _plain(tag) == "Relationship" and attributes.get("Type", "").endswith("/3dmodel"):
            self.root = attributes["Target"].lower().lstrip("/")

    def _configured(self, tag: str, attributes: dict[str, str]) -> None:
        key, value = attributes.get("key"), attributes.get("value", "")
        match _plain(tag):
            case "object":
                self._id = attributes["id"]
            case "part":
                self.parts[self._id, attributes["id"]] = _role(attributes.get("subtype", "normal_part"))
            case "volume":
                first, last = int(attributes["firstid"]), int(attributes["lastid"])
                self.ranges.setdefault(self._id, []).append([first, last, _SOLID])
                if len(self.ranges[self._id]) > _MAX_PARTS:
                    raise MeshError(f"over {_MAX_PARTS:,} volumes in an object; export fewer")
            case "metadata" if key == "volume_type":
                self.ranges[self._id][-1][2] = _role(value)
            case "metadata" if key == "modifier" and value == "1" and self._id in self.ranges:
                self.ranges[self._id][-1][2] = _LEFT_OUT

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        match tag if tag in ("vertex", "triangle") else _plain(tag):
            case "vertex":
                self.objects[self._file, self._id].points.extend(float(attributes[axis]) for axis in "xyz")
            case "triangle":
                corners = self.objects[self._file, self._id].corners
                corners.extend(int(attributes[corner]) for corner in ("v1", "v2", "v3"))
            case "model":
                # Other model files are in the unit of the root.
                if self._file == self.root:
                    self.unit = attributes.get("unit", self.unit)
            case "object":
                self._id = attributes["id"]
                if (self._file, self._id) in self.objects or len(self.objects) >= _MAX_PARTS:
                    raise ValueError(f"object {brief(self._id)}: there twice, or one too many")
                kind = attributes.get("type", "model")
                if kind not in _OBJECT_TYPES:
                    raise MeshError(f"holds an object of type {brief(kind)!r}; export the finished solid")
                self.objects[self._file, self._id] = _Object(_OBJECT_TYPES[kind])
            case "metadata":
                helper = attributes.get("name") in _CURA_HELPERS
                self._parser.CharacterDataHandler = self._cura if helper else None
            case "component":
                self.objects[self._file, self._id].held.append(self._reference(attributes))
            case "item" if self._file == self.root:
                reference = self._reference(attributes)
                if _attribute(attributes, "printable", "1") in ("0", "false"):
                    self.unprinted += 1
                else:
                    self.build.append(reference)
            case tag if tag in _OTHER_SHAPES:
                raise MeshError(f"its shape is partly a 3MF {tag}, which is not read; export plain meshes")

    def _cura(self, text: str) -> None:
        if text.strip().lower() == "true":
            self.objects[self._file, self._id].role = _LEFT_OUT

    def _reference(self, attributes: dict[str, str]) -> _Reference:
        self._references += 1
        if self._references > _MAX_PARTS:
            raise MeshError(_TOO_OFTEN)
        matrix = None
        if "transform" in attributes:
            matrix = np.eye(4)
            matrix[:, :3] = np.array([float(x) for x in attributes["transform"].split()]).reshape(4, 3)
        return _Reference(
            (_attribute(attributes, "path", self._file).lower().lstrip("/"), attributes["objectid"]), matrix
        )

    def _counted(self, key: Key, depth: int = 0) -> tuple[int, ...]:
        """Vertices, faces and references of an object and all that it holds."""
        if depth > _MAX_DEPTH:
            raise MeshError("damaged 3MF file, its components are nested in a circle or too deep")
        if key not in self.objects:
            raise MeshError(f"damaged 3MF file, object {brief(key[1])} is placed but not there")
        if key not in self.totals:
            thing = self.objects[key]
            rows = [self._counted(part.key, depth + 1) for part in thing.held]
            rows.append((len(thing.points) // 3, len(thing.corners) // 3, 1))
            self.totals[key] = tuple(map(sum, zip(*rows, strict=True)))
        return self.totals[key]

    def _placed(
        self, reference: _Reference, given: int | None, outer: FloatArray | None = None
    ) -> Iterator[tuple[int, FloatArray, IntArray]]:
        """(role, points, corners) of an object and all that it holds, in the build plate's frame."""
        thing = self.objects[reference.key]
        role = thing.role if given is None else given
        matrix = reference.matrix
        if outer is not None:
            matrix = outer if matrix is None else matrix @ outer
        points = np.array(thing.points, dtype=np.float64).reshape(-1, 3)
        corners = np.array(thing.corners, dtype=np.int64).reshape(-1, 3)
        check_indices(corners, len(points))
        if matrix is not None:
            points = points @ matrix[:3, :3] + matrix[3, :3]
            if np.linalg.det(matrix[:3, :3]) < 0:
                corners = corners[:, ::-1]
        roles = self._triangle_roles(reference.key) if role == _SOLID else np.full(len(corners), role)
        for own in np.unique(roles).tolist():
            yield own, points, corners[roles == own]
        for part in thing.held:
            named = self.parts.get((reference.key[1], part.key[1]), given)
            # What a left-out or negative object holds is of its kind.
            yield from self._placed(part, named if role == _SOLID else role, matrix)

    def _triangle_roles(self, key: Key) -> IntArray:
        """(m,) role of each triangle of a solid object."""
        if key not in self._roles:
            roles = self._roles[key] = np.full(len(self.objects[key].corners) // 3, _SOLID)
            for first, last, own in self.ranges.get(key[1], ()) if key[0] == self.root else ():
                roles[max(first, 0) : max(last + 1, 0)] = own
        return self._roles[key]


def _plain(name: str) -> str:
    """A name of XML without the prefix of its namespace."""
    return name.rpartition(":")[2]


def _attribute(attributes: dict[str, str], name: str, default: str) -> str:
    """An attribute that may have a prefix."""
    return next((text for key, text in attributes.items() if _plain(key) == name), default)


def _role(word: str) -> int:
    """What a slicer's word for a volume means."""
    plain = word.lower().replace("_", "")
    if plain not in _VOLUME_TYPES:
        raise MeshError(f"holds a volume of type {brief(word)!r}; export the finished solid")
    return _VOLUME_TYPES[plain]


def _refuse_entities(*_: object) -> None:
    raise MeshError("its model declares XML entities, which 3MF does not allow")


def _difference(
    solids: list[tuple[FloatArray, IntArray]], negatives: list[tuple[FloatArray, IntArray]]
) -> tuple[FloatArray, IntArray]:
    """What is left of solids without the negative volumes."""
    import manifold3d

    united = []
    for pieces in (solids, negatives):
        shapes = []
        for points, corners in pieces:
            if not np.isfinite(points).all():
                raise MeshError("coordinates must be finite numbers; export it again")
            vertices, faces, _ = merge_equal(points, corners)
            shapes.append(manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64))))
        if any(shape.status() != manifold3d.Error.NoError or shape.volume() <= 0 for shape in shapes):
            raise MeshError(
                "holds a negative volume, and a part that is not closed or inside out, so it cannot be "
                "subtracted; export the finished solid"
            )
        united.append(manifold3d.Manifold.batch_boolean(shapes, manifold3d.OpType.Add))
    rest = (united[0] - united[1]).to_mesh64()
    if not len(rest.tri_verts):
        raise MeshError("its negative volumes leave nothing of it; export the finished solid")
    return np.array(rest.vert_properties[:, :3], np.float64), np.array(rest.tri_verts, np.int64)
