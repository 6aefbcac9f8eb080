"""Damaged tables of items and of boxes, and damaged orders: what is read keeps the rules, or one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from packenv.io.containers import read_boxes
from packenv.io.orders import MAX_PIECES, read_order
from packenv.items.catalogue import open_catalogue
from tests.conftest import REPO
from tests.fuzz.mutations import damaged
from tests.fuzz.runner import MakeOne, Reads, check, fuzz

ASSETS = REPO / "assets"
ITEMS = "name;file;mass_kg;unit;_shelf\nmug;a/mug.stl;0,25;mm;4\nplate;plate.ply;;cm;\n\nKrüg;k.3mf;1e-1;;x\n"
BOXES = (
    "box_id\tlength_m\twidth_m\theight_m\tmax_kg\tnotes\nS\t0.2\t0.15\t0.1\t5\tsmall\nL\t0.6\t0.4\t0.4\t\t\n"
)
LIMITED = (
    "name,file,friction,com_x_m,com_y_m,com_z_m,this_side_up,max_tilt_deg,max_load_kg,fragile,no_stack,keep_apart\n"
    "mug,mug.ply,0.4,0,0,0.05,yes,,2.5,no,,food\nplate,plate.ply,,,,,-x,12,,1,true,soap\n"
)
ORDER = 'item,qty\nmug,2\n"bowl",1\nbanana,3\n'
LIMITED_ORDER = "item,qty,upright,max_load_kg,fragile\nmug,2,yes,1.5,\nbowl,1,,,yes\nmug,1,x,,no\n"
SHORT = '["mug", {"item": "bowl", "qty": 2, "fragile": true, "upright": "-x", "max_load_kg": 3}, "banana"]'


def one_table(folder: Path) -> MakeOne:
    """How a damaged table or order is made, and read."""
    names = open_catalogue(None).names
    shelf = folder / "shelf"
    shelf.mkdir()
    orders = sorted((ASSETS / "orders").iterdir())
    table = (ASSETS / "catalogue" / "objects.csv").read_bytes()
    sound: list[tuple[str, bytes, Callable[[Path], None]]] = [
        ("objects.csv", table, _items),
        ("objects.csv", ITEMS.encode(), _items),
        ("objects.csv", LIMITED.encode(), _items),
        ("boxes.csv", (ASSETS / "boxes.csv").read_bytes(), _boxes),
        ("boxes.csv", BOXES.encode("utf-16"), _boxes),
        ("order.csv", ORDER.encode("utf-8-sig"), lambda path: _order(path, names)),
        ("order.csv", LIMITED_ORDER.encode(), lambda path: _order(path, names)),
        ("order.json", SHORT.encode(), lambda path: _order(path, names)),
    ]
    sound += [(f"order{p.suffix}", p.read_bytes(), lambda path: _order(path, names)) for p in orders]
    for name, data, read in sound:
        (shelf / name).write_bytes(data)
        read(shelf / name)

    def one(rng: Random) -> tuple[str, Reads]:
        name, data, read = rng.choice(sound)
        path = shelf / name
        path.write_bytes(damaged(path.suffix, data, rng))
        return name, lambda: read(path)

    return one


def _items(path: Path) -> None:
    catalogue = open_catalogue(path.parent)
    assert len(catalogue)
    for entry in catalogue.entries.values():
        assert ".." not in Path(entry.file).parts
        assert not Path(entry.file).is_absolute()
        assert entry.mass is None or 0 < entry.mass < float("inf")
        assert entry.limits.bears >= 0


def _boxes(path: Path) -> None:
    boxes = read_boxes(path)
    assert boxes
    assert all(0 < side < 100 for box in boxes for side in box.size)


def _order(path: Path, names: tuple[str, ...]) -> None:
    order = read_order(path, names)
    assert set(order.names) <= set(names)
    assert 0 < len(order.names) <= MAX_PIECES


@pytest.mark.parametrize("count", [200, pytest.param(4000, marks=pytest.mark.slow)])
def test_a_damaged_table_keeps_the_rules_or_is_one_line(count: int) -> None:
    check(fuzz(one_table, count, count), count, least_read=0.1)
