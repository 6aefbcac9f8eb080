"""A shelf hands out what the catalogue and the cache hold, loads it once, and forgets what was brought."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from packenv.config import GridConfig
from packenv.errors import CatalogueError
from packenv.geometry.prepare import PreparedItem
from packenv.items.cache import ItemCache
from packenv.items.catalogue import open_catalogue
from packenv.items.shelf import ItemShelf
from packenv.types import Item
from tests.shapes import box
from tests.shelf_samples import shelf_of

GRID = GridConfig(cell_size=0.004, grid_step=0.02, n_poses=2, n_yaws=2)


def make_shelf(tmp_path: Path, **options: object) -> ItemShelf:
    return ItemShelf(open_catalogue("builtin"), GRID, cache=ItemCache(tmp_path), **options)  # type: ignore[arg-type]


def test_everything_is_made_once(tmp_path: Path) -> None:
    shelf = make_shelf(tmp_path, geometry="parts")
    for made in (shelf.items, shelf.parts, shelf.shapes, shelf.prepared, shelf.fields, shelf.physics):
        assert made["golf_ball"] is made["golf_ball"]
        assert list(made) == list(shelf.catalogue.names)
        assert len(made) == len(shelf.catalogue)
    assert shelf.masses["golf_ball"] == shelf.items["golf_ball"].mass
    assert "golf_ball" in shelf
    assert "no such item" not in shelf
    with pytest.raises(CatalogueError):
        shelf.prepared["no such item"]


def test_the_shape_is_the_mesh_or_the_envelope(tmp_path: Path) -> None:
    mesh, parts = make_shelf(tmp_path), make_shelf(tmp_path, geometry="parts")
    assert mesh.shapes["mug"] is mesh.items["mug"]
    assert parts.shapes["mug"].sha256 == parts.prepared["mug"].sha256
    low, high = mesh.shapes["mug"].vertices.min(axis=0), mesh.shapes["mug"].vertices.max(axis=0)
    assert (parts.shapes["mug"].vertices.min(axis=0) <= low + 1e-6).all()
    assert (parts.shapes["mug"].vertices.max(axis=0) >= high - 1e-6).all()


def test_surfaces_are_given_up_when_they_are_too_many(tmp_path: Path) -> None:
    shelf = make_shelf(tmp_path, field_memory=1)
    first = shelf.fields["golf_ball"]
    assert shelf.fields["golf_ball"] is first
    other = shelf.fields["soap_bar"]
    assert shelf.fields["soap_bar"] is other
    again = shelf.fields["golf_ball"]
    assert again is not first
    np.testing.assert_array_equal(again.distance, first.distance)


def test_what_an_order_brings_hides_the_catalogue_until_the_next_order(tmp_path: Path) -> None:
    shelf = make_shelf(tmp_path, geometry="parts")
    own = shelf.prepared["golf_ball"]
    files = sorted(tmp_path.rglob("*.npz"))
    item = open_catalogue("builtin").item("soap_bar")
    shelf.bring({"golf_ball": replace(item, name="golf_ball"), "novelty": replace(item, name="novelty")})
    assert "novelty" in shelf
    assert set(shelf.items) == {*shelf.catalogue.names, "novelty"}
    assert shelf.prepared["golf_ball"].volume == pytest.approx(item.volume)
    assert shelf.physics["novelty"].mass == item.mass
    assert sorted(tmp_path.rglob("*.npz")) == files  # nothing of it in the cache
    shelf.bring({})
    assert "novelty" not in shelf
    assert shelf.prepared["golf_ball"].volume == own.volume


def test_loading_takes_the_named_items_alone_and_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    really = ItemCache.prepare

    def prepare(cache: ItemCache, item: Item, grid: GridConfig) -> PreparedItem:
        made.append(item.name)
        return really(cache, item, grid)

    monkeypatch.setattr(ItemCache, "prepare", prepare)
    shelf = make_shelf(tmp_path)
    told: list[tuple[list[str], str]] = []

    def progress(names: Collection[str], what: str) -> Iterable[str]:
        told.append((list(names), what))
        return names

    shelf.load(["golf_ball", "soap_bar", "golf_ball"], fields=True, progress=progress)
    named = ["golf_ball", "soap_bar"]
    assert made == named
    assert told == [(named, "preparing"), (named, "surfaces")]
    shelf.load(["soap_bar", "tuna_can"], fields=True, progress=progress)
    assert made == [*named, "tuna_can"]
    assert told[2:] == [(["tuna_can"], "preparing"), (["tuna_can"], "surfaces")]


def test_a_shelf_of_items_that_are_in_no_folder() -> None:
    items = {"brick": box(0.08, 0.06, 0.04, "brick"), "book": box(0.10, 0.08, 0.02, "book")}
    shelf = shelf_of(items, GRID)
    assert list(shelf.prepared) == ["brick", "book"]
    assert shelf.items["brick"] is shelf.shapes["brick"] is items["brick"]
    assert shelf.prepared["book"].box_volume == pytest.approx(0.10 * 0.08 * 0.02, rel=1e-6)
    assert "mug" not in shelf


def test_a_shelf_like_another_shares_its_items(tmp_path: Path) -> None:
    shelf = make_shelf(tmp_path)
    assert shelf.like(GRID, "mesh") is shelf
    finer = shelf.like(replace(GRID, cell_size=0.002), "parts")
    assert (finer.grid.cell_size, finer.geometry) == (0.002, "parts")
    assert finer.items["golf_ball"] is shelf.items["golf_ball"]
    assert finer.prepared["golf_ball"].orientations[0].cell_size == 0.002
    assert shelf.prepared["golf_ball"].orientations[0].cell_size == GRID.cell_size
