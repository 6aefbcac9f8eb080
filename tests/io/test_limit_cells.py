"""Limits as users write them in tables and orders: read in every spelling, or refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from packenv.errors import CatalogueError, InputError, OrderError
from packenv.io.orders import read_order
from packenv.items.catalogue import open_catalogue
from packenv.limits import NO_LIMITS, ItemLimits
from packenv.types import Order, OrderLine

EVERY = ItemLimits("-y", 12.5, 2.5, True, True, "food")


def catalogue(folder: Path, header: str, row: str) -> ItemLimits:
    (folder / "a.stl").touch()
    (folder / "objects.csv").write_text(f"name,file,{header}\na,a.stl,{row}\n")
    return open_catalogue(folder).entries["a"].limits


def order(folder: Path, header: str, row: str) -> ItemLimits:
    (folder / "order.csv").write_text(f"item,{header}\na,{row}\n")
    return read_order(folder / "order.csv", ["a"]).lines[0].limits


@pytest.mark.parametrize("read", [catalogue, order])
@pytest.mark.parametrize(
    ("header", "row", "limits"),
    [
        ("upright", "yes", ItemLimits(upright="z")),
        ("upright", "Y", ItemLimits(upright="z")),
        ("upright", "1", ItemLimits(upright="z")),
        ("upright", "no", NO_LIMITS),
        ("upright", "-X", ItemLimits(upright="-x")),
        ("this_side_up", "+z", ItemLimits(upright="z")),
        ("max_tilt_deg", "20", ItemLimits(upright="z", max_tilt_deg=20.0)),
        ("fragile", "TRUE", ItemLimits(fragile=True)),
        ("fragile", "0", NO_LIMITS),
        ("no_stack", "yes", ItemLimits(no_stack=True)),
        ("max_load_kg", "1", ItemLimits(max_load_kg=1.0)),
        ("max_load_kg", "0", ItemLimits(max_load_kg=0.0)),
        ("keep_apart", "Food", ItemLimits(keep_apart="Food")),
        ("fragile,max_load_kg,upright,keep_apart", ",,,", NO_LIMITS),
        ("upright,max_tilt_deg,max_load_kg,fragile,no_stack,keep_apart", "-y,12.5,2.5,yes,yes,food", EVERY),
    ],
)
def test_cells_are_read(read, header: str, row: str, limits: ItemLimits, tmp_path: Path) -> None:
    assert read(tmp_path, header, row) == limits


@pytest.mark.parametrize("read", [catalogue, order])
@pytest.mark.parametrize(
    ("header", "row", "message"),
    [
        ("upright", "up", "upright is 'up', give yes, no, or the axis: x, -x, y, -y, z, -z"),
        ("fragile", "very", "fragile is 'very', give yes or no"),
        ("fragile", "z", "fragile is 'z', give yes or no"),
        ("max_load_kg", "-1", "max_load_kg is -1.0, give kilograms of 0 or more"),
        ("max_load_kg", "yes", "max_load_kg is 'yes', which is not a number"),
        ("max_load_kg", "inf", "max_load_kg is inf, give a finite number"),
        ("max_tilt_deg", "0", "max_tilt_deg is 0.0, give degrees above 0, up to 180"),
        ("fragil", "yes", "unknown column 'fragil'; did you mean 'fragile'?"),
        ("max_load", "2", "unknown column 'max_load'; did you mean 'max_load_kg'?"),
        ("this_side_up,upright", "z,z", "column 'upright' is there twice"),
    ],
)
def test_what_is_no_limit_is_named(read, header: str, row: str, message: str, tmp_path: Path) -> None:
    with pytest.raises((CatalogueError, OrderError)) as caught:
        read(tmp_path, header, row)
    assert message in str(caught.value)
    assert "line 2" in str(caught.value) or "column" in message


def test_json_orders_take_the_same_keys(tmp_path: Path) -> None:
    path = tmp_path / "order.json"
    path.write_text(json.dumps({"items": [{"item": "a", "qty": 2, **EVERY.to_mapping()}, "a"]}))
    read = read_order(path, ["a"])
    assert read.lines == (OrderLine("a", 2, EVERY), OrderLine("a", 1))
    assert read.limits == {"a": EVERY}
    path.write_text(json.dumps([{"item": "a", "this_side_up": True}]))
    assert read_order(path, ["a"]).lines[0].limits == ItemLimits(upright="z")
    for wrong in (
        {"fragile": 1},
        {"max_load_kg": "2"},
        {"keep_apart": 3},
        {"upright": "top"},
        {"upright": ["z"]},
        {"upright": {}},
        {"frail": True},
    ):
        path.write_text(json.dumps([{"item": "a", **wrong}]))
        with pytest.raises(OrderError, match=next(iter(wrong))):
            read_order(path, ["a"])


def test_lines_of_one_item_hold_for_all_its_pieces() -> None:
    lines = (OrderLine("a", 1, ItemLimits(max_load_kg=3.0)), OrderLine("a", 4, ItemLimits(max_load_kg=2.0)))
    assert Order(lines).limits == {"a": ItemLimits(max_load_kg=2.0)}


def test_joined_limits_are_the_stricter_ones() -> None:
    loose = ItemLimits(upright="z", max_tilt_deg=30.0, max_load_kg=5.0, keep_apart="food")
    tight = ItemLimits(upright="z", max_load_kg=1.0, fragile=True)
    for both in (loose.joined(tight), tight.joined(loose)):
        assert both == ItemLimits(upright="z", max_load_kg=1.0, fragile=True, keep_apart="food")
    assert NO_LIMITS.joined(loose) == loose
    assert loose.joined(NO_LIMITS) == loose


def test_limits_survive_as_json() -> None:
    assert ItemLimits.from_mapping(json.loads(json.dumps(EVERY.to_mapping()))) == EVERY
    assert NO_LIMITS.to_mapping() == {}
    for wrong in ([], {"weight": 2}, {"fragile": "yes"}, {"max_load_kg": True}):
        with pytest.raises(InputError):
            ItemLimits.from_mapping(wrong)
