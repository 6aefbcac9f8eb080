"""Which reader takes a mesh file: by its content, so that a wrong extension does no harm."""

from __future__ import annotations

import dataclasses
import io
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.raw import MAX_FILE_BYTES, RawMesh

EXTENSIONS = (".stl", ".obj", ".ply", ".off", ".glb", ".3mf")
"""Mesh formats that are read."""

ARCHIVES = (".zip", ".tar", ".gz", ".tgz", ".bz2", ".xz", ".7z", ".rar", ".zst")
"""File names that are refused as archives."""

_ARCHIVE_STARTS = (b"\x1f\x8b", b"BZh", b"\xfd7zXZ\x00", b"7z\xbc\xaf\x27\x1c", b"Rar!", b"\x28\xb5\x2f\xfd")
_FORMATS = ", ".join(e[1:] for e in EXTENSIONS)


def file_bytes(path: Path) -> bytes:
    """The content of a mesh file.

    Args:
        path: an stl, obj, ply, off, glb or 3mf file.

    Raises:
        MeshError: no such file, empty, too large, or its name is that of an archive or another format.
    """
    _check_name(path, path.suffix.lower())
    return _bytes(path)


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
    # Numbers that are none, or overflow in a transform, are found when the points are checked.
    with np.errstate(all="ignore"):
        raw = _reader(kind)(path, data)
    if kind == extension:
        return raw
    note = f"the content is {kind[1:].upper()} although the name ends in {extension}"
    return dataclasses.replace(raw, notes=(*raw.notes, note))


def _check_name(path: Path, extension: str) -> None:
    if "://" in str(path) or str(path).startswith(("http:/", "https:/", "ftp:/")):
        raise MeshError(f"{path}: is a URL; download the mesh and give the file")
    if extension in ARCHIVES:
        raise MeshError(f"{path}: is an archive; unpack it and give the mesh file ({_FORMATS})")
    if extension not in EXTENSIONS:
        raise MeshError(f"{path}: {extension or 'no'} extension, mesh files end in one of {_FORMATS}")


def _bytes(path: Path) -> bytes:
    try:
        if not path.exists():
            raise MeshError(f"{path}: no such file")
        if not path.is_file():
            raise MeshError(f"{path}: is not a file, give a mesh file ({_FORMATS})")
        size = path.stat().st_size
        if size == 0:
            raise MeshError(f"{path}: the file is empty")
        if size > MAX_FILE_BYTES:
            raise MeshError(
                f"{path}: {size >> 20} MiB, the limit is {MAX_FILE_BYTES >> 20} MiB; decimate the mesh"
            )
        return path.read_bytes().removeprefix(b"\xef\xbb\xbf")  # a text editor's mark of UTF-8
    except OSError as problem:
        raise MeshError(f"{path}: cannot be read ({problem.strerror})") from None


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
    if data.startswith(b"PK\x03\x04"):
        if _is_threemf(data):
            return ".3mf"
        if path.suffix.lower() != ".3mf":
            raise MeshError(f"{path}: is an archive (zip); unpack it and give the mesh file ({_FORMATS})")
    if data.startswith(_ARCHIVE_STARTS) or data[257:262] == b"ustar":
        raise MeshError(f"{path}: is an archive; unpack it and give the mesh file ({_FORMATS})")
    if start.startswith((b"ISO-10303", b"<?xml", b"<COLLADA", b"Kaydara", b"{", b"<!DOCTYPE", b"<html")):
        raise MeshError(f"{path}: its content is none of {_FORMATS}; export the item as one of these")
    word = start.split(maxsplit=1)[0].upper() if start else b""
    if word in (b"OFF", b"COFF", b"NOFF", b"CNOFF", b"STOFF"):
        return ".off"
    if len(data) > 84 and len(data) == 84 + 50 * struct.unpack_from("<I", data, 80)[0]:
        return ".stl"
    if start[:5].lower() == b"solid" and b"facet" in data[:4096].lower():
        return ".stl"
    if start.startswith((b"v ", b"mtllib ")) or (b"\nv " in data and b"\nf " in data and start[:1] == b"#"):
        return ".obj"
    return None


def _is_threemf(data: bytes) -> bool:
    from packenv.geometry.readers.threemf import ROOT_MODEL

    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return any(name.lower().lstrip("/") == ROOT_MODEL for name in archive.namelist())
    except (zipfile.BadZipFile, NotImplementedError, ValueError):
        return False


def _reader(kind: str) -> Callable[[Path, bytes], RawMesh]:
    # Imported one at a time: the command line need not load readers that it does not use.
    if kind == ".stl":
        from packenv.geometry.readers.stl import read_stl as reader
    elif kind == ".obj":
        from packenv.geometry.readers.obj import read_obj as reader
    elif kind == ".ply":
        from packenv.geometry.readers.ply import read_ply as reader
    elif kind == ".off":
        from packenv.geometry.readers.off import read_off as reader
    elif kind == ".glb":
        from packenv.geometry.readers.glb import read_glb as reader
    else:
        from packenv.geometry.readers.threemf import read_threemf as reader
    return reader
