"""All figures: files that are listed, pictures with something on them, the same bytes every time."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from trimesh.creation import box

from packenv.errors import InputError
from packenv.experiments.figures import failure, galleries, waste, write, write_figures
from packenv.experiments.figures.write import INDEX, MAKERS
from tests.experiments.figures.sources import Listener


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A folder of three bare boxes, mm, without a bowl."""
    folder = tmp_path_factory.mktemp("boxes")
    for name, size in (("brick", (100, 80, 50)), ("slab", (120, 100, 40)), ("cube", (50, 50, 50))):
        box(size).export(folder / f"{name}.stl")
    return str(folder)


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(failure, "ORDERS", 1)
    monkeypatch.setattr(waste, "ORDERS", 2)
    monkeypatch.setattr(galleries, "SHOWN", 2)


def test_a_folder_of_boxes_gives_what_it_can(
    catalogue: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    listener = Listener()
    figures = write_figures(catalogue, tmp_path / "new" / "a", unit="mm", watcher=listener)
    names = [figure.name for figure in figures]
    assert {"heightmap", "small-orders", "large-orders", "stable-versus-not"} <= set(names)
    left_out = [name for name in MAKERS if name not in names]
    assert "bowls" in left_out
    assert [remark.split(":")[0] for remark in listener.remarks] == [f"figure {name}" for name in left_out]
    document = json.loads((tmp_path / "new" / "a" / INDEX).read_text(encoding="utf-8"))
    assert [entry["name"] for entry in document["figures"]] == names
    for figure, entry in zip(figures, document["figures"], strict=True):
        assert entry["caption"] == figure.caption
        assert entry["files"] == [path.name for path in figure.files]
        assert all(name in ("brick", "slab", "cube") for order in entry["orders"] for name in order)
        pixels = np.asarray(Image.open(figure.files[0]).convert("RGB"))
        assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 200
        assert (pixels[:4] == 255).all()  # a white margin: nothing is cut off
        assert (pixels[-4:] == 255).all()
    monkeypatch.setattr(write, "MAKERS", {name: MAKERS[name] for name in ("heightmap", "large-orders")})
    for figure in write_figures(catalogue, tmp_path / "b", unit="mm", watcher=Listener()):
        (same,) = (other for other in figures if other.name == figure.name)
        assert [path.read_bytes() for path in figure.files] == [path.read_bytes() for path in same.files]


def test_without_matplotlib_it_is_said_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)  # as if it were not installed
    with pytest.raises(InputError, match=r"matplotlib.*pip install 'robotpack\[bench\]'"):
        write_figures("builtin", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_made_is_named(catalogue: str, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="file"):
        write_figures(catalogue, tmp_path / "file" / "out", unit="mm")


def test_items_that_are_too_large_are_refused_in_a_line(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    (tmp_path / "in").mkdir()
    box((500, 500, 500)).export(tmp_path / "in" / "crate.stl")
    with pytest.raises(InputError, match=r"no item of .*in fits a box of 32 × 32 × 30 cm"):
        write_figures(str(tmp_path / "in"), tmp_path / "out", unit="mm")


def test_a_seed_below_zero_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    with pytest.raises(InputError, match="seed is -1"):
        write_figures("builtin", tmp_path / "out", seed=-1)
