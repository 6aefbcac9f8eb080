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
from packenv.errors import InputError, OrderError, closest_item, closest_match, is_number
from packenv.io.orders import MAX_PIECES, read_order
from packenv.items.catalogue import Catalogue
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
        raise InputError(f'order generator: is {_shown(spec)}, give a mapping such as {{"kind": "random"}}')
    kind = spec.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InputError(f"order generator: kind is {_shown(kind)}, give one of {', '.join(_KINDS)}")
    reader = _Reader(kind, {key: value for key, value in spec.items() if key != "kind"})
    return _KINDS[kind](reader, catalogue)


class _Reader:
    """The keys of one spec, each read once and checked; what is never asked for is unknown."""

    def __init__(self, kind: str, values: Mapping[str, object]) -> None:
        self.kind = kind
        self._values = dict(values)

    def known(self, *keys: str) -> None:
        for key in self._values:
            if key not in keys:
                hint = closest_match(key, keys, f"; the keys are {', '.join(keys)}")
                raise InputError(f"order generator {self.kind!r}: unknown key {_shown(key)}{hint}")

    def wrong(self, key: str, right: str) -> InputError:
        return InputError(
            f"order generator {self.kind!r}: {key} is {_shown(self._values.get(key))}, give {right}"
        )

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def value(self, key: str) -> object:
        return self._values.get(key)

    def flag(self, key: str, default: bool) -> bool:
        value = self._values.get(key, default)
        if not isinstance(value, bool):
            raise self.wrong(key, "true or false")
        return value

    def word(self, key: str, default: str, words: Collection[str]) -> str:
        value = self._values.get(key, default)
        if not isinstance(value, str) or value not in words:
            raise self.wrong(key, f"one of {', '.join(words)}")
        return value

    def number(self, key: str, default: float, least: float, most: float) -> float:
        value = _number(self._values.get(key, default))
        if value is None or not least <= value <= most:
            raise self.wrong(key, f"a number from {least:g} to {most:g}")
        return value

    def counts(self, key: str, default: tuple[int, int], most: int) -> tuple[int, int]:
        value = self._values.get(key, default)
        entries = list(value) if isinstance(value, list | tuple) else [value, value]
        pair = [n for n in entries if isinstance(n, int) and not isinstance(n, bool)]
        if len(entries) != 2 or len(pair) != 2 or not 1 <= pair[0] <= pair[1] <= most:
            raise self.wrong(key, f"a whole number from 1 to {most}, or [least, most]")
        return pair[0], pair[1]

    def range(self, key: str) -> tuple[float, float]:
        found = self.numbers(key, 2, "[least, most], two numbers above 0")
        if found[0] > found[1]:
            raise self.wrong(key, "[least, most], the smaller first")
        return found[0], found[1]

    def numbers(self, key: str, count: int, right: str) -> tuple[float, ...]:
        value = self._values.get(key)
        numbers = [_number(entry) for entry in value] if isinstance(value, list | tuple) else []
        positive = tuple(n for n in numbers if n is not None and n > 0)
        if len(numbers) != count or len(positive) != count:
            raise self.wrong(key, right)
        return positive

    def texts(self, key: str, right: str) -> tuple[str, ...]:
        value = self._values.get(key)
        entries = list(value) if isinstance(value, list | tuple) else []
        texts = tuple(entry for entry in entries if isinstance(entry, str))
        if not texts or len(texts) != len(entries):
            raise self.wrong(key, right)
        return texts


def _random(reader: _Reader, catalogue: Names) -> OrderGenerator:
    reader.known("items", "repeats", "split", "test_share", "box_volume", "longest_side")
    split = reader.word("split", "all", SPLITS)
    share = reader.number("test_share", 0.2, 0.0, 1.0)
    names = [name for name in catalogue if split == "all" or is_test_item(name, share) == (split == "test")]
    if "box_volume" in reader:
        names = _within(names, reader.range("box_volume"), _box_volumes(reader, catalogue, names))
    if "longest_side" in reader:
        names = _within(names, reader.range("longest_side"), _longest_sides(reader, catalogue, names))
    items = reader.counts("items", (10, 10), MAX_PIECES)
    return RandomOrders(tuple(names), items, reader.flag("repeats", True))


def _within(names: Iterable[str], bounds: tuple[float, float], sizes: Mapping[str, float]) -> list[str]:
    return [name for name in names if bounds[0] <= sizes[name] <= bounds[1]]


def _box_volumes(reader: _Reader, catalogue: Names, names: Iterable[str]) -> dict[str, float]:
    meshes = _meshes(reader, "box_volume", catalogue)
    return {name: float(meshes.item(name).extents.prod()) for name in names}


def _longest_sides(reader: _Reader, catalogue: Names, names: Iterable[str]) -> dict[str, float]:
    meshes = _meshes(reader, "longest_side", catalogue)
    return {name: float(meshes.item(name).extents.max()) for name in names}


def _meshes(reader: _Reader, key: str, catalogue: Names) -> Catalogue:
    if not isinstance(catalogue, Catalogue):
        raise InputError(
            f"order generator {reader.kind!r}: {key} needs a catalogue of meshes, not names alone"
        )
    return catalogue


def _list(reader: _Reader, catalogue: Names) -> OrderGenerator:
    reader.known("items")
    items = reader.texts("items", 'a list of item names, such as ["mug"]')
    for name in items:
        if name not in catalogue:
            hint = closest_item(name, tuple(catalogue))
            raise OrderError(f"order generator {reader.kind!r}: no item {name!r} in the catalogue{hint}")
    if len(items) > MAX_PIECES:
        raise OrderError(
            f"order generator {reader.kind!r}: {len(items):,} items, the limit is {MAX_PIECES:,}"
        )
    return ListedOrder(items)


def _file(reader: _Reader, catalogue: Names) -> OrderGenerator:
    reader.known("path", "shuffle")
    right = "an order file, a folder of them, or a list of both"
    value = reader.value("path")
    given = (value,) if isinstance(value, str) and value else reader.texts("path", right)
    paths = [path for text in given for path in _order_files(Path(text))]
    orders = [read_order(path, tuple(catalogue)) for path in paths]
    generated = tuple(GeneratedOrder(order.names, limits=order.limits) for order in orders)
    return ReplayedOrders(generated, reader.flag("shuffle", False))


def _order_files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    files = sorted(p for p in path.iterdir() if p.suffix.lower() in (".csv", ".json") and p.is_file())
    if not files:
        raise OrderError(f"{path}: holds no order file, give a folder with .csv or .json files")
    return files


def _toy(reader: _Reader, catalogue: Names) -> OrderGenerator:
    reader.known("pieces", "container", "cut", "step", "shortest", "shuffle")
    container = DEFAULT_CONTAINER
    if "container" in reader:
        length, width, height = reader.numbers("container", 3, "[length, width, height], m")
        container = Container(length, width, height)
    return ToyOrders(
        pieces=reader.counts("pieces", (4, 8), MOST_PIECES),
        cut=reader.word("cut", "slices", CUTS),
        step=reader.number("step", 0.01, 0.002, 0.1),
        shortest=reader.number("shortest", 0.03, 0.002, 1.0),
        shuffle=reader.flag("shuffle", False),
        container=container,
    )


_KINDS: Mapping[str, Callable[[_Reader, Names], OrderGenerator]] = MappingProxyType(
    {"random": _random, "list": _list, "file": _file, "toy": _toy}
)


def _number(value: object) -> float | None:
    """A finite number, or None for anything else."""
    return float(value) if is_number(value) else None


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
