"""The cache of prepared items: what comes back is what went in, and a damaged file is made anew."""

from __future__ import annotations

import dataclasses
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from packenv.config import HEIGHT_QUANTUM, GridConfig
from packenv.errors import InputError
from packenv.geometry.convex_parts import convex_parts, envelope
from packenv.geometry.prepare import PreparedItem, prepare_item
from packenv.items import cache as cache_module
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


def test_another_centre_of_mass_is_another_file(tmp_path: Path) -> None:
    """The stable poses hang on it."""
    cache = ItemCache(tmp_path)
    cache.prepare(ITEM, GRID)
    assert cache.get(dataclasses.replace(ITEM, com=ITEM.com + 0.001), GRID) is None


def test_another_quantum_of_heights_is_another_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The kept heightmaps are rounded up to it."""
    store = ItemCache(tmp_path)
    store.prepare(ITEM, GRID)
    monkeypatch.setattr(cache_module, "HEIGHT_QUANTUM", HEIGHT_QUANTUM * 2)
    assert store.get(ITEM, GRID) is None


def test_an_envelope_is_kept_for_its_parts(tmp_path: Path) -> None:
    """One mesh, two sets of parts: exact ones and the hull, as a folder of parts and the search give them."""
    store, hull = ItemCache(tmp_path), dataclasses.replace(convex_parts(ITEM), parts=(ITEM.vertices,))
    parts = convex_parts(ITEM)
    assert len(parts.parts) > 1
    for found in (parts, hull, parts, hull):
        made, kept = envelope(ITEM, found), store.envelope(ITEM, found)
        assert kept.sha256 == made.sha256
        np.testing.assert_array_equal(kept.vertices, made.vertices)
        np.testing.assert_array_equal(kept.faces, made.faces)
    assert store.envelope(ITEM, parts).sha256 != store.envelope(ITEM, hull).sha256


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
    path = cache.prepared_file(ITEM, GRID).path
    content = path.read_bytes()
    path.write_bytes(content[: int(keep if keep >= 1 or keep == 0 else keep * len(content))])
    assert cache.get(ITEM, GRID) is None
    _same(made, cache.prepare(ITEM, GRID))
    assert path.read_bytes() == content


def test_a_flipped_byte_is_noticed(tmp_path: Path) -> None:
    cache = ItemCache(tmp_path)
    cache.prepare(ITEM, GRID)
    path = cache.prepared_file(ITEM, GRID).path
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    assert cache.get(ITEM, GRID) is None


def test_no_temporary_file_stays(tmp_path: Path) -> None:
    cache = ItemCache(tmp_path)
    cache.prepare(ITEM, GRID)
    assert [path.suffix for path in (tmp_path / "prepared").iterdir()] == [".cache"]


@pytest.mark.parametrize(
    ("kind", "age", "stays"), [(".x.tmp", 7200, False), (".x.tmp", 60, True), ("x", 7200, True)]
)
def test_what_a_killed_process_left_is_removed(tmp_path: Path, kind: str, age: float, stays: bool) -> None:
    """By the next one that writes: a young one may be another process's, which writes it now."""
    left = tmp_path / "prepared" / kind
    left.parent.mkdir()
    left.write_bytes(b"half")
    os.utime(left, (time.time() - age,) * 2)
    ItemCache(tmp_path).prepare(ITEM, GRID)
    assert left.exists() == stays


def _mutated(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """The content with one kind of damage at a random place."""
    at, length = sorted(rng.integers(0, len(content), 2).tolist())
    data = bytearray(content)
    match rng.integers(7):
        case 0:
            data[at] ^= 1 << rng.integers(8)
        case 1:
            data[at % 600] ^= 1 << rng.integers(8)  # the digest and the headers
        case 2:
            del data[at:]
        case 3:
            data[at:length] = bytes(length - at)
        case 4:
            data[at:at] = rng.bytes(int(rng.integers(1, 100)))
        case 5:
            data[at:length] = other[at:length]
        case _:
            data = bytearray(other)
    return bytes(data)


@pytest.mark.parametrize("count", [300, pytest.param(4000, marks=pytest.mark.slow)])
def test_no_damage_is_believed_and_none_is_an_error(tmp_path: Path, count: int) -> None:
    """Bits, blocks and whole files: what comes back is what was made, and the file is sound again."""
    rng, store = np.random.default_rng(count), ItemCache(tmp_path)
    store.prepare(ITEM, GRID)
    store.prepare(ITEM, dataclasses.replace(GRID, n_yaws=4))
    store.parts(ITEM)
    store.envelope(ITEM, store.parts(ITEM))
    store.surface_field(box(0.05, 0.04, 0.03))
    files = sorted(tmp_path.rglob("*.cache"))
    assert len(files) == 5
    keys = {
        store.prepared_file(ITEM, GRID): dict(store.prepared_file(ITEM, GRID).read() or {}),
        store.parts_file(ITEM): dict(store.parts_file(ITEM).read() or {}),
    }
    for _ in range(count):
        file = list(keys)[rng.integers(len(keys))]
        damaged = sound = file.path.read_bytes()
        while damaged == sound:
            damaged = _mutated(sound, files[rng.integers(len(files))].read_bytes(), rng)
        file.path.write_bytes(damaged)
        assert file.read() is None
        kept = file.kept(lambda: keys[file], dict, dict)  # noqa: B023
        assert {n: a.tobytes() for n, a in kept.items()} == {n: a.tobytes() for n, a in keys[file].items()}
        assert file.path.read_bytes() == sound


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="ROBOTPACK_CACHE"):
        ItemCache(tmp_path / "file").prepare(ITEM, GRID)


def test_the_environment_names_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOTPACK_CACHE", str(tmp_path))
    assert default_folder() == tmp_path
    monkeypatch.delenv("ROBOTPACK_CACHE")
    monkeypatch.setenv("HOME", str(tmp_path))
    for set_to in ("", str(tmp_path / "x")):
        monkeypatch.setenv("XDG_CACHE_HOME", set_to)
        assert default_folder().is_relative_to(tmp_path)


@pytest.mark.skipif(sys.platform == "win32", reason="there the home has other names")
@pytest.mark.parametrize("home", [None, "", "relative"])
def test_without_a_home_it_is_a_folder_of_its_own(home: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Never one below wherever the program was started. Without HOME the account says where home is."""
    for name in ("ROBOTPACK_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    if home is not None:
        monkeypatch.setenv("HOME", home)
    assert default_folder().is_absolute()
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: Path("~/.cache/robotpack"))
    assert default_folder().parent == Path(tempfile.gettempdir())


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
    path = cache.parts_file(item).path
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    assert len(cache.parts(item).parts) == 1
    assert path.read_bytes() == whole
