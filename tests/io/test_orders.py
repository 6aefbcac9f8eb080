"""Orders as CSV and JSON."""

from __future__ import annotations

import json

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from packenv.errors import OrderError
from packenv.io.orders import MAX_PIECES, read_order

NAMES = ("mug", "red bowl", "025_plate, large")


def order(tmp_path, text, name="order.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_order(path, NAMES)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(lines=st.lists(st.tuples(st.sampled_from(NAMES), st.integers(1, 9)), min_size=1, max_size=12))
def test_csv_and_json_say_the_same_and_keep_the_sequence(lines, tmp_path):
    rows = "".join(f'"{item}",{qty}\n' for item, qty in lines)
    table = order(tmp_path, "item,qty\n" + rows)
    document = order(tmp_path, json.dumps({"items": [{"item": i, "qty": q} for i, q in lines]}), "o.json")
    pieces = order(tmp_path, json.dumps([i for i, q in lines for _ in range(q)]), "p.json")
    assert table.lines == document.lines
    assert [(line.item, line.qty) for line in table.lines] == lines
    assert table.names == document.names == pieces.names
    assert table.source == tmp_path / "order.csv"


def test_without_quantities_every_line_is_one_piece(tmp_path):
    assert order(tmp_path, "item\nmug\nmug\nred bowl\n").names == ("mug", "mug", "red bowl")


def test_columns_in_any_sequence_blank_lines_marks_and_blanks(tmp_path):
    text = b"\xef\xbb\xbfqty, item\r\n\r\n 2 , mug\r\n1,red bowl\r\n"
    assert order(tmp_path, text).names == ("mug", "mug", "red bowl")


def test_a_json_list_may_mix_names_and_objects(tmp_path):
    assert order(tmp_path, '["mug", {"item": "red bowl"}]', "o.json").names == ("mug", "red bowl")


def test_the_largest_order(tmp_path):
    assert len(order(tmp_path, f"item,qty\nmug,{MAX_PIECES}\n").names) == MAX_PIECES
    with pytest.raises(OrderError, match="10,001 pieces, the limit is 10,000"):
        order(tmp_path, f"item,qty\nmug,{MAX_PIECES}\nmug,1\n")
