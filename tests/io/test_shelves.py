"""A shelf hands out what the catalogue and the cache hold, loads it once, and forgets what was brought."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from packenv.config import GridConfig
from packenv.errors import CatalogueError
from packenv.io.catalogues import open_catalogue
from packenv.io.item_cache import ItemCache
from packenv.io.shelves import ItemShelf

GRID = GridConfig(cell_size=0.004, grid_step=0.02, n_poses=2, n_yaws=2)


def make_shelf(tmp_path: Path, **options: object) -> ItemShelf:
    return ItemShelf(open_catalogue("builtin"), GRID, cache=ItemCache(tmp_path), **options)  # type: ignore[arg-type]


def test_everything_is_made_once(tmp_path: Path) -> None:
    shelf = make_shelf(tmp_path, geometry="parts")
    for get in (shelf.item, shelf.parts, shelf.shape, shelf.prepared, shelf.field, shelf.physics):
        assert get("golf_ball") is get("golf_ball")
    assert "golf_ball" in shelf
    assert "no such item" not in shelf
    with pytest.raises(CatalogueError):
        shelf.prepared("no such item")


def test_the_shape_is_the_mesh_or_the_envelope(tmp_path: Path) -> None:
    mesh, parts = make_shelf(tmp_path), make_shelf(tmp_path, geometry="parts")
    assert mesh.shape("mug") is mesh.item("mug")
    assert parts.shape("mug").sha256 == parts.prepared("mug").sha256
    low, high = mesh.shape("mug").vertices.min(axis=0), mesh.shape("mug").vertices.max(axis=0)
    assert (parts.shape("mug").vertices.min(axis=0) <= low + 1e-6).all()
    assert (parts.shape("mug").vertices.max(axis=0) >= high - 1e-6).all()


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
    own = shelf.prepared("golf_ball")
    files = sorted(tmp_path.rglob("*.npz"))
    item = open_catalogue("builtin").item("soap_bar")
    shelf.bring({"golf_ball": replace(item, name="golf_ball"), "novelty": replace(item, name="novelty")})
    assert "novelty" in shelf
    assert shelf.prepared("golf_ball").volume == pytest.approx(item.volume)
    assert shelf.physics("novelty").mass == item.mass
    assert sorted(tmp_path.rglob("*.npz")) == files  # nothing of it in the cache
    shelf.bring({})
    assert "novelty" not in shelf
    assert shelf.prepared("golf_ball").volume == own.volume


def test_planning_takes_the_named_items_alone(tmp_path: Path) -> None:
    shelf = make_shelf(tmp_path).planning(["golf_ball", "soap_bar", "golf_ball"])
    assert list(shelf.meshes) == list(shelf.prepared) == ["golf_ball", "soap_bar"]
