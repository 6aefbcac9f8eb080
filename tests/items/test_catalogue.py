"""Catalogues: tables, bare folders, laziness."""

from __future__ import annotations

import pytest

from packenv.errors import CatalogueError, MeshError, UnitError
from packenv.geometry.mass import estimated_mass, hull_volume
from packenv.items.catalogue import open_catalogue
from packenv.items.check import check_items, format_table
from tests.mesh_samples import arrays, ball, block, cup, write_mesh, write_ply


@pytest.fixture
def shelf(tmp_path):
    folder = tmp_path / "shelf"
    (folder / "deep").mkdir(parents=True)
    write_mesh(folder / "mug.ply", cup())
    write_mesh(folder / "deep" / "box.ply", block())
    vertices, faces = arrays(ball())
    write_ply(folder / "ball.ply", vertices * 1000, faces)
    (folder / "objects.csv").write_text(
        "name,file,mass_kg,unit,parts_file,_colour\n"
        "red mug,mug.ply,0.3,,,red\n"
        'box,"deep/box.ply",,m,deep/box_parts.obj,\n'
        "ball,ball.ply,0.1,mm,,\n"
    )
    return folder


def test_a_table(shelf):
    catalogue = open_catalogue(shelf)
    assert catalogue.label == str(shelf)
    assert catalogue.folder == shelf
    assert catalogue.names == tuple(catalogue) == ("red mug", "box", "ball")
    assert len(catalogue) == 3
    assert "box" in catalogue
    assert "Box" not in catalogue
    mug, box, ball_ = (catalogue.item(name) for name in catalogue)
    assert (mug.mass, mug.mass_estimated, mug.file) == (0.3, False, "mug.ply")
    assert box.mass_estimated
    assert box.mass == pytest.approx(estimated_mass(box.volume, hull_volume(box.vertices)))
    assert box.file == "deep/box.ply"
    assert ball_.extents == pytest.approx([0.1] * 3, rel=0.01)
    assert catalogue.parts_file("box") == shelf / "deep" / "box_parts.obj"
    assert catalogue.parts_file("red mug") is None


def test_an_item_is_loaded_once_and_only_when_asked_for(shelf):
    (shelf / "mug.ply").write_text("garbage")
    catalogue = open_catalogue(shelf)
    box = catalogue.item("box")
    (shelf / "deep" / "box.ply").unlink()
    assert catalogue.item("box") is box
    with pytest.raises(MeshError, match=r"mug\.ply"):
        catalogue.item("red mug")


def test_a_rows_own_unit_stands_above_the_given_one(shelf):
    catalogue = open_catalogue(shelf, unit="cm")
    assert catalogue.item("box").extents == pytest.approx([0.1, 0.06, 0.04])
    with pytest.raises(UnitError):
        catalogue.item("red mug")


def test_a_folder_without_a_table(shelf):
    (shelf / "objects.csv").unlink()
    (shelf / ".hidden.ply").write_text("x")
    (shelf / "readme.txt").write_text("x")
    catalogue = open_catalogue(str(shelf), unit="mm")
    assert catalogue.names == ("ball", "mug")
    assert catalogue.item("ball").extents == pytest.approx([0.1] * 3, rel=0.01)
    assert catalogue.item("ball").mass_estimated
    assert catalogue.parts_file("ball") is None


def test_a_byte_order_mark_and_windows_lines_are_accepted(shelf):
    table = shelf / "objects.csv"
    table.write_bytes(b"\xef\xbb\xbf" + table.read_bytes().replace(b"\n", b"\r\n") + b"\r\n,,,,,\r\n")
    assert open_catalogue(shelf).names == ("red mug", "box", "ball")


@pytest.mark.parametrize(("name", "meant"), [("redmug", "red mug"), ("mug", "red mug"), ("bal", "ball")])
def test_an_unknown_item_is_answered_with_the_closest(name, meant, shelf):
    with pytest.raises(CatalogueError, match=f"{name!r}; did you mean {meant!r}"):
        open_catalogue(shelf).item(name)


def test_the_check_goes_on_after_a_bad_mesh(shelf):
    vertices, faces = arrays(cup())
    write_ply(shelf / "mug.ply", vertices, faces[:, ::-1])
    (shelf / "ball.ply").write_text("garbage")
    seen = []

    def progress(names):
        for name in names:
            seen.append(name)
            yield name

    reports = check_items(shelf, progress=progress)
    assert seen == [r.name for r in reports] == ["red mug", "box", "ball"]
    assert [r.status for r in reports] == ["repaired", "ok", "error"]
    mug, box, ball_ = reports
    assert "inside out" in mug.text
    assert (box.vertices, box.faces, box.text, box.mass_estimated) == (8, 12, "", True)
    assert box.extents == pytest.approx((0.1, 0.06, 0.04))
    assert box.convexity == pytest.approx(1)
    assert mug.convexity < 0.5
    assert ball_.vertices is None
    assert str(shelf) not in ball_.text

    lines = format_table(reports).splitlines()
    assert len(lines) == 1 + 3 + 2
    assert lines[0].split()[:2] == ["item", "status"]
    assert "100 x 60 x 40" in lines[2]
    assert "~0.0888" in lines[2]
    assert "ball.ply: " in lines[3]
    assert lines[4] == "3 items: 1 ok, 1 repaired, 1 unusable"


@pytest.mark.objects
def test_the_scanned_catalogue(objects_dir):
    catalogue = open_catalogue(objects_dir)
    assert len(catalogue) == 94
    assert catalogue.item("025_mug").mass == 0.118
    assert catalogue.item("025_mug").volume == pytest.approx(1.381209e-4, rel=1e-5)
    assert catalogue.item("mead_index_cards").mass_estimated
    assert sum(e.mass is None for e in catalogue.entries.values()) == 18


def test_parts_beside_a_mesh_are_found_in_a_table_and_without_one(shelf):
    (shelf / "mug.parts.obj").write_text("o a\n")
    assert open_catalogue(shelf).parts_file("red mug") == shelf / "mug.parts.obj"
    (shelf / "objects.csv").unlink()
    bare = open_catalogue(shelf)
    assert bare.names == ("ball", "mug")
    assert bare.parts_file("mug") == shelf / "mug.parts.obj"
    assert bare.parts_file("ball") is None


def test_meshes_that_are_not_kept_are_read_again() -> None:
    """A catalogue with room for one mesh hands out the same items as one that keeps them all."""
    kept, forgetful = open_catalogue("builtin"), open_catalogue("builtin", item_memory=1)
    first, second = kept.names[:2]
    item = forgetful.item(first)
    assert forgetful.item(first) is item
    assert forgetful.item(second).sha256 == kept.item(second).sha256
    again = forgetful.item(first)
    assert again is not item
    assert kept.item(first) is kept.item(first)
    assert (again.sha256, again.mass) == (item.sha256, item.mass) == (kept.item(first).sha256, item.mass)
