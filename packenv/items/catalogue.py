"""Catalogues: a folder of item meshes with ``objects.csv``, or of bare meshes."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath, PureWindowsPath

from packenv.errors import CatalogueError, closest_item, is_number
from packenv.geometry.mesh_files import ARCHIVES, EXTENSIONS
from packenv.geometry.meshes import HEAVIEST, UNITS, check_unit, make_item
from packenv.io.limit_cells import ALIASES, LIMIT_COLUMNS, limits_of
from packenv.io.tables import Columns, Row, read_table, read_text
from packenv.items.mesh_cache import kept_mesh
from packenv.items.recent import Recent
from packenv.limits import NO_LIMITS, ItemLimits
from packenv.shipped import BUILTIN, MEMORY, assets_dir
from packenv.types import Item, normal_name

TABLE = "objects.csv"
"""Name of a catalogue's table."""

COM = ("com_x_m", "com_y_m", "com_z_m")
"""Columns of the centre of mass, mesh frame: all three or none."""

COLUMNS = Columns(
    required=("name", "file"),
    optional=("mass_kg", "unit", "parts_file", *COM, "friction", *LIMIT_COLUMNS),
    remarks=(
        *("set", "category", "source", "licence", "notes", "repair", "n_vertices", "n_faces", "n_bodies"),
        *("extents_x", "extents_y", "extents_z", "volume_m3", "hull_volume_m3", "convexity"),
    ),
    aliases=ALIASES,
)
"""Columns of a catalogue's table."""

PARTS = ".parts.obj"
"""``<stem>.parts.obj`` beside a mesh ``<stem>.<format>`` holds the convex parts that the mesh is made of."""


@dataclass(frozen=True)
class CatalogueEntry:
    """One item of a catalogue before its mesh is loaded.

    Attributes:
        file: the mesh file, relative to the folder, with ``/``.
        mass: kg, or None where the table has none.
        unit: unit of the mesh, or None.
        parts_file: file of the convex parts that the mesh is made of, relative to the folder and in the
            mesh's unit, or None.
        limits: what may not be done with the item.
        com: centre of mass, mesh frame, m, or None.
        friction: coefficient of its surface, or None.
    """

    file: str
    mass: float | None = None
    unit: str | None = None
    parts_file: str | None = None
    limits: ItemLimits = NO_LIMITS
    com: tuple[float, float, float] | None = None
    friction: float | None = None


class Catalogue:
    """The items of a folder by name; a mesh is loaded when its item is first asked for."""

    def __init__(
        self,
        label: str,
        folder: Path,
        entries: dict[str, CatalogueEntry],
        density: float | None = None,
        item_memory: int | None = None,
    ) -> None:
        """Make a catalogue; users call :func:`open_catalogue`.

        Args:
            label: ``builtin``, or the folder as the user gave it.
            folder: where the files are.
            entries: by item name.
            density: of the items whose entry has no mass, kg/m³; None estimates their masses.
            item_memory: bytes of the meshes that are kept; None keeps all that were loaded.
        """
        self.density, self.item_memory = density, item_memory
        self.label = label
        self.folder = folder
        self.entries = {normal_name(name): entry for name, entry in entries.items()}
        self.shelves: dict[object, object] = {}
        self._items: dict[str, Item] = {}
        self._recent = None if item_memory is None else Recent(item_memory, _mesh_bytes)

    def __getstate__(self) -> dict[str, object]:
        """Copied to another process it keeps its items, and its shelves load anew."""
        return {**self.__dict__, "shelves": {}}

    @classmethod
    def of_items(cls, items: Mapping[str, Item]) -> Catalogue:
        """A catalogue of items that are in no folder."""
        made = cls(
            MEMORY, Path(), {name: CatalogueEntry(item.file, item.mass) for name, item in items.items()}
        )
        made._items.update(items)
        return made

    def with_limits(self, limits: Mapping[str, ItemLimits]) -> Catalogue:
        """The catalogue with further limits on some of its items, by name; itself where there are none."""
        limited = {normal_name(name): given for name, given in limits.items() if given != NO_LIMITS}
        if not limited:
            return self
        made = Catalogue(self.label, self.folder, self.entries, self.density, self.item_memory)
        made._items.update({name: item for name, item in self._items.items() if name not in limited})
        for name, given in limited.items():
            item = self.item(name)
            made._items[name] = replace(item, limits=item.limits.joined(given))
        return made

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all items, in the table's sequence."""
        return tuple(self.entries)

    @property
    def limited(self) -> bool:
        """Whether an item has limits."""
        named = (entry.limits for entry in self.entries.values())
        loaded = (item.limits for item in self._items.values())
        return any(limits != NO_LIMITS for limits in (*named, *loaded))

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file that there is to read: the table, meshes and convex parts; none of meshes in memory."""
        if self.label == MEMORY:
            return ()
        named = [TABLE, *(f for e in self.entries.values() for f in (e.file, e.parts_file) if f)]
        return tuple(self.folder / file for file in named)

    def item(self, name: str) -> Item:
        """Load an item, or hand out the one that was loaded before and is kept.

        Raises:
            CatalogueError: the catalogue has no such item.
            MeshError: its mesh cannot be used.
        """
        name = normal_name(name)
        if name in self._items:
            return self._items[name]
        if self._recent is not None:
            return self._recent.get(name, lambda: self._loaded(name))
        self._items[name] = self._loaded(name)
        return self._items[name]

    def _loaded(self, name: str) -> Item:
        entry = self._entry(name)
        mesh = kept_mesh(self.folder / entry.file, entry.unit)
        mass = entry.mass
        if mass is None and self.density is not None:
            mass = self.density * mesh.solid.volume
        return make_item(
            name,
            mesh,
            file=entry.file,
            mass=mass,
            limits=entry.limits,
            com=entry.com,
            friction=entry.friction,
        )

    def parts_file(self, name: str) -> Path | None:
        """File of the convex parts that an item is made of: the table's, else one beside the mesh, else None.

        Raises:
            CatalogueError: the catalogue has no such item.
        """
        parts = self._entry(name).parts_file
        return self.folder / parts if parts else None

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and normal_name(name) in self.entries

    def __iter__(self) -> Iterator[str]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    def _entry(self, name: str) -> CatalogueEntry:
        if name not in self:
            raise CatalogueError(
                f"catalogue {self.label} has no item {name!r}{closest_item(name, self.entries)}"
            )
        return self.entries[normal_name(name)]


def _mesh_bytes(item: Item) -> int:
    return item.vertices.nbytes + item.faces.nbytes


def open_catalogue(
    folder: Path | str | None,
    *,
    unit: str | None = None,
    density: float | None = None,
    item_memory: int | None = None,
) -> Catalogue:
    """Open a catalogue: its table is read and checked now, its meshes later.

    ``objects.csv`` has the columns ``name`` and ``file`` (a path inside the folder), and may have
    ``mass_kg`` (empty: estimated, see :func:`packenv.geometry.mass.estimated_mass`), ``unit``,
    ``parts_file``, the centre of mass, ``friction`` and limits; :data:`COLUMNS` has all of them. In a folder
    without one, every mesh file is an item of its stem's name. In both, ``<stem>.parts.obj`` beside a mesh is
    taken for its ``parts_file``.

    Args:
        folder: the folder; None or ``builtin`` is the catalogue that RobotPack brings along.
        unit: unit of every mesh whose row names none: ``m``, ``cm``, ``mm`` or ``in``.
        density: of the items without a mass, kg/m³; None estimates their masses.
        item_memory: bytes of the meshes that are kept, the others being read again; None keeps all.

    Returns:
        The catalogue.

    Raises:
        CatalogueError: no such folder, no meshes in it, something wrong in its table, or no such density.
        UnitError: an unknown unit.
    """
    check_unit(unit)
    if density is not None and not (is_number(density) and 1.0 <= density <= HEAVIEST):
        raise CatalogueError(
            f"density is {density!r:.60}, give kg/m³ from 1 to {HEAVIEST:,.0f}: water has 1000"
        )
    label = BUILTIN if folder is None else str(folder)
    if label == MEMORY:
        raise CatalogueError(
            f"{label}: its meshes were in a script's memory, in no folder; give their folder"
        )
    path = assets_dir() / "catalogue" if label == BUILTIN else Path(label)
    if "://" in label:
        raise CatalogueError(f"{label}: is a URL; download the catalogue and give its folder")
    if not path.exists():
        raise CatalogueError(f"{label}: no such folder, give a folder of meshes or {BUILTIN!r}")
    if not path.is_dir():
        what = "an archive; unpack it and" if path.suffix.lower() in ARCHIVES else "a file;"
        raise CatalogueError(f"{label}: is {what} give the folder that holds the meshes")
    table = path / TABLE
    try:
        entries = _table_entries(table, unit) if table.exists() else _bare_entries(path, unit)
    except OSError as problem:
        raise CatalogueError(f"{label}: cannot be read ({problem.strerror})") from None
    return Catalogue(label, path, entries, density, item_memory)


def _table_entries(table: Path, unit: str | None) -> dict[str, CatalogueEntry]:
    rows = read_table(table, read_text(table, CatalogueError, "a table of items"), COLUMNS, CatalogueError)
    entries: dict[str, CatalogueEntry] = {}
    lines: dict[str, str] = {}
    for row in rows:
        name = row.name("name")
        if not name.isprintable() or len(name) > 200:
            raise CatalogueError(f"{row.where}: name {name[:40]!r} must be printable, at most 200 characters")
        folder = table.parent
        entry = CatalogueEntry(
            _file(row, "file", folder),
            row.positive("mass_kg", "kilograms") if row.cells.get("mass_kg") else None,
            _unit(row) or unit,
            _parts_file(row, folder),
            limits_of(row),
            _com(row),
            row.positive("friction", "a coefficient") if row.cells.get("friction") else None,
        )
        if name in entries:
            raise CatalogueError(
                f"{row.where}: item {name!r} is there twice, with {entries[name].file} ({lines[name]}) "
                f"and {entry.file}; give each item a name of its own"
            )
        entries[name] = entry
        lines[name] = row.where.rpartition(", ")[2]
    if not entries:
        raise CatalogueError(f"{table}: lists no items, add a row for each")
    return entries


def _file(row: Row, column: str, folder: Path) -> str:
    """A path inside the folder: the table may come from anywhere, so it may not reach out."""
    text = row.text(column)
    where = f"{row.where}: {column} {text!r}"
    if "://" in text:
        raise CatalogueError(f"{where} is a URL; put the file into the catalogue folder")
    if PurePosixPath(text).is_absolute() or PureWindowsPath(text).drive or "\\" in text:
        raise CatalogueError(f"{where} must be a path inside the catalogue folder, with '/'")
    if ".." in PurePosixPath(text).parts or not text.isprintable():
        raise CatalogueError(f"{where} leaves the catalogue folder; name a file inside it")
    suffix = PurePosixPath(text).suffix.lower()
    if suffix in ARCHIVES:
        raise CatalogueError(f"{where} is an archive; unpack it and name the mesh file")
    if suffix not in EXTENSIONS:
        kinds = ", ".join(e[1:] for e in EXTENSIONS)
        raise CatalogueError(f"{where} is no mesh file; its name must end in one of {kinds}")
    # The file system may have the name in another normal form of Unicode than the table.
    forms = [text, *(unicodedata.normalize(form, text) for form in ("NFC", "NFD"))]
    return str(PurePosixPath(next((form for form in forms if (folder / form).is_file()), text)))


def _com(row: Row) -> tuple[float, float, float] | None:
    if not any(row.cells.get(column) for column in COM):
        return None
    x, y, z = (row.number(column) for column in COM)
    return x, y, z


def _unit(row: Row) -> str | None:
    unit = row.cells.get("unit") or None
    if unit is not None and unit not in UNITS:
        raise CatalogueError(f"{row.where}: unit {unit!r} is not known, give one of {', '.join(UNITS)}")
    return unit


def _parts_file(row: Row, folder: Path) -> str | None:
    if row.cells.get("parts_file"):
        return _file(row, "parts_file", folder)
    return _parts_beside(folder, _file(row, "file", folder))


def _parts_beside(folder: Path, mesh: str) -> str | None:
    parts = str(PurePosixPath(mesh).with_suffix(PARTS))
    return parts if (folder / parts).is_file() else None


def _bare_entries(folder: Path, unit: str | None) -> dict[str, CatalogueEntry]:
    entries: dict[str, CatalogueEntry] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in EXTENSIONS or path.name.startswith(".") or not path.is_file():
            continue
        if path.name.endswith(PARTS):
            continue
        name = normal_name(path.stem)
        if name in entries:
            raise CatalogueError(
                f"{folder}: {entries[name].file} and {path.name} are both named {name!r}; "
                "rename one, or add an objects.csv"
            )
        entries[name] = CatalogueEntry(path.name, unit=unit, parts_file=_parts_beside(folder, path.name))
    if not entries:
        kinds = ", ".join(e[1:] for e in EXTENSIONS)
        raise CatalogueError(f"{folder}: holds neither {TABLE} nor a mesh file ({kinds})")
    return entries
