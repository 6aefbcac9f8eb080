"""Which reader takes a mesh file: by its content, so that a wrong extension does no harm."""

from __future__ import annotations

import codecs
import contextlib
import dataclasses
import importlib
import io
import re
import struct
import zipfile
from pathlib import Path

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.raw import MAX_FILE_BYTES, RawMesh, brief

EXTENSIONS = (".stl", ".obj", ".ply", ".off", ".glb", ".3mf")
"""Mesh formats that are read."""

ARCHIVES = (".zip", ".tar", ".gz", ".tgz", ".bz2", ".xz", ".7z", ".rar", ".zst")
"""File names that are refused as archives."""

_ARCHIVE_STARTS = (b"\x1f\x8b", b"BZh", b"\xfd7zXZ\x00", b"7z\xbc\xaf\x27\x1c", b"Rar!", b"\x28\xb5\x2f\xfd")
_OTHER_STARTS = (b"ISO-10303", b"<?xml", b"<COLLADA", b"Kaydara", b"{", b"<!DOCTYPE", b"<html")
_FORMATS = ", ".join(e[1:] for e in EXTENSIONS)
_READERS = {
    ".stl": "stl.read_stl",
    ".obj": "polygons.read_obj",
    ".ply": "ply.read_ply",
    ".off": "polygons.read_off",
    ".glb": "glb.read_glb",
    ".3mf": "threemf.read_threemf",
}
"""Imported one at a time: the command line need not load readers that it does not use."""


def file_bytes(path: Path) -> bytes:
    """The content of a mesh file.

    Args:
        path: an stl, obj, ply, off, glb or 3mf file.

    Raises:
        MeshError: no such file, empty, too large, or its name is that of an archive or another format.
    """
    extension = path.suffix.lower()
    if "://" in str(path) or str(path).startswith(("http:/", "https:/", "ftp:/")):
        raise MeshError(f"{path}: is a URL; download the mesh and give the file")
    if extension in ARCHIVES:
        raise MeshError(f"{path}: is an archive; unpack it and give the mesh file ({_FORMATS})")
    if extension not in EXTENSIONS:
        raise MeshError(f"{path}: {extension or 'no'} extension, mesh files end in one of {_FORMATS}")
    try:
        if not path.exists():
            raise MeshError(f"{path}: no such file")
        if not path.is_file():
            raise MeshError(f"{path}: is not a file, give a mesh file ({_FORMATS})")
        size = path.stat().st_size
        if size == 0:
            raise MeshError(f"{path}: the file is empty")
        if size > MAX_FILE_BYTES:
            limit = MAX_FILE_BYTES >> 20
            raise MeshError(f"{path}: {size >> 20} MiB, the limit is {limit} MiB; decimate the mesh")
        return _plain_text(path.read_bytes())
    except OSError as problem:
        raise MeshError(f"{path}: cannot be read ({problem.strerror})") from None


def _plain_text(data: bytes) -> bytes:
    """Without the mark of UTF-8 that text editors write, and text in UTF-16 as ASCII."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        with contextlib.suppress(UnicodeError):  # else it is binary, or text in another encoding
            return data.decode("utf-16").encode("ascii")
    return data.removeprefix(codecs.BOM_UTF8)


def parsed_mesh(path: Path, data: bytes) -> RawMesh:
    """Read a mesh file as it is, nothing mended.

    Args:
        path: named in messages, and what its name says of the format.
        data: from :func:`file_bytes`.

    Returns:
        Its content, in the file's unit. A note says where content and extension do not agree.

    Raises:
        MeshError: an archive, another format, or damaged.
    """
    extension = path.suffix.lower()
    kind = _kind(path, data) or extension
    module, _, name = _READERS[kind].partition(".")
    reader = getattr(importlib.import_module(f"packenv.geometry.readers.{module}"), name)
    try:
        # Numbers that are none, or overflow in a transform, are found when the points are checked.
        with np.errstate(all="ignore"):
            raw: RawMesh = reader(data)
    except MeshError as problem:
        raise MeshError(f"{path}: {problem}") from None
    except Exception as problem:
        said = brief(f"{type(problem).__name__}: {problem}")
        raise MeshError(
            f"{path}: truncated or damaged {kind[1:].upper()} ({said}); export it again"
        ) from None
    if kind == extension:
        return raw
    note = f"the content is {kind[1:].upper()} although the name ends in {extension}"
    return dataclasses.replace(raw, notes=(*raw.notes, note))


def _kind(path: Path, data: bytes) -> str | None:
    """The format that the content shows, as an extension, or None where it shows none.

    Raises:
        MeshError: the content is an archive, or a format that is not read.
    """
    start = data[:512].lstrip()
    if data.startswith(b"glTF"):
        return ".glb"
    if data.startswith((b"ply\n", b"ply\r")):
        return ".ply"
    archive = data.startswith(_ARCHIVE_STARTS) or data[257:262] == b"ustar"
    if data.startswith(b"PK\x03\x04"):
        if _is_threemf(data):
            return ".3mf"
        archive = path.suffix.lower() != ".3mf"
    if archive:
        raise MeshError(f"{path}: is an archive; unpack it and give the mesh file ({_FORMATS})")
    if start.startswith(_OTHER_STARTS):
        raise MeshError(f"{path}: its content is none of {_FORMATS}; export the item as one of these")
    if re.match(rb"(?:ST)?C?N?OFF\s", start, re.IGNORECASE):
        return ".off"
    if len(data) > 84 and len(data) == 84 + 50 * struct.unpack_from("<I", data, 80)[0]:
        return ".stl"
    if start[:5].lower() == b"solid" and b"facet" in data[:4096].lower():
        return ".stl"
    if start.startswith((b"v ", b"mtllib ")) or (b"\nv " in data and b"\nf " in data and start[:1] == b"#"):
        return ".obj"
    return None


def _is_threemf(data: bytes) -> bool:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return "3d/3dmodel.model" in (name.lower().lstrip("/") for name in archive.namelist())
    except (zipfile.BadZipFile, NotImplementedError, ValueError):
        return False
