"""JSON of the user's: what Python reads and no float holds is refused by its place, in every kind of file."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from packenv.agents.__main__ import read_document
from packenv.agents.policy_files import read_config
from packenv.cli import main
from packenv.errors import InputError, MeshError, OrderError, PlanError, is_number
from packenv.geometry.mesh_files import parsed_mesh
from packenv.geometry.readers.raw import RawMesh
from packenv.io.orders import read_order
from packenv.io.plans import read_plan
from packenv.json_text import parse_json
from packenv.robot.files import load_cell
from packenv.train.config import TrainConfig

NO_NUMBERS = ["1" + "0" * 400, "-1" + "0" * 400, "1e999", "-1e999", "NaN", "Infinity", "-Infinity"]


def _document(rng: np.random.Generator, depth: int) -> Any:
    """A random document of all that JSON has."""
    kind = int(rng.integers(3 if depth else 1))
    if kind == 1:
        return {k: _document(rng, depth - 1) for k in "abc"}
    if kind == 2:
        return [_document(rng, depth - 1) for _ in range(3)]
    return ["", "NaN", "1e999", 0, -3.5, 10**300, 1.7e308, True, None][rng.integers(9)]


@pytest.mark.parametrize("seed", range(21))
def test_a_document_comes_back_as_it_is_unless_a_number_is_none(seed: int) -> None:
    rng, bad = np.random.default_rng(seed), NO_NUMBERS[seed % len(NO_NUMBERS)]
    rows = [_document(rng, 3) for _ in range(4)]
    assert parse_json(json.dumps({"x": rows}), "it") == {"x": rows}
    at = int(rng.integers(4))
    rows[at] = {"before": rows[at], "z": "here", "after": rows[at]}
    text = json.dumps({"x": rows}).replace('"here"', bad)
    with pytest.raises(InputError) as caught:
        parse_json(text, "it")
    written = json.dumps(float(bad)) if "e" in bad else bad
    assert str(caught.value) == f"it: x[{at}].z is {written:.40}, give a finite number"


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "1" * 5000, b"\xff\xfe\xff", b"\x80"])
def test_what_is_no_json_is_one_line(text: str | bytes) -> None:
    with pytest.raises(InputError, match=r"^it: is not (JSON|text).*, give this$"):
        parse_json(text, "it", "this")


def test_a_byte_order_mark_is_no_content() -> None:
    assert parse_json('{"a": 1}'.encode("utf-8-sig"), "it") == {"a": 1}


def _read_glb(text: bytes) -> RawMesh:
    chunk = struct.pack("<II", len(text), 0x4E4F534A) + text
    return parsed_mesh(Path("it.glb"), b"glTF" + struct.pack("<II", 2, 12 + len(chunk)) + chunk)


@pytest.mark.parametrize("text", [b"{", b"[" * 100_000, b"\x80", b"\xff\xfe\xff"])
def test_a_glb_whose_description_is_no_json_is_one_line(text: bytes) -> None:
    with pytest.raises(MeshError, match=r"^it\.glb: its glTF description: is not (JSON|text).*again$"):
        _read_glb(text)


@pytest.mark.parametrize("number", NO_NUMBERS)
@pytest.mark.parametrize(
    ("read", "text", "error"),
    [
        (read_plan, '{"schema_version": 1, "metrics": {"x": %s}}', PlanError),
        (lambda path: read_order(path, ["mug"]), '[{"item": "mug", "qty": %s}]', OrderError),
        (load_cell, '{"robot": "tx90", "friction": %s}', InputError),
        (lambda path: read_document(str(path), "--config"), '{"ppo": {"gamma": %s}}', InputError),
        (lambda path: read_document(path.read_text(), "--config"), '{"seed": %s}', InputError),
        (lambda path: read_config(path.parent), '{"schema_version": 1, "train": {"seed": %s}}', InputError),
        (
            lambda path: _read_glb(path.read_bytes()),
            '{"asset": {"version": "2.0"}, "extras": [%s]}',
            MeshError,
        ),
    ],
    ids=["plan", "order", "cell", "train file", "train words", "policy", "glb"],
)
def test_every_reader_refuses_it(
    read: Callable[[Path], object], text: str, error: type[InputError], number: str, tmp_path: Path
) -> None:
    path = tmp_path / "config.json"
    path.write_text(text.replace("%s", number))
    with pytest.raises(error, match="give a finite number"):
        read(path)


@pytest.mark.parametrize("option", ["verify", "ORDER", "--cell"])
def test_the_command_line_says_so_and_exits_with_2(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "it.json"
    path.write_text('{"schema_version": 1, "robot": "tx90", "items": [1], "friction": 1%s}' % ("0" * 400))
    (tmp_path / "o.csv").write_text("item,qty\nmug,1\n")
    order = str(path if option == "ORDER" else tmp_path / "o.csv")
    words = (
        ["verify", str(path)] if option == "verify" else ["pack", order, "--out", str(tmp_path / "p.json")]
    )
    assert main([*words, *(["--cell", str(path)] if option == "--cell" else [])]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "it.json: friction is 1000" in said


@pytest.mark.parametrize("value", [10**400, float("nan"), float("inf"), np.float64("inf"), True, "1", None])
def test_what_is_no_finite_number_is_none(value: object) -> None:
    assert not is_number(value)
    with pytest.raises(InputError, match="learning_rate"):
        TrainConfig.from_mapping({"ppo": {"learning_rate": value}})
