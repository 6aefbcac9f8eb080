"""The header of a PLY file: what the data hold, held against the length of the file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from packenv.errors import MeshError
from packenv.geometry.readers.raw import check_counts

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class Property:
    """A column. ``kind`` is a NumPy type code; ``count_kind`` that of a list's length, None for a scalar."""

    name: str
    kind: str
    count_kind: str | None = None


@dataclass(frozen=True)
class Element:
    """A table: ``count`` rows of ``properties``."""

    name: str
    count: int
    properties: tuple[Property, ...]

    def index(self, path: Path, *names: str, is_list: bool) -> int:
        """Number of the first property that has one of the names.

        Raises:
            MeshError: there is none.
        """
        for k, prop in enumerate(self.properties):
            if prop.name in names and bool(prop.count_kind) == is_list:
                return k
        raise MeshError(
            f"{path}: damaged PLY header, its {self.name} element has no {names[0]!r} of the right kind"
        )

    @property
    def smallest_row(self) -> int:
        """Bytes of a row of which every list is empty."""
        return sum(np.dtype(p.count_kind or p.kind).itemsize for p in self.properties)


@dataclass(frozen=True)
class Header:
    """All tables in the file's sequence.

    ``order`` is the byte order, ``<`` or ``>``, and empty for text; ``length`` is the header's, in bytes.
    """

    order: str
    elements: tuple[Element, ...]
    length: int


def read_header(path: Path, data: bytes) -> Header:
    """Read the header.

    Raises:
        MeshError: it is not there, cannot be read, or announces more than the limits.
    """
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise MeshError(
            f"{path}: not a PLY file, or truncated: its header from 'ply' to 'end_header' is not there"
        )
    line_end = data.find(b"\n", end)
    if line_end < 0:
        raise MeshError(f"{path}: truncated, nothing follows the PLY header")
    order = None
    elements: list[tuple[str, int, list[Property]]] = []
    for line in data[:end].decode("latin-1").splitlines()[1:]:
        words = line.split()
        try:
            if not words or words[0] in ("comment", "obj_info"):
                continue
            if words[0] == "format":
                order = _ORDERS[words[1]]
            elif words[0] == "element":
                elements.append((words[1], int(words[2]), []))
            elif words[:2] == ["property", "list"]:
                elements[-1][2].append(Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[0] == "property":
                elements[-1][2].append(Property(words[2], _TYPES[words[1]]))
            else:
                raise KeyError(words[0])
        except (KeyError, IndexError, ValueError):
            raise MeshError(f"{path}: damaged PLY header, cannot read the line {line[:60]!r}") from None
    if order is None:
        raise MeshError(f"{path}: damaged PLY header, it names no format")
    count = {name: number for name, number, _ in elements}
    check_counts(path, vertices=count.get("vertex", 0), faces=count.get("face", 0))
    if "vertex" not in count or any(number < 0 for number in count.values()):
        raise MeshError(
            f"{path}: damaged PLY header, it announces no vertices or a negative number of something"
        )
    return Header(order, tuple(Element(n, c, tuple(p)) for n, c, p in elements), line_end + 1)


def check_length(path: Path, header: Header, n_bytes: int) -> None:
    """Hold the announced counts against the file before memory is asked for them.

    Raises:
        MeshError: the data are shorter than the counts need at least.
    """
    if header.order:
        least = sum(e.count * e.smallest_row for e in header.elements)
    else:
        least = sum(e.count * (2 * len(e.properties)) for e in header.elements) - 1
    if n_bytes < least:
        announced = " and ".join(f"{e.count:,} of element {e.name}" for e in header.elements)
        raise MeshError(
            f"{path}: truncated, its header announces {announced}, at least {least:,} bytes, "
            f"and {n_bytes:,} follow; export it again"
        )
