"""3MF: the objects that its build plate holds, components and transforms applied, in the unit it states.

trimesh leaves out what other model files hold, takes helper volumes for solid ones, runs in circles of
components, and multiplies references out before it counts.
"""

from __future__ import annotations

import dataclasses
import io
import re
import zipfile
from xml.parsers import expat

from packenv.errors import MeshError
from packenv.geometry.readers.raw import MAX_FILE_BYTES, RawMesh, brief, check_counts, read_mesh

_ROOT_MODEL = "3d/3dmodel.model"  # as it is usually named, in lower case
_METRES = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "inch": 0.0254,
    "foot": 0.3048,
    "meter": 1.0,
}
_MAX_DEPTH, _MAX_PARTS = 32, 2_000
_MAX_TAGS = 2_000_000
_NOT_SOLID = "holds negative, modifier or support volumes; export the finished solid"
_DECLARATION = re.compile(rb"^(\xef\xbb\xbf)?\s*<\?xml[^>]*\?>")
_PART_NUMBER = re.compile(rb"""\spartnumber\s*=\s*("[^"]*"|'[^']*')""")
_HELPERS = re.compile(
    rb"negative_part|modifier_part|NegativeVolume|ParameterModifier|SupportBlocker|SupportEnforcer"
)


def read_threemf(data: bytes) -> RawMesh:
    """Read a 3MF file: everything on the build plate in one mesh.

    Raises:
        MeshError: a damaged archive or model, more than the limits, or something that trimesh would not read.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        # An archive says how long its members are; a lie is caught by the length that is read.
        if sum(info.file_size for info in archive.infolist()) > MAX_FILE_BYTES:
            raise MeshError(f"unpacks to more than {MAX_FILE_BYTES >> 20} MiB; decimate the mesh")
        names = {name.lower().lstrip("/"): name for name in archive.namelist()}
        root = _ROOT_MODEL
        if root not in names and "_rels/.rels" in names:
            for relation in re.findall(rb"<Relationship\s[^>]*>", archive.read(names["_rels/.rels"])):
                target = re.search(rb'Target="/?([^"]*)"', relation)
                if target and b'/3dmodel"' in relation:
                    root = target[1].decode().lower()
        if root not in names:
            raise MeshError(f"not a 3MF file, or damaged: it holds no {brief(root)}")
        text = archive.read(names[root])
        for name in names:
            if name.endswith(".config") and _HELPERS.search(archive.read(names[name])):
                raise MeshError(_NOT_SOLID)
    if b"\0" in text:
        raise MeshError(f"{brief(root)} is not in UTF-8; export it again")
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise MeshError("its model declares XML entities, which 3MF does not allow")
    # Without its declaration a text is UTF-8 for every parser, and two items may be the same part.
    text = _PART_NUMBER.sub(b"", _DECLARATION.sub(b"", text))
    model = _Model(text)
    vertices, faces, _ = model.placed()
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("3D/3dmodel.model", text)
    raw = read_mesh("3mf", packed.getvalue(), vertices, faces, postprocess=False)
    return dataclasses.replace(raw, split=True, metres=_METRES[model.unit])


class _Model:
    """What a model announces: the size of each object, and which objects each holds."""

    def __init__(self, text: bytes) -> None:
        self.unit = "millimeter"
        # Vertices and faces by object; None is the build plate.
        self.sizes: dict[str | None, list[int]] = {None: [0, 0]}
        self.held: dict[str | None, list[str]] = {None: []}
        self.totals: dict[str | None, tuple[int, ...]] = {}
        self.here: str | None = None
        # A few hundred packed kilobytes can hold 100 million tags, each an object in memory.
        check_counts(vertices=text.count(b"<vertex "), faces=text.count(b"<triangle "))
        if text.count(b"<") > _MAX_TAGS:
            raise MeshError(f"over {_MAX_TAGS:,} XML tags in its model; decimate the mesh")
        parser = expat.ParserCreate("utf-8", " ")
        parser.StartElementHandler = self._start
        try:
            parser.Parse(text, True)
        except expat.ExpatError as problem:
            raise ValueError(str(problem)) from None
        if self.unit not in _METRES:
            raise MeshError(f"its unit is {brief(self.unit)!r}, 3MF knows {', '.join(_METRES)}")
        # trimesh walks no further than this, and leaves the rest out.
        places = {*self.held, *(held for group in self.held.values() for held in group)}
        self.most = min(_MAX_PARTS, sum(map(len, self.held.values())) * len(places))

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        match tag.rpartition(" ")[2]:
            case "vertex":
                for axis in "xyz":
                    float(attributes[axis])
                self.sizes[self.here][0] += 1
            case "triangle":
                for corner in ("v1", "v2", "v3"):
                    int(attributes[corner])
                self.sizes[self.here][1] += 1
            case "model":
                self.unit = attributes.get("unit", self.unit)
            case "object":
                self.here = attributes["id"]
                if self.here in self.sizes or not self.here.isdigit() or len(self.sizes) > _MAX_PARTS:
                    raise ValueError(f"object {brief(self.here)}: there twice, no number, or one too many")
                self.sizes[self.here], self.held[self.here] = [0, 0], []
                if attributes.get("type", "model") != "model":
                    raise MeshError(_NOT_SOLID)
            case "component" | "item" as tag:
                if any(key.endswith("path") for key in attributes):
                    raise MeshError("keeps parts in other model files; export it as one model")
                self.held[self.here if tag == "component" else None].append(attributes["objectid"])

    def placed(self, thing: str | None = None, depth: int = 0) -> tuple[int, ...]:
        """Vertices, faces and references of an object and all that it holds; None is the build plate."""
        if depth > _MAX_DEPTH:
            raise MeshError("damaged 3MF file, its components are nested in a circle or too deep")
        if thing not in self.sizes:
            raise MeshError(f"damaged 3MF file, object {brief(thing)} is placed but not there")
        if thing not in self.totals:
            rows = [(*self.sizes[thing], 1), *(self.placed(held, depth + 1) for held in self.held[thing])]
            self.totals[thing] = vertices, faces, references = tuple(map(sum, zip(*rows, strict=True)))
            check_counts(vertices=vertices, faces=faces)
            if references > self.most + 1:
                raise MeshError("its parts are placed too often, or nested; export fewer, flat")
        return self.totals[thing]
