"""Generators of orders from a JSON-able spec."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

from packenv.env.orders.cuts import CUTS
from packenv.env.orders.from_names import ListedOrder, RandomOrders, ReplayedOrders, is_test_item
from packenv.env.orders.records import GeneratedOrder, OrderGenerator
from packenv.env.orders.toys import DEFAULT_CONTAINER, MOST_PIECES, ToyOrders
from packenv.errors import InputError, OrderError, closest_item
from packenv.io.orders import MAX_PIECES, read_order
from packenv.items.catalogue import Catalogue
from packenv.json_table import Table
from packenv.types import Container

Names: TypeAlias = Catalogue | Collection[str]

DEFAULT_SPEC: Mapping[str, object] = MappingProxyType({"kind": "random", "items": 10})
"""What an environment takes where the user gives none."""

SPLITS = ("all", "train", "test")


def from_spec(spec: Mapping[str, object], catalogue: Names) -> OrderGenerator:
    """Make a generator of orders from a JSON-able spec. Every key but ``kind`` has a default.

    ``{"kind": "random"}`` draws items of the catalogue:

    - ``items`` (10): how many, a number or [least, most];
    - ``repeats`` (true): an item may come more than once;
    - ``split`` (``all``): ``all``, ``train`` or ``test``; ``test_share`` (0.2): of the names, 0 to 1;
    - ``box_volume``: [least, most] of the bounding box along the mesh's own axes, m³;
    - ``longest_side``: [least, most] of the same box, m.

    ``{"kind": "list", "items": [...]}`` gives these items every time.

    ``{"kind": "file", "path": ...}`` replays order files (CSV or JSON), the limits that they set included:

    - ``path``: a file, a folder (its .csv and .json files by name), or a list of both;
    - ``shuffle`` (false): draw one of them instead of taking turns.

    ``{"kind": "toy"}`` cuts a box into pieces, see :class:`packenv.env.orders.ToyOrders`:

    - ``pieces`` ([4, 8]): a number or [least, most];
    - ``container`` ([0.32, 0.32, 0.30]): [length, width, height], m;
    - ``cut`` (``slices``): ``slices`` or ``guillotine``;
    - ``step`` (0.01): of the grid of cuts, m; ``shortest`` (0.03): side that a piece may have, m;
    - ``shuffle`` (false): hand the pieces out in a drawn sequence.

    Args:
        spec: as above.
        catalogue: the catalogue, or its names where no size is asked for.

    Raises:
        InputError: an unknown kind, key or item, a wrong value, or nothing left to draw from; one line.
    """
    if not isinstance(spec, Mapping):
        raise InputError(f'order generator: is {spec!r:.60}, give a mapping such as {{"kind": "random"}}')
    kind = spec.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InputError(f"order generator: kind is {kind!r:.60}, give one of {', '.join(_KINDS)}")
    make, defaults = _KINDS[kind]
    given = {key: value for key, value in spec.items() if key != "kind"}
    return make(Table({**defaults, **given}, f"order generator {kind!r}", "", " ".join(defaults)), catalogue)


def _counts(table: Table, key: str, most: int) -> tuple[int, int]:
    """A number of things, or the least and the most of them."""
    value = table.value(key)
    entries = list(value) if isinstance(value, list | tuple) else [value, value]
    pair = [n for n in entries if isinstance(n, int) and not isinstance(n, bool)]
    if len(entries) != 2 or len(pair) != 2 or not 1 <= pair[0] <= pair[1] <= most:
        raise table.wrong(key, f"a whole number from 1 to {most}, or [least, most]")
    return pair[0], pair[1]


def _range(table: Table, key: str) -> tuple[float, float]:
    """The least and the most of a length or a volume."""
    least, most = table.numbers(key, 2, 0.0, above=True)
    if least > most:
        raise table.wrong(key, "[least, most], the smaller first")
    return least, most


def _texts(table: Table, key: str, right: str) -> list[str]:
    """One text or more."""
    value = table.value(key)
    if not isinstance(value, list | tuple) or not value or not all(isinstance(entry, str) for entry in value):
        raise table.wrong(key, right)
    return list(value)


def _random(table: Table, catalogue: Names) -> OrderGenerator:
    split = table.choice("split", SPLITS)
    share = table.number("test_share", 0.0, 1.0)
    names = [name for name in catalogue if split == "all" or is_test_item(name, share) == (split == "test")]
    if "box_volume" in table:
        names = _within(names, _range(table, "box_volume"), _box_volumes(table, catalogue, names))
    if "longest_side" in table:
        names = _within(names, _range(table, "longest_side"), _longest_sides(table, catalogue, names))
    return RandomOrders(tuple(names), _counts(table, "items", MAX_PIECES), table.flag("repeats"))


def _within(names: Iterable[str], bounds: tuple[float, float], sizes: Mapping[str, float]) -> list[str]:
    return [name for name in names if bounds[0] <= sizes[name] <= bounds[1]]


def _box_volumes(table: Table, catalogue: Names, names: Iterable[str]) -> dict[str, float]:
    meshes = _meshes(table, "box_volume", catalogue)
    return {name: float(meshes.item(name).extents.prod()) for name in names}


def _longest_sides(table: Table, catalogue: Names, names: Iterable[str]) -> dict[str, float]:
    meshes = _meshes(table, "longest_side", catalogue)
    return {name: float(meshes.item(name).extents.max()) for name in names}


def _meshes(table: Table, key: str, catalogue: Names) -> Catalogue:
    if not isinstance(catalogue, Catalogue):
        raise InputError(f"{table.place(key)} needs a catalogue of meshes, not names alone")
    return catalogue


def _list(table: Table, catalogue: Names) -> OrderGenerator:
    items = _texts(table, "items", 'a list of item names, such as ["mug"]')
    for name in items:
        if name not in catalogue:
            hint = closest_item(name, tuple(catalogue))
            raise OrderError(f"{table.where}: no item {name!r} in the catalogue{hint}")
    if len(items) > MAX_PIECES:
        raise OrderError(f"{table.where}: {len(items):,} items, the limit is {MAX_PIECES:,}")
    return ListedOrder(tuple(items))


def _file(table: Table, catalogue: Names) -> OrderGenerator:
    value = table.value("path")
    one = isinstance(value, str) and value
    given = [value] if one else _texts(table, "path", "an order file, a folder of them, or a list of both")
    paths = [path for text in given for path in _order_files(Path(text))]
    orders = [read_order(path, tuple(catalogue)) for path in paths]
    generated = tuple(GeneratedOrder(order.names, limits=order.limits) for order in orders)
    return ReplayedOrders(generated, table.flag("shuffle"))


def _order_files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    files = sorted(p for p in path.iterdir() if p.suffix.lower() in (".csv", ".json") and p.is_file())
    if not files:
        raise OrderError(f"{path}: holds no order file, give a folder with .csv or .json files")
    return files


def _toy(table: Table, catalogue: Names) -> OrderGenerator:
    length, width, height = table.numbers("container", 3, 0.0, above=True)
    return ToyOrders(
        pieces=_counts(table, "pieces", MOST_PIECES),
        cut=table.choice("cut", tuple(CUTS)),
        step=table.number("step", 0.002, 0.1),
        shortest=table.number("shortest", 0.002, 1.0),
        shuffle=table.flag("shuffle"),
        container=Container(length, width, height),
    )


_KINDS: Mapping[str, tuple[Callable[[Table, Names], OrderGenerator], Mapping[str, object]]] = (
    MappingProxyType(
        {
            "random": (
                _random,
                {
                    "items": 10,
                    "repeats": True,
                    "split": "all",
                    "test_share": 0.2,
                    "box_volume": None,
                    "longest_side": None,
                },
            ),
            "list": (_list, {"items": None}),
            "file": (_file, {"path": None, "shuffle": False}),
            "toy": (
                _toy,
                {
                    "pieces": (4, 8),
                    "container": DEFAULT_CONTAINER.size,
                    "cut": "slices",
                    "step": 0.01,
                    "shortest": 0.03,
                    "shuffle": False,
                },
            ),
        }
    )
)
"""How each kind is made, and its keys with what they are where they are not given."""
