"""What planning and physics need of items, by name: loaded when it is first asked for, and kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Generic, Literal, TypeAlias, TypeVar

from packenv.config import GridConfig
from packenv.geometry.convex_parts import ConvexParts, convex_parts, envelope
from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.prepare import PreparedItem, prepare_item
from packenv.io.catalogues import Catalogue
from packenv.io.item_cache import ItemCache
from packenv.io.parts_files import exact_parts
from packenv.planning.assembly import Shelf
from packenv.types import Item

if TYPE_CHECKING:
    from packenv.sim.physics_items import PhysicsItem

T = TypeVar("T")

Geometry: TypeAlias = Literal["mesh", "parts"]
"""What is planned with: an item's mesh, or its envelope: mesh and convex parts together."""

FIELD_MEMORY = 32 * 2**20
"""Bytes of surface fields that a shelf keeps; one takes 2 to 8 MB, and reading it a few milliseconds."""
MAP_MEMORY = 96 * 2**20
"""Bytes of heightmaps at stable poses that a shelf keeps; an item's take 0.1 to 8 MB."""


class _Lazy(Mapping[str, T], Generic[T]):
    """A mapping whose values are made when they are first asked for."""

    def __init__(self, make: Callable[[str], T], names: Callable[[], Iterable[str]]) -> None:
        self._make, self._names = make, names

    def __getitem__(self, name: str) -> T:
        return self._make(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names())

    def __len__(self) -> int:
        return len(list(self._names()))


class _Recent(Generic[T]):
    """Values that were used last, up to a number of bytes; at least one is kept."""

    def __init__(self, budget: int, size: Callable[[T], int]) -> None:
        self._budget, self._size = budget, size
        self._kept: OrderedDict[str, tuple[T, int]] = OrderedDict()
        self._bytes = 0

    def get(self, name: str, make: Callable[[], T]) -> T:
        """The value of a name, made where it is not kept."""
        if name in self._kept:
            self._kept.move_to_end(name)
            return self._kept[name][0]
        value = make()
        self._kept[name] = value, self._size(value)
        self._bytes += self._kept[name][1]
        while len(self._kept) > 1 and self._bytes > self._budget:
            self._bytes -= self._kept.popitem(last=False)[1][1]
        return value

    def drop(self, name: str) -> None:
        """Forget a name."""
        if name in self._kept:
            self._bytes -= self._kept.pop(name)[1]


class ItemShelf:
    """The items of a catalogue, and for a while those that an order brings along.

    What belongs to the catalogue also goes through the user's cache; what an order brings along does not,
    for it seldom comes twice.
    """

    def __init__(
        self,
        catalogue: Catalogue,
        grid: GridConfig,
        geometry: Geometry = "mesh",
        *,
        cache: ItemCache | None = None,
        field_memory: int = FIELD_MEMORY,
        map_memory: int = MAP_MEMORY,
    ) -> None:
        """Load nothing yet.

        Args:
            catalogue: where the items are from.
            grid: the discretization that they are prepared for.
            geometry: what they are planned with.
            cache: the user's, where None.
            field_memory: bytes of surface fields that are kept.
            map_memory: bytes of heightmaps that are kept.
        """
        self.catalogue = catalogue
        self.grid = grid
        self.geometry = geometry
        self._cache = cache or ItemCache()
        self._brought: Mapping[str, Item] = {}
        self._parts: dict[str, ConvexParts] = {}
        self._shapes: dict[str, Item] = {}
        self._prepared = _Recent(map_memory, _map_bytes)
        self._physics: dict[str, PhysicsItem] = {}
        self._fields = _Recent(field_memory, _field_bytes)
        self.shapes: Mapping[str, Item] = _Lazy(self.shape, lambda: self.catalogue.names)
        self.fields: Mapping[str, SurfaceField] = _Lazy(self.field, lambda: self.catalogue.names)
        self.prepared_items: Mapping[str, PreparedItem] = _Lazy(self.prepared, lambda: self.catalogue.names)

    def bring(self, items: Mapping[str, Item]) -> None:
        """Take items that are of no catalogue, in place of those that were brought before.

        One of the name of an item of the catalogue hides that one.
        """
        for name in {*self._brought, *items}:
            for kept in (self._parts, self._shapes, self._physics):
                kept.pop(name, None)
            self._prepared.drop(name)
            self._fields.drop(name)
        self._brought = dict(items)

    def __contains__(self, name: object) -> bool:
        return name in self._brought or name in self.catalogue

    def item(self, name: str) -> Item:
        """The item as its mesh.

        Raises:
            CatalogueError: there is no such item.
            MeshError: its mesh cannot be used.
        """
        return self._brought[name] if name in self._brought else self.catalogue.item(name)

    def parts(self, name: str) -> ConvexParts:
        """Its convex parts: exact ones where the catalogue has them."""

        def make() -> ConvexParts:
            if name in self._brought:
                return convex_parts(self.item(name))
            return exact_parts(self.catalogue, name) or self._cache.parts(self.item(name))

        return _kept(self._parts, name, make)

    def shape(self, name: str) -> Item:
        """The item as it is planned with: its mesh, or its envelope.

        Raises:
            MeshError: mesh and parts cannot be united.
        """
        if self.geometry == "mesh":
            return self.item(name)
        unite = envelope if name in self._brought else self._cache.envelope
        return _kept(self._shapes, name, lambda: unite(self.item(name), self.parts(name)))

    def prepared(self, name: str) -> PreparedItem:
        """Its stable poses and heightmaps, of the shape that is planned with."""

        def make() -> PreparedItem:
            prepare = prepare_item if name in self._brought else self._cache.prepare
            return prepare(self.shape(name), self.grid)

        return self._prepared.get(name, make)

    def field(self, name: str) -> SurfaceField:
        """The surface of the shape that is planned with."""

        def make() -> SurfaceField:
            shape = self.shape(name)
            return SurfaceField.of_item(shape) if name in self._brought else self._cache.surface_field(shape)

        return self._fields.get(name, make)

    def physics(self, name: str) -> PhysicsItem:
        """The item as a rigid body of its convex parts, or a ball."""
        from packenv.sim.physics_items import PhysicsItem

        return _kept(self._physics, name, lambda: PhysicsItem.of_item(self.item(name), self.parts(name)))

    def planning(self, names: Iterable[str]) -> Shelf:
        """What planning needs of some items; their surfaces only when they are asked for."""
        wanted = dict.fromkeys(names)
        return Shelf(
            {name: self.shape(name) for name in wanted},
            {name: self.prepared(name) for name in wanted},
            self.fields,
        )


def _kept(store: dict[str, T], name: str, make: Callable[[], T]) -> T:
    if name not in store:
        store[name] = make()
    return store[name]


def _field_bytes(field: SurfaceField) -> int:
    return sum(array.nbytes for array in field.to_arrays().values())


def _map_bytes(prepared: PreparedItem) -> int:
    return sum(o.top.nbytes + o.bottom.nbytes for o in prepared.orientations)
