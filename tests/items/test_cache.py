"""The cache of prepared items: what comes back is what went in, and a damaged file is made anew."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from packenv.config import GridConfig
from packenv.errors import InputError
from packenv.geometry.prepare import PreparedItem, prepare_item
from packenv.items.cache import ItemCache, default_folder
from packenv.types import Item
from tests.shapes import ball, box, cup

GRID = GridConfig(n_poses=2, n_yaws=2)
ITEM = cup(0.03, 0.05)


def _same(a: PreparedItem, b: PreparedItem) -> None:
    assert (a.name, a.sha256, a.volume) == (b.name, b.sha256, b.volume)
    for p, q in zip(a.poses, b.poses, strict=True):
        assert (p.probability, p.com_height, p.members) == (q.probability, q.com_height, q.members)
        np.testing.assert_array_equal(p.rotation, q.rotation)
    for o, r in zip(a.orientations, b.orientations, strict=True):
        assert (o.item, o.pose_index, o.yaw, o.cell_size) == (r.item, r.pose_index, r.yaw, r.cell_size)
        for name in ("rotation", "offset", "extents", "com", "top", "bottom"):
            x, y = getattr(o, name), getattr(r, name)
            np.testing.assert_array_equal(x, y)
            assert x.dtype == y.dtype


def test_what_comes_back_is_what_went_in(tmp_path: Path) -> None:
    cache = ItemCache(tmp_path)
    assert cache.get(ITEM, GRID) is None
    made = cache.prepare(ITEM, GRID)
    _same(made, prepare_item(ITEM, GRID))
    kept = cache.get(ITEM, GRID)
    assert kept is not None
    _same(made, kept)


@pytest.mark.parametrize(
    "other",
    [
        GridConfig(n_poses=3, n_yaws=2),
        GridConfig(n_poses=2, n_yaws=4),
        GridConfig(cell_size=0.001, n_poses=2, n_yaws=2),
    ],
)
def test_another_discretization_is_another_file(tmp_path: Path, other: GridConfig) -> None:
    cache = ItemCache(tmp_path)
    cache.prepare(ITEM, GRID)
    assert cache.get(ITEM, other) is None


def test_the_step_between_translations_shares_the_file(tmp_path: Path) -> None:
    cache = ItemCache(tmp_path)
    cache.prepare(ITEM, GRID)
    assert cache.get(ITEM, dataclasses.replace(GRID, grid_step=0.004)) is not None


def test_another_mesh_of_the_same_name_is_another_file(tmp_path: Path) -> None:
    cache = ItemCache(tmp_path)
    cache.prepare(ITEM, GRID)
    assert cache.get(box(0.1, 0.1, 0.1, name=ITEM.name), GRID) is None


def test_another_name_for_the_same_mesh_shares_the_file(tmp_path: Path) -> None:
    cache = ItemCache(tmp_path)
    cache.prepare(ITEM, GRID)
    found = cache.get(dataclasses.replace(ITEM, name="beaker"), GRID)
    assert found is not None
    assert {found.name, *(o.item for o in found.orientations)} == {"beaker"}


@pytest.mark.parametrize("keep", [0, 1, 100, 0.5, 0.99])
def test_a_torn_file_is_made_anew(tmp_path: Path, keep: float) -> None:
    cache = ItemCache(tmp_path)
    made = cache.prepare(ITEM, GRID)
    path = cache.path(ITEM, GRID)
    content = path.read_bytes()
    path.write_bytes(content[: int(keep if keep >= 1 or keep == 0 else keep * len(content))])
    assert cache.get(ITEM, GRID) is None
    _same(made, cache.prepare(ITEM, GRID))
    assert path.read_bytes() == content


def test_a_flipped_byte_is_noticed(tmp_path: Path) -> None:
    cache = ItemCache(tmp_path)
    cache.prepare(ITEM, GRID)
    path = cache.path(ITEM, GRID)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    assert cache.get(ITEM, GRID) is None


def test_no_temporary_file_stays(tmp_path: Path) -> None:
    cache = ItemCache(tmp_path)
    cache.prepare(ITEM, GRID)
    assert [path.suffix for path in (tmp_path / "prepared").iterdir()] == [".npz"]


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="ROBOTPACK_CACHE"):
        ItemCache(tmp_path / "file").prepare(ITEM, GRID)


def test_the_environment_names_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOTPACK_CACHE", str(tmp_path))
    assert default_folder() == tmp_path
    monkeypatch.delenv("ROBOTPACK_CACHE")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "x"))
    assert default_folder().is_relative_to(tmp_path)


@pytest.mark.parametrize("item", [box(0.05, 0.04, 0.03), ball(0.03)], ids=["box", "ball"])
def test_convex_parts_come_back_as_they_went_in(tmp_path: Path, item: Item) -> None:
    made = ItemCache(tmp_path).parts(item)
    kept = ItemCache(tmp_path).parts(item)
    assert [p.tobytes() for p in kept.parts] == [p.tobytes() for p in made.parts]
    assert (kept.bulge, kept.dent) == (made.bulge, made.dent)
    assert (kept.ball is None) == (made.ball is None)
    if kept.ball is not None and made.ball is not None:
        assert kept.ball.radius == made.ball.radius
        np.testing.assert_array_equal(kept.ball.centre, made.ball.centre)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_torn_file_of_convex_parts_is_made_anew(tmp_path: Path, share: float) -> None:
    item = box(0.05, 0.04, 0.03)
    cache = ItemCache(tmp_path)
    cache.parts(item)
    path = cache.parts_path(item)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    assert len(cache.parts(item).parts) == 1
    assert path.read_bytes() == whole
