"""Tables as spreadsheet programs write them: one content, whatever stands between the cells, in every table."""

from __future__ import annotations

import io
import unicodedata
import zipfile

import pytest
from hypothesis import given, strategies as st

from packenv.env.orders import GeneratedOrder
from packenv.errors import InputError
from packenv.io.containers import read_boxes
from packenv.io.orders import read_order
from packenv.io.tables import Columns, read_table, read_text
from packenv.items.catalogue import open_catalogue
from packenv.types import Container, Order, OrderLine
from tests.mesh_samples import block, write_mesh

ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le-bom")
SEPARATORS = (",", ";", "\t")
NAME = "Kännchen"
NFC, NFD = (unicodedata.normalize(form, NAME) for form in ("NFC", "NFD"))


def encoded(text: str, encoding: str) -> bytes:
    return b"\xff\xfe" + text.encode("utf-16-le") if encoding.endswith("bom") else text.encode(encoding)


def lines(rows, separator, empty=0):
    return "".join(separator.join([*row, *[""] * empty]) + "\r\n" for row in rows)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("separator", SEPARATORS)
@pytest.mark.parametrize("empty", [0, 3])
@pytest.mark.parametrize("said", [False, True])
def test_every_table_in_every_way_of_writing_it(encoding, separator, empty, said, tmp_path):
    def write(name, rows):
        path = tmp_path / name
        text = (f"sep={separator}\r\n" if said else "") + lines(rows, separator, empty)
        path.write_bytes(encoded(text + separator * empty + "\r\n", encoding))
        return path

    write_mesh(tmp_path / "mug.ply", block())
    comma = "." if separator == "," else ","
    write("objects.csv", [("name", "file", "mass_kg"), ("mug", "mug.ply", f"0{comma}118")])
    boxes = write("b.csv", [("box_id", "length_m", "width_m", "height_m"), ("A", "0.3", f"0{comma}25", "1")])
    order = write("o.csv", [("item", "qty"), ("mug", "2")])
    catalogue = open_catalogue(tmp_path)
    assert catalogue.entries["mug"].mass == 0.118
    assert read_boxes(boxes) == (Container(0.3, 0.25, 1.0, name="A"),)
    assert read_order(order, catalogue.names).lines == (OrderLine("mug", 2),)


@given(
    cells=st.lists(
        st.tuples(*[st.text("ab;, \"'", min_size=1).filter(str.strip)] * 2), min_size=1, max_size=5
    ),
    separator=st.sampled_from(SEPARATORS),
)
def test_what_is_quoted_is_kept(cells, separator, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "t.csv"

    def quoted(text):
        return '"' + text.replace('"', '""') + '"'

    text = lines([("item", "qty"), *(tuple(map(quoted, row)) for row in cells)], separator)
    rows = read_table(path, text, Columns(("item", "qty")), InputError)
    assert [tuple(row.cells.values()) for row in rows] == [tuple(c.strip() for c in row) for row in cells]


@pytest.mark.parametrize(
    ("member", "named"),
    [
        ("xl/workbook.xml", "Excel workbook (xlsx)"),
        ("content.xml", "OpenDocument"),
        ("Index/Document.iwa", "Numbers"),
        ("a.csv", "zip archive"),
    ],
)
def test_a_workbook_is_named(member, named, tmp_path):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(member, "x")
    for name, read in (
        ("objects.csv", lambda: open_catalogue(tmp_path)),
        ("o.csv", lambda: read_order(tmp_path / "o.csv", ["mug"])),
        ("b.csv", lambda: read_boxes(tmp_path / "b.csv")),
    ):
        (tmp_path / name).write_bytes(buffer.getvalue())
        with pytest.raises(InputError) as problem:
            read()
        assert all(word in str(problem.value) for word in (str(tmp_path / name), named, "CSV UTF-8"))


@pytest.mark.parametrize("on_disk", [NFC, NFD])
@pytest.mark.parametrize("asked", [NFC, NFD])
@pytest.mark.parametrize("listed", [None, NFC, NFD])
def test_a_name_is_found_in_either_normal_form(on_disk, asked, listed, tmp_path):
    write_mesh(tmp_path / f"{on_disk}.ply", block())
    if listed is not None:
        (tmp_path / "objects.csv").write_text(f"name,file\n{listed},{listed}.ply\n", encoding="utf-8")
    catalogue = open_catalogue(tmp_path)
    assert catalogue.names == (NFC,)
    assert asked in catalogue
    assert catalogue.item(asked).name == NFC
    order = tmp_path / "o.csv"
    order.write_text(f"item\n{asked}\n", encoding="utf-8")
    assert (
        read_order(order, [on_disk]).names
        == Order.of(asked).names
        == GeneratedOrder((asked,)).items
        == (NFC,)
    )


def test_two_names_that_are_one(tmp_path):
    write_mesh(tmp_path / f"{NFC}.ply", block())
    write_mesh(tmp_path / f"{NFD}.ply", block())
    with pytest.raises(InputError, match="are both named"):
        open_catalogue(tmp_path)


def test_a_file_in_utf_16_without_a_mark_is_refused(tmp_path):
    path = tmp_path / "o.csv"
    path.write_bytes("item\nmug\n".encode("utf-16-le"))
    with pytest.raises(InputError, match="zero bytes"):
        read_text(path, InputError, "an order")
