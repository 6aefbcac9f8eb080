"""The cache of meshes: a warm one gives the very same item, a damaged one is made anew."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from packenv.errors import MeshError, UnitError
from packenv.geometry.meshes import FORMAT, LoadedMesh
from packenv.items import mesh_cache
from packenv.items.mesh_cache import kept_mesh
from tests.mesh_samples import arrays, ball, block, cup, load_mesh, write_mesh, write_ply


def _same(a: LoadedMesh, b: LoadedMesh) -> None:
    assert a.solid.volume == b.solid.volume > 0.0
    solid = [(a.solid.com, b.solid.com), (a.solid.inertia, b.solid.inertia)]
    for x, y in ((a.vertices, b.vertices), (a.faces, b.faces), *solid):
        np.testing.assert_array_equal(x, y)
        assert x.dtype == y.dtype
        assert x.flags.c_contiguous
        assert y.flags.c_contiguous
    assert (a.repairs, a.notes) == (b.repairs, b.notes)


def _count_reads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    read: list[Path] = []

    def parsed(path: Path, data: bytes) -> object:
        read.append(path)
        return parse(path, data)

    parse = mesh_cache.parsed_mesh
    monkeypatch.setattr(mesh_cache, "parsed_mesh", parsed)
    return read


def test_what_comes_back_is_what_was_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the repairs and the notes of a mesh that has both."""
    vertices, faces = arrays(cup(), ball(0.02, at=(0.2, 0, 0)))
    path = write_ply(tmp_path / "a.ply", np.vstack([vertices, [[9, 9, 9]]]), faces[:, ::-1])
    read = _count_reads(monkeypatch)
    made, kept = (kept_mesh(path, None, tmp_path / "cache") for _ in range(2))
    assert len(read) == 1
    assert made.repairs
    assert len(made.notes) == 2
    _same(made, load_mesh(path))
    _same(made, kept)


def test_the_file_is_known_by_its_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = _count_reads(monkeypatch)
    path = write_mesh(tmp_path / "a.ply", block())
    other = tmp_path / "b.ply"
    other.write_bytes(path.read_bytes())
    cache = tmp_path / "cache"
    kept_mesh(path, None, cache)
    kept_mesh(other, None, cache)
    assert len(read) == 1
    write_mesh(path, block(0.12))
    assert np.ptp(kept_mesh(path, None, cache).vertices, axis=0)[0] == pytest.approx(0.12)
    assert len(read) == 2


def test_another_unit_extension_or_format_is_another_mesh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_mesh(tmp_path / "a.ply", block())
    cache = tmp_path / "cache"
    kept_mesh(path, "m", cache)
    assert np.ptp(kept_mesh(path, "in", cache).vertices, axis=0)[0] == pytest.approx(0.1 * 0.0254)
    with pytest.raises(UnitError, match="with --unit mm"):
        kept_mesh(write_mesh(tmp_path / "b.ply", block(0.9, 0.9, 0.9)), "mm", cache)
    wrong = path.rename(tmp_path / "a.stl")
    assert kept_mesh(wrong, "m", cache).notes == ("the content is PLY although the name ends in .stl",)
    read = _count_reads(monkeypatch)
    monkeypatch.setattr(mesh_cache, "FORMAT", FORMAT + 1)
    kept_mesh(wrong, "m", cache)
    assert len(read) == 1


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty"])
def test_a_damaged_file_is_made_anew(damage: str, tmp_path: Path) -> None:
    path = write_mesh(tmp_path / "a.ply", cup())
    cache = tmp_path / "cache"
    made = kept_mesh(path, None, cache)
    (kept,) = (cache / "meshes").iterdir()
    sound = bytearray(kept.read_bytes())
    sound[len(sound) // 2] ^= 1
    kept.write_bytes({"cut": sound[: len(sound) // 2], "flipped": sound, "empty": b""}[damage])
    _same(kept_mesh(path, None, cache), made)
    _same(kept_mesh(path, None, cache), made)


def test_a_bad_file_is_refused_every_time(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(b"solid\n")
    for _ in range(2):
        with pytest.raises(MeshError, match=r"a\.stl"):
            kept_mesh(path, None, tmp_path / "cache")


def test_a_cache_that_cannot_be_written_hinders_nothing(tmp_path: Path) -> None:
    path = write_mesh(tmp_path / "a.ply", cup())
    (tmp_path / "file").touch()
    _same(kept_mesh(path, None, tmp_path / "file" / "cache"), load_mesh(path))


def test_a_warm_catalogue_asks_no_mesh_library(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(cup().export(file_type="ply"))
    code = (
        "import sys; from packenv.items.catalogue import open_catalogue\n"
        f"open_catalogue({str(tmp_path)!r}).item('a')\n"
        "sys.exit(int('trimesh' in sys.modules or 'manifold3d' in sys.modules))"
    )
    codes = [subprocess.run([sys.executable, "-c", code], check=False).returncode for _ in range(2)]
    assert codes == [1, 0]
