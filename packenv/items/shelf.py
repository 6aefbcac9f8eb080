"""The one loader: what planning and physics need of items, by name, loaded when it is first asked for."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Generic, TypeVar

from packenv.config import GridConfig
from packenv.errors import InputError, OrderError, closest_item
from packenv.geometry.convex_parts import ConvexParts, convex_parts, envelope
from packenv.geometry.distance_grids import SurfaceField
from packenv.geometry.prepare import PreparedItem, prepare_item
from packenv.items.cache import ItemCache
from packenv.items.catalogue import Catalogue
from packenv.items.parts_files import exact_parts
from packenv.items.recent import Recent
from packenv.limits import NO_LIMITS, ItemLimits
from packenv.planning.options import Geometry
from packenv.types import Item

if TYPE_CHECKING:
    from packenv.sim.physics_items import PhysicsItem

T = TypeVar("T")

Progress = Callable[[Collection[str], str], Iterable[str]]
"""Iterates over names, and may show how far it is; the second argument says what is done."""

FIELD_MEMORY = 32 * 2**20
"""Bytes of surface fields that a shelf keeps; one takes 2 to 8 MB, and reading it a few milliseconds."""
MAP_MEMORY = 96 * 2**20
"""Bytes of heightmaps at stable poses that a shelf keeps; an item's take 0.1 to 8 MB."""


class _Lazy(Mapping[str, T], Generic[T]):
    """A mapping whose values are made when they are first asked for."""

    def __init__(self, shelf: ItemShelf, attribute: str, make: Callable[[str], T]) -> None:
        self._shelf, self._attribute, self._make = shelf, attribute, make

    def __reduce__(self) -> tuple[Callable[..., object], tuple[ItemShelf, str]]:
        """Copied to another process it is the same attribute of the shelf's copy."""
        return getattr, (self._shelf, self._attribute)

    def __getitem__(self, name: str) -> T:
        return self._make(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._shelf._names())

    def __len__(self) -> int:
        return len(list(self._shelf._names()))


ONE_USER = 2**29
"""Bytes of surface fields, and of heightmaps, that the shelf of one user's process keeps."""


def shelf_in(catalogue: Catalogue, grid: GridConfig, geometry: Geometry) -> ItemShelf:
    """The shelf that a catalogue keeps for a discretization and a geometry: what was loaded once, stays."""
    known = catalogue.shelves.get((grid, geometry))
    if not isinstance(known, ItemShelf):
        known = ItemShelf(catalogue, grid, geometry, field_memory=ONE_USER, map_memory=ONE_USER)
        catalogue.shelves[grid, geometry] = known
    return known


class ItemShelf:
    """The items of a catalogue, and for a while those that an order brings along.

    What belongs to the catalogue also goes through the user's cache; what an order brings along does not,
    for it seldom comes twice. Every attribute below is a mapping by name that loads what it is asked for.

    Attributes:
        catalogue: where the items are from.
        grid: the discretization that they are prepared for.
        geometry: what they are planned with.
        items: the items as their meshes.
        masses: kg.
        parts: their convex parts: exact ones where the catalogue has them.
        shapes: the items as they are planned with: their meshes, or their envelopes.
        prepared: stable poses and heightmaps of the shapes.
        fields: surfaces of the shapes.
        physics: the items as rigid bodies of their convex parts, or balls.
    """

    def __init__(
        self,
        catalogue: Catalogue,
        grid: GridConfig | None = None,
        geometry: Geometry = "mesh",
        *,
        cache: ItemCache | None = None,
        field_memory: int = FIELD_MEMORY,
        map_memory: int = MAP_MEMORY,
    ) -> None:
        """Load nothing yet.

        Args:
            catalogue: where the items are from.
            grid: the discretization; the default one where None.
            geometry: what they are planned with.
            cache: the user's, where None.
            field_memory: bytes of surface fields that are kept.
            map_memory: bytes of heightmaps that are kept.
        """
        self.catalogue = catalogue
        self.grid = grid or GridConfig()
        self.geometry: Geometry = geometry
        self._cache = cache or ItemCache()
        self._memories = field_memory, map_memory
        self._brought: Mapping[str, Item] = {}
        self._freer: ItemShelf | None = None
        self._kept_parts: dict[str, ConvexParts] = {}
        self._kept_shapes: dict[str, Item] = {}
        self._kept_physics: dict[str, PhysicsItem] = {}
        self._kept_maps = Recent(map_memory, _map_bytes)
        self._kept_fields = Recent(field_memory, _field_bytes)

        self.items: Mapping[str, Item] = _Lazy(self, "items", self._item)
        self.masses: Mapping[str, float] = _Lazy(self, "masses", lambda name: self._item(name).mass)
        self.parts: Mapping[str, ConvexParts] = _Lazy(self, "parts", self._parts)
        self.shapes: Mapping[str, Item] = _Lazy(self, "shapes", self._shape)
        self.prepared: Mapping[str, PreparedItem] = _Lazy(self, "prepared", self._prepared)
        self.fields: Mapping[str, SurfaceField] = _Lazy(self, "fields", self._field)
        self.physics: Mapping[str, PhysicsItem] = _Lazy(self, "physics", self._physics)

    def __reduce__(self) -> tuple[Callable[..., ItemShelf], tuple[object, ...]]:
        """Copied to another process it loads anew what it is asked for."""
        made_of = (
            self.catalogue,
            self.grid,
            self.geometry,
            self._cache,
            self._memories,
            self._brought,
            self._freer,
        )
        return _copied, made_of

    def bring(self, items: Mapping[str, Item]) -> None:
        """Take items that are of no catalogue, in place of those that were brought before.

        One of the name of an item of the catalogue hides that one.
        """
        for name in {*self._brought, *items}:
            for kept in (self._kept_parts, self._kept_shapes, self._kept_physics):
                kept.pop(name, None)
            self._kept_maps.drop(name)
            self._kept_fields.drop(name)
        self._brought = dict(items)

    def load(
        self,
        names: Iterable[str],
        *,
        fields: bool = False,
        physics: bool = False,
        progress: Progress = lambda names, what: names,
    ) -> None:
        """Load some items now, so that a person sees how far it is.

        Args:
            names: of the items.
            fields: their surfaces, too.
            physics: their convex parts, too.
            progress: iterates over the names.

        Raises:
            InputError: a file of parts cannot be used, or meshes cannot, every one of which is named.
        """
        wanted = list(dict.fromkeys(names))
        bad: list[InputError] = []
        for name in wanted:
            try:
                self._item(name)
            except InputError as problem:
                bad.append(problem)
        if bad:
            raise type(bad[0])(" | ".join(map(str, bad)))
        if physics or self.geometry == "parts":
            for name in progress(wanted, "convex parts"):
                self._parts(name)
                self._shape(name)
        for name in progress([n for n in wanted if n not in self._kept_maps], "preparing"):
            self._prepared(name)
        if fields:
            for name in progress([n for n in wanted if n not in self._kept_fields], "surfaces"):
                self._field(name)

    def like(self, grid: GridConfig, geometry: Geometry) -> ItemShelf:
        """The shelf of the same catalogue for another discretization or geometry; this one if they are its own."""
        if grid == self.grid and geometry == self.geometry:
            return self
        fields, maps = self._memories
        return ItemShelf(
            self.catalogue, grid, geometry, cache=self._cache, field_memory=fields, map_memory=maps
        )

    def with_limits(self, limits: Mapping[str, ItemLimits]) -> ItemShelf:
        """The shelf of the same items, brought ones included, with further limits on some of them by name.

        What limits do not change is taken from here: surfaces, parts, envelopes, and maps unless another side is up.
        """
        named = {name: given for name, given in limits.items() if name not in self._brought}
        fields, maps = self._memories
        made = ItemShelf(
            self.catalogue.with_limits(named),
            self.grid,
            self.geometry,
            cache=self._cache,
            field_memory=fields,
            map_memory=maps,
        )
        made._kept_parts, made._kept_fields = self._kept_parts, self._kept_fields
        made._freer = self
        brought = self._brought.items()
        made.bring({n: replace(i, limits=i.limits.joined(limits.get(n, NO_LIMITS))) for n, i in brought})
        return made

    @property
    def limited(self) -> bool:
        """Whether an item has limits."""
        brought = any(item.limits != NO_LIMITS for item in self._brought.values())
        return brought or self.catalogue.limited

    def __contains__(self, name: object) -> bool:
        return name in self._brought or name in self.catalogue

    def check_known(self, names: Iterable[str]) -> None:
        """Refuse an order for items that there are not.

        Raises:
            OrderError: a name is neither in the catalogue nor brought along.
        """
        for name in dict.fromkeys(names):
            if name not in self:
                hint = closest_item(name, self.catalogue.names)
                raise OrderError(
                    f"the order asks for {name!r:.80}, which {self.catalogue.label} does not have{hint}"
                )

    def _names(self) -> Iterable[str]:
        return dict.fromkeys([*self.catalogue.names, *self._brought])

    def _item(self, name: str) -> Item:
        return self._brought[name] if name in self._brought else self.catalogue.item(name)

    def _parts(self, name: str) -> ConvexParts:
        def make() -> ConvexParts:
            if name in self._brought:
                return convex_parts(self._item(name))
            return exact_parts(self.catalogue, name) or self._cache.parts(self._item(name))

        return _kept(self._kept_parts, name, make)

    def _shape(self, name: str) -> Item:
        if self.geometry == "mesh":
            return self._item(name)
        if self._freer is not None:
            return replace(self._freer.shapes[name], limits=self._item(name).limits)
        unite = envelope if name in self._brought else self._cache.envelope
        return _kept(self._kept_shapes, name, lambda: unite(self._item(name), self._parts(name)))

    def _prepared(self, name: str) -> PreparedItem:
        def make() -> PreparedItem:
            limits, freer = self._item(name).limits, self._freer
            if freer is not None and limits.stance == freer.items[name].limits.stance:
                return replace(freer.prepared[name], limits=limits)
            prepare = prepare_item if name in self._brought else self._cache.prepare
            return prepare(self._shape(name), self.grid)

        return self._kept_maps.get(name, make)

    def _field(self, name: str) -> SurfaceField:
        def make() -> SurfaceField:
            shape = self._shape(name)
            return SurfaceField.of_item(shape) if name in self._brought else self._cache.surface_field(shape)

        return self._kept_fields.get(name, make)

    def _physics(self, name: str) -> PhysicsItem:
        from packenv.sim.physics_items import PhysicsItem

        return _kept(
            self._kept_physics, name, lambda: PhysicsItem.of_item(self._item(name), self._parts(name))
        )


def _copied(
    catalogue: Catalogue,
    grid: GridConfig,
    geometry: Geometry,
    cache: ItemCache,
    memories: tuple[int, int],
    brought: Mapping[str, Item],
    freer: ItemShelf | None,
) -> ItemShelf:
    fields, maps = memories
    made = ItemShelf(catalogue, grid, geometry, cache=cache, field_memory=fields, map_memory=maps)
    made._brought, made._freer = brought, freer
    return made


def _kept(store: dict[str, T], name: str, make: Callable[[], T]) -> T:
    if name not in store:
        store[name] = make()
    return store[name]


def _field_bytes(field: SurfaceField) -> int:
    return sum(array.nbytes for array in field.to_arrays().values())


def _map_bytes(prepared: PreparedItem) -> int:
    return sum(o.top.nbytes + o.bottom.nbytes for o in prepared.orientations)
