"""Containers by id and by size."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from packenv.errors import ContainerError
from packenv.io.containers import parse_container, read_boxes
from packenv.types import Container

BOXES = (Container(0.254, 0.178, 0.083, name="A1"), Container(0.343, 0.241, 0.089, name="1AD"))


@given(size=st.tuples(*[st.floats(0.01, 2.0)] * 3), sign=st.sampled_from("xX×*"))
def test_a_size_is_read_as_it_is_written(size, sign):
    found = parse_container(sign.join(repr(s) for s in size), BOXES)
    assert found == Container(*size)
    assert found.name is None


@pytest.mark.parametrize(
    "text",
    [
        "0.32x0.32x0.30",
        " 0.32 x 0.32 x 0.30 ",
        ".32x.32x.3",
        "0.32x0.32x0.30m",
        "320x320x300mm",
        "320 x 320 x 300 MM",
        "32cmx32cmx30cm",
        "0.32,0.32,0.30",
        "320,320,300mm",
        "0.32; 0.32; 0.3",
    ],
)
def test_ways_to_write_a_size(text):
    assert parse_container(text, BOXES).size == (0.32, 0.32, 0.30)


@given(
    size=st.tuples(*[st.integers(10, 2000)] * 3), unit=st.sampled_from([("mm", 1), ("cm", 10), ("m", 1000)])
)
def test_a_unit_says_what_the_numbers_are(size, unit):
    """In millimetres, centimetres and metres one size is one container, to the last bit."""
    name, divisor = unit
    text = "x".join(repr(s / divisor) for s in size) + name
    assert parse_container(text, BOXES) == Container(*(s / 1000 for s in size))


@pytest.mark.parametrize(
    ("text", "unit", "size"),
    [
        ("200x150x120", "mm", (0.2, 0.15, 0.12)),
        ("0.2x0.15x0.12", "mm", (0.2, 0.15, 0.12)),
        ("20x15x12", "cm", (0.2, 0.15, 0.12)),
        ("0.2x0.15x0.12", "cm", (0.2, 0.15, 0.12)),
        ("10x5x4", "in", (0.254, 0.127, 0.1016)),
        ("200x150x120mm", "in", (0.2, 0.15, 0.12)),
        ("1x1x1", "m", (1.0, 1.0, 1.0)),
    ],
)
def test_the_unit_of_the_meshes_is_that_of_a_size_that_can_be_no_metres(text, unit, size):
    assert parse_container(text, BOXES, unit).size == size


@pytest.mark.parametrize(("text", "unit"), [("1x1.5x2", "cm"), ("1x1x0.5", "in")])
def test_a_size_that_may_be_in_either_unit_is_refused(text, unit):
    with pytest.raises(ContainerError, match=f"is it {text}m or {text}{unit}"):
        parse_container(text, BOXES, unit)


@pytest.mark.parametrize("text", ["1AD", "1ad", " 1Ad "])
def test_a_box_by_id_in_either_case(text):
    assert parse_container(text, BOXES) is BOXES[1]


def test_a_table_of_boxes_keeps_its_sequence(tmp_path):
    path = tmp_path / "boxes.csv"
    path.write_text(
        "box_id,length_m,width_m,height_m,source\nA1,0.254,0.178,0.083,x\n1AD,0.343,0.241,0.089,y\n"
    )
    assert read_boxes(path) == BOXES


def test_columns_of_boxes(tmp_path):
    path = tmp_path / "boxes.csv"
    path.write_text("box_id;length_m;width_m;height_m;_shelf;notes;\nA1;0,254;0,178;.083;7;old;\n")
    assert read_boxes(path) == BOXES[:1]
    path.write_text("box_id,length_m,width_m,hieght_m\nA1,1,1,1\n")
    with pytest.raises(ContainerError, match="unknown column 'hieght_m'; did you mean 'height_m'"):
        read_boxes(path)


def test_the_boxes_that_come_along():
    """Inner sizes as published for the Amazon Robotics Challenge 2017, m."""
    boxes = {box.name: box.size for box in read_boxes()}
    assert boxes["A1"] == (0.254, 0.178, 0.083)
    assert boxes["1AD"] == (0.343, 0.241, 0.089)
    assert boxes["1A5"] == (0.343, 0.279, 0.121)
    assert boxes["1B2"] == (0.394, 0.33, 0.089)
    assert boxes["K3"] == (0.495, 0.33, 0.159)
    assert (0.32, 0.32, 0.3) in boxes.values()


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("", "lists no boxes"),
        ("A1,0.1,0.1,0.1\na1,0.2,0.2,0.2", "line 3: box 'a1' is there twice"),
        ("A1,0.1,0.1,x", "line 2: height_m is 'x'"),
        ("A1,0.1,0.1,0", "line 2: height_m is 0"),
        ('A1,0.1,"0,2",0.1', "decimals take a point: 0.2"),
        ("A1,0.1,0.1", "3 cells where the header has 4"),
        ("A1,0.1,0.1,0.1\na\u0308,1,1,1\n\u00e4,1,1,1", "box 'ä' is there twice"),
        ("A1,254,178,83", "length is 254, give metres"),
        (",0.1,0.1,0.1", "'box_id' is empty"),
    ],
)
def test_a_bad_table(rows, words, tmp_path):
    path = tmp_path / "boxes.csv"
    path.write_text("box_id,length_m,width_m,height_m\n" + rows)
    with pytest.raises(ContainerError, match=words) as problem:
        read_boxes(path)
    assert str(path) in str(problem.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "neither a size"),
        ("B7", "known box (A1, 1AD)"),
        ("0.3x0.3", "0.32x0.32x0.30"),
        ("0.3x0.3x0.3x0.3", "neither a size"),
        ("0,32x0,32x0,30", "decimals take a point: 0.32x0.32x0.30"),
        ("320x320x300", "write 320x320x300mm"),
        ("32x32x30", "write 32x32x30cm or 32x32x30mm or 32x32x30in"),
        ("3200x3200x3000", "length is 3200, give metres"),
        ("5000x10x10mm", "length is 5"),
        ("320mmx32cmx300mm", "all sides in one unit"),
        ("320mmx320x300", "all sides in one unit"),
        ("0.3x0.3,0.3", "neither a size"),
        ("3x3x3ft", "neither a size"),
        ("0.3x-0.3x0.3", "width is -0.3"),
        ("0.3x0.3x0", "height is 0"),
        ("0.3x0.3xnan", "neither a size"),
        ("1e400x0.3x0.3", "length is inf"),
        ("a\nb", "a\\nb"),
    ],
)
def test_a_bad_container(text, words):
    with pytest.raises(ContainerError) as problem:
        parse_container(text, BOXES)
    assert words in str(problem.value)
    assert "\n" not in str(problem.value)
